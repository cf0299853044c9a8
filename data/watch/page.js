// Asks for view.json twice a second and draws it. Whatever comes from files is set as text, never as markup.
"use strict";

const EVERY_MS = 500;
const SVG = "http://www.w3.org/2000/svg";
const UNITS = [["_c", "°C", 2], ["_percent", "%RH", 1], ["_ohm", "Ω", 0], ["_hpa", "hPa", 1]];

const part = (id) => document.getElementById(id);

function element(name, text = "", classes = "") {
  const made = document.createElement(name);
  made.textContent = text;
  if (classes) made.className = classes;
  return made;
}

function drawn(name, attributes, text = "") {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.textContent = text;
  return made;
}

function duration(s) {
  if (s < 90) return `${Math.round(s)} s`;
  const minutes = Math.round(s / 60);
  return minutes < 90 ? `${minutes} min` : `${Math.floor(minutes / 60)} h ${String(minutes % 60).padStart(2, "0")} min`;
}

function valueWords(name, value) {
  for (const [suffix, unit, digits] of UNITS) {
    if (name.endsWith(suffix)) return `${value.toFixed(digits)} ${unit}`;
  }
  return `${name} ${value}`;
}

function ticks(low, high, about) {
  const rough = (high - low) / about;
  const ten = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((k) => k * ten).find((s) => s >= rough);
  const found = [];
  for (let k = Math.ceil(low / step); k * step <= high + 1e-9 * step; k += 1) found.push(k * step);
  return { found, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
}

function chart(trace, transfer) {
  const [wide, high, left, right, top, bottom] = [720, 220, 56, 12, 10, 34];
  const xs = trace.points.map((p) => p[0]);
  const ys = trace.points.map((p) => p[1]);
  let [x0, x1, y0, y1] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
  if (x1 - x0 < 1) x1 = x0 + 1;
  const room = Math.max(0.08 * (y1 - y0), 0.05);
  [y0, y1] = [y0 - room, y1 + room];
  const x = (t) => left + ((t - x0) / (x1 - x0)) * (wide - left - right);
  const y = (v) => high - bottom - ((v - y0) / (y1 - y0)) * (high - top - bottom);
  const unit = trace.unit === "degC" ? "°C" : trace.unit;
  const svg = drawn("svg", { viewBox: `0 0 ${wide} ${high}`, role: "img" });
  const last = ys[ys.length - 1];
  svg.append(drawn("title", {}, `${trace.sensor} ${trace.quantity}: ${last.toFixed(2)} ${unit} now`));
  const vertical = ticks(y0, y1, 4);
  for (const value of vertical.found) {
    svg.append(drawn("line", { class: "grid", x1: left, x2: wide - right, y1: y(value), y2: y(value) }));
    svg.append(drawn("text", { class: "tick end", x: left - 6, y: y(value) + 4 }, value.toFixed(vertical.digits)));
  }
  const horizontal = ticks(x0, x1, 8);
  for (const value of horizontal.found) {
    svg.append(drawn("text", { class: "tick middle", x: x(value), y: high - bottom + 16 }, value.toFixed(horizontal.digits)));
  }
  svg.append(drawn("text", { class: "tick end", x: wide - right, y: high - 4 }, "s since the recording began"));
  if (transfer && transfer[0] >= x0 && transfer[0] <= x1) {
    svg.append(drawn("line", { class: "transfer", x1: x(transfer[0]), x2: x(transfer[0]), y1: top, y2: high - bottom }));
    svg.append(drawn("text", { class: "tick", x: x(transfer[0]) + 4, y: top + 10 }, "transfer"));
  }
  const points = trace.points.map(([t, v]) => `${x(t).toFixed(1)},${y(v).toFixed(1)}`).join(" ");
  svg.append(drawn("polyline", { class: `trace ${trace.quantity === "humidity" ? "humidity" : "temperature"}`, points }));
  const figure = element("figure");
  figure.append(element("figcaption", `${trace.sensor} ${trace.quantity} in ${unit}: ${last.toFixed(2)}`), svg);
  return figure;
}

let rung = null; // the prompt that the bell has rung for

// Two tones, made here: the page's policy loads nothing. A browser that has not been touched yet may keep silent.
function bell() {
  try {
    const audio = new AudioContext();
    for (const [k, hertz] of [[0, 880], [1, 660]]) {
      const tone = audio.createOscillator();
      tone.frequency.value = hertz;
      tone.connect(audio.destination);
      tone.start(audio.currentTime + 0.3 * k);
      tone.stop(audio.currentTime + 0.3 * k + 0.25);
    }
  } catch (error) {
    // no sound on this machine: the prompt is still the largest thing on the page
  }
}

function showPrompt(prompt) {
  part("prompt").hidden = prompt === null;
  if (prompt !== null) {
    if (part("prompt-text").textContent !== prompt.text) part("prompt-text").textContent = prompt.text;
    part("prompt-keys").textContent = prompt.keys;
    part("prompt-left").textContent = prompt.left_s === null ? "" : `${duration(prompt.left_s)} left`;
    if (rung !== prompt.text) bell();
  }
  rung = prompt === null ? null : prompt.text;
}

function show(view) {
  document.title = `${view.prompt === null ? "" : "YOUR TURN - "}${view.campaign} - ${view.state}`;
  showPrompt(view.prompt);
  part("campaign").textContent = view.campaign;
  part("place").textContent = `${view.protocol} on ${view.bench}`;
  const state = part("state");
  state.textContent = view.state === "stalled" ? `stalled for ${duration(view.heard_s)}` : view.state;
  state.dataset.state = view.state;
  part("summary").textContent = view.summary;
  part("left").textContent =
    view.left_s === null ? "" : `about ${duration(view.left_s)} left, at most ${duration(view.left_at_most_s)}`;
  part("run").textContent = `Run ${view.run || "-"}` + (view.attempt > 1 ? `, attempt ${view.attempt}` : "");
  part("steps").replaceChildren(
    ...view.steps.map((step) => {
      const item = element("li", step.text, step.state);
      if (step.state === "now" && view.step_s !== null) {
        item.setAttribute("aria-current", "step");
        const left = view.step_left_s > 0 ? `, ${duration(view.step_left_s)} left` : "";
        item.append(element("span", ` ${duration(view.step_s)}${left}`, "time"));
      }
      return item;
    }),
  );
  part("health").replaceChildren(
    ...view.health.map((one) => {
      const card = element("div", "", "card");
      const values = Object.entries(one.values).map(([name, value]) => valueWords(name, value));
      const counts = Object.entries(one.outcomes).map(([outcome, n]) => `${n} ${outcome}`);
      const mark = element("span", one.state, "health");
      mark.dataset.state = one.state;
      const head = element("p", `${one.sensor} `);
      head.append(mark);
      card.append(head, element("p", values.join("   ") || "-", "value"));
      card.append(element("p", `${one.per_s} good/s; last 10 s: ${counts.join(", ") || "nothing"}`, "quiet"));
      return card;
    }),
  );
  part("traces").replaceChildren(...view.traces.map((trace) => chart(trace, view.transfer_s)));
  part("messages-part").hidden = view.messages.length === 0;
  part("messages").replaceChildren(...view.messages.map((text) => element("li", text)));
  part("plan").replaceChildren(
    ...view.runs.map((run) => {
      const row = element("tr", "", run.state);
      const aside = run.set_aside ? `, ${run.set_aside} set aside` : "";
      for (const text of [run.id, run.source, run.destination, run.state + aside, run.note]) row.append(element("td", text));
      return row;
    }),
  );
}

async function look() {
  try {
    const answer = await fetch("view.json", { cache: "no-store" });
    if (!answer.ok) throw new Error(`status ${answer.status}`);
    show(await answer.json());
  } catch (error) {
    part("state").textContent = "the watcher does not answer; the recording does not depend on it";
    part("state").dataset.state = "stalled";
  }
  setTimeout(look, EVERY_MS);
}

look();
