// Asks for view.json twice a second and draws it. Whatever comes from files is set as text, never as markup. Where the
// address ends in the token that the terminal showed, it may ask the recorder for something: POST control.
"use strict";

const EVERY_MS = 500;
const SVG = "http://www.w3.org/2000/svg";
const UNITS = [["_c", "°C", 2], ["_percent", "%RH", 1], ["_ohm", "Ω", 0], ["_hpa", "hPa", 1]];

const RING_AGAIN_MS = 20000;
const PLACES = ["source", "destination"];

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

// The points within `zoom` seconds after the transfer, and a tenth of that before it; all where there was none yet.
function zoomed(points, transfer, zoom) {
  if (!zoom || !transfer) return points;
  const [from, to] = [transfer[0] - 0.1 * zoom, transfer[0] + zoom];
  const kept = points.filter((p) => p[0] >= from && p[0] <= to);
  return kept.length > 1 ? kept : points;
}

function chart(trace, transfer, zoom) {
  // As wide as there is room for: letters keep their size on a small screen.
  const wide = Math.max(300, Math.min(720, part("traces").clientWidth || 720));
  const [high, left, right, top, bottom] = [220, 56, 12, 10, 34];
  const shown = zoomed(trace.points, transfer, zoom);
  const xs = shown.map((p) => p[0]);
  const ys = shown.map((p) => p[1]);
  const expected = trace.expected.map((value, k) => [value, PLACES[k]]).filter(([value]) => value !== null);
  const all = [...ys, ...expected.map(([value]) => value)];
  let [x0, x1, y0, y1] = [Math.min(...xs), Math.max(...xs), Math.min(...all), Math.max(...all)];
  if (x1 - x0 < 0.1) x1 = x0 + 1;
  const room = Math.max(0.08 * (y1 - y0), 0.05);
  [y0, y1] = [y0 - room, y1 + room];
  const x = (t) => left + ((t - x0) / (x1 - x0)) * (wide - left - right);
  const y = (v) => high - bottom - ((v - y0) / (y1 - y0)) * (high - top - bottom);
  const unit = trace.unit === "degC" ? "°C" : trace.unit;
  const svg = drawn("svg", { viewBox: `0 0 ${wide} ${high}`, role: "img" });
  const last = trace.points[trace.points.length - 1][1];
  svg.append(drawn("title", {}, `${trace.sensor} ${trace.quantity}: ${last.toFixed(2)} ${unit} now`));
  const vertical = ticks(y0, y1, 4);
  for (const value of vertical.found) {
    svg.append(drawn("line", { class: "grid", x1: left, x2: wide - right, y1: y(value), y2: y(value) }));
    svg.append(drawn("text", { class: "tick end", x: left - 6, y: y(value) + 4 }, value.toFixed(vertical.digits)));
  }
  const horizontal = ticks(x0, x1, Math.max(3, Math.round(wide / 90)));
  for (const value of horizontal.found) {
    svg.append(drawn("text", { class: "tick middle", x: x(value), y: high - bottom + 16 }, value.toFixed(horizontal.digits)));
  }
  svg.append(drawn("text", { class: "tick end", x: wide - right, y: high - 4 }, "s since the recording began"));
  for (const [value] of expected) {
    svg.append(drawn("line", { class: "expected", x1: left, x2: wide - right, y1: y(value), y2: y(value) }));
  }
  if (transfer && transfer[0] >= x0 && transfer[0] <= x1) {
    svg.append(drawn("line", { class: "transfer", x1: x(transfer[0]), x2: x(transfer[0]), y1: top, y2: high - bottom }));
    // To the left of the line where there is no room at its right.
    const room = x(transfer[0]) + 60 < wide - right;
    const [place, side] = room ? [x(transfer[0]) + 4, "tick"] : [x(transfer[0]) - 4, "tick end"];
    svg.append(drawn("text", { class: side, x: place, y: top + 10 }, "transfer"));
  }
  const points = shown.map(([t, v]) => `${x(t).toFixed(1)},${y(v).toFixed(1)}`).join(" ");
  svg.append(drawn("polyline", { class: `trace ${trace.quantity === "humidity" ? "humidity" : "temperature"}`, points }));
  const figure = element("figure");
  // What is planned is said here: in the chart it would be printed over the readings.
  const planned = expected.map(([value, place]) => `${place} ${value}`).join(", ");
  const words = `${trace.sensor} ${trace.quantity} in ${unit}: ${last.toFixed(2)}`;
  figure.append(element("figcaption", planned ? `${words} (dotted, planned: ${planned})` : words), svg);
  return figure;
}

// Tones, made here: the page's policy loads nothing. A browser keeps silent until somebody has touched the page, which is
// what the button is for.
const audio = typeof AudioContext === "undefined" ? null : new AudioContext();

function tones(hertz) {
  if (audio === null) return;
  hertz.forEach((one, k) => {
    const tone = audio.createOscillator();
    tone.frequency.value = one;
    tone.connect(audio.destination);
    tone.start(audio.currentTime + 0.3 * k);
    tone.stop(audio.currentTime + 0.3 * k + 0.25);
  });
}

function soundShown() {
  const on = audio !== null && audio.state === "running";
  part("sound").textContent = on ? "Sound is on" : "Turn the sound on";
  part("sound").setAttribute("aria-pressed", String(on));
}

part("sound").addEventListener("click", async () => {
  if (audio === null) return;
  if (audio.state === "running") await audio.suspend();
  else {
    await audio.resume();
    tones([660]);
  }
  soundShown();
});

// What a tone has rung for, and when: it rings for something new at once, and again while it lasts.
const rung = { prompt: ["", 0], alarms: ["", 0] };

function ring(what, words, hertz) {
  const [before, at] = rung[what];
  if (words === before && (words === "" || Date.now() - at < RING_AGAIN_MS)) return;
  rung[what] = [words, Date.now()];
  if (words !== "") tones(hertz);
}

function showPrompt(prompt) {
  part("prompt").hidden = prompt === null;
  if (prompt !== null) {
    if (part("prompt-text").textContent !== prompt.text) part("prompt-text").textContent = prompt.text;
    part("prompt-keys").textContent = prompt.keys;
    part("prompt-left").textContent = prompt.left_s === null ? "" : `${duration(prompt.left_s)} left`;
  }
  ring("prompt", prompt === null ? "" : prompt.text, [880, 660]);
}

function showAlarms(alarms) {
  const words = alarms.join("\n");
  part("alarms").hidden = alarms.length === 0;
  if (part("alarms").dataset.words !== words) {
    part("alarms").dataset.words = words;
    part("alarms").replaceChildren(...alarms.map((text) => element("p", text)));
  }
  ring("alarms", words, [440, 520, 440, 520]);
}

// What goes on, and what the person at the bench must do about it.
function nowWords(view) {
  if (view.prompt !== null) return "The bench waits for you: the answer goes into its own terminal.";
  if (!["recording", "stalled"].includes(view.state)) return "";
  const step = view.steps.find((one) => one.state === "now");
  if (step === undefined || view.step_s === null) return "";
  const left = view.step_left_s > 0 ? `${duration(view.step_left_s)} left` : `for ${duration(view.step_s)} now`;
  return `${step.text.split(" ")[0]}, ${left}. Nothing for you to do.`;
}

const TOKEN_KEY = "shockrig-token";

// The token stands behind the # of the address: kept for this tab, and taken out of sight.
function token() {
  if (location.hash.length > 1) {
    sessionStorage.setItem(TOKEN_KEY, location.hash.slice(1));
    history.replaceState(null, "", location.pathname);
  }
  return sessionStorage.getItem(TOKEN_KEY);
}

let run = ""; // the run that the page shows: what is asked for is meant for that one

async function request(action, text = "") {
  try {
    const answer = await fetch("control", {
      method: "POST",
      headers: { "Content-Type": "application/json", "X-Shockrig-Token": token() },
      body: JSON.stringify({ action, run, text }),
    });
    const words = (await answer.text()).trim();
    part("answer").textContent = `${action}: ${words}`;
    return answer.ok;
  } catch (error) {
    part("answer").textContent = `${action}: the watcher does not answer`;
    return false;
  }
}

async function takeNote() {
  if (await request("note", part("note").value)) part("note").value = "";
}

if (token() !== null) {
  part("control").hidden = false;
  part("pause").addEventListener("click", () => confirm("Pause the campaign?") && request("pause"));
  part("skip").addEventListener("click", () => confirm(`Skip run ${run}?`) && request("skip"));
  part("repeat").addEventListener("click", () => confirm(`Repeat run ${run}?`) && request("repeat"));
  part("take").addEventListener("click", takeNote);
  part("note").addEventListener("keydown", (event) => event.key === "Enter" && takeNote());
}

function show(view) {
  const first = view.prompt !== null ? "YOUR TURN - " : view.alarms.length ? "ALARM - " : "";
  document.title = `${first}${view.campaign} - ${view.state}`;
  run = view.run;
  showPrompt(view.prompt);
  showAlarms(view.alarms);
  soundShown();
  part("campaign").textContent = view.campaign;
  part("place").textContent = `${view.protocol} on ${view.bench}`;
  const state = part("state");
  state.textContent = view.state === "stalled" ? `stalled for ${duration(view.heard_s)}` : view.state;
  state.dataset.state = view.state;
  part("now").textContent = nowWords(view);
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
      card.append(head, ...(values.length ? values : ["-"]).map((value) => element("p", value, "value")));
      card.append(element("p", `${one.per_s} good/s; last 10 s: ${counts.join(", ") || "nothing"}`, "quiet"));
      return card;
    }),
  );
  const zoom = Number(part("zoom").value);
  part("traces").replaceChildren(...view.traces.map((trace) => chart(trace, view.transfer_s, zoom)));
  part("notes-part").hidden = view.notes.length === 0;
  part("notes").replaceChildren(...view.notes.map(([at, text]) => element("li", `${at} s: ${text}`)));
  part("messages-part").hidden = view.messages.length === 0;
  part("messages").replaceChildren(...view.messages.map((text) => element("li", text)));
  part("plan").replaceChildren(
    ...view.runs.map((one) => {
      const row = element("tr", "", one.state);
      const aside = one.set_aside ? `, ${one.set_aside} set aside` : "";
      for (const text of [one.id, one.source, one.destination, one.state + aside, one.note]) row.append(element("td", text));
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
