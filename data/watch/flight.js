// Asks for view.json once a second and draws the flight: values now, and profiles over altitude (over time where the
// altitude is not known). Whatever comes is set as text, never as markup.
"use strict";

const EVERY_MS = 1000;
const SVG = "http://www.w3.org/2000/svg";
const COVER = 1.96;
const SHOWN = [
  ["Temperature", "temperature", "°C", "K", 2, ["temperature_c", "temperature_uncertainty_k", "temperature_read_c"]],
  ["Relative humidity", "humidity", "%RH", "%RH", 1,
    ["humidity_percent", "humidity_uncertainty_percent", "humidity_read_percent"]],
];

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

function ticks(low, high, about) {
  const rough = (high - low) / about;
  const ten = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((k) => k * ten).find((s) => s >= rough);
  const found = [];
  for (let k = Math.ceil(low / step); k * step <= high + 1e-9 * step; k += 1) found.push(k * step);
  return { found, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
}

function card(now, [title, , unit, own, digits, [value, spread, read]]) {
  const made = element("div", "", "card");
  made.append(element("div", title));
  const known = now && now[value] !== null;
  made.append(element("div", known ? `${now[value].toFixed(digits)} ${unit}` : "no value", "value"));
  const sigma = known && now[spread] !== null ? `± ${(COVER * now[spread]).toFixed(digits)} ${own} (95 %)` : "as read";
  if (known) made.append(element("div", sigma));
  const reading = now && now[read] !== null ? `${now[read].toFixed(digits)} ${unit}` : "nothing";
  made.append(element("div", `read: ${reading}`, "quiet"));
  return made;
}

function range(values, least) {
  let [low, high] = [Math.min(...values), Math.max(...values)];
  const room = Math.max(0.05 * (high - low), least);
  return [low - room, high + room];
}

// Lines are broken where there is no value.
function pieces(points, key) {
  const found = [[]];
  for (const point of points) {
    if (point[key] === null) found.push([]);
    else found[found.length - 1].push(point);
  }
  return found.filter((piece) => piece.length > 1);
}

function chart(points, over, [title, kind, unit, , digits, [value, spread, read]]) {
  const wide = 440;
  const [high, left, right, top, bottom] = [420, 56, 12, 10, 40];
  const upward = over.endsWith("altitude");
  const height = upward ? "altitude_m" : "time_s";
  const shown = points.filter((p) => p[height] !== null);
  const values = shown.flatMap((p) => [p[value], p[read]]).filter((v) => v !== null);
  if (values.length < 2) return element("p", `${title}: no values yet`, "quiet");
  const [x0, x1] = range(values, 0.1);
  const [y0, y1] = range(shown.map((p) => p[height]), 1.0);
  const x = (v) => left + ((v - x0) / (x1 - x0)) * (wide - left - right);
  const y = (v) => high - bottom - ((v - y0) / (y1 - y0)) * (high - top - bottom);
  const svg = drawn("svg", { viewBox: `0 0 ${wide} ${high}`, role: "img" });
  svg.append(drawn("title", {}, `${title} over ${upward ? over : "time"}`));
  const [across, up] = [ticks(x0, x1, 4), ticks(y0, y1, 6)];
  for (const v of up.found) {
    svg.append(drawn("line", { class: "grid", x1: left, x2: wide - right, y1: y(v), y2: y(v) }));
    svg.append(drawn("text", { class: "tick end", x: left - 6, y: y(v) + 4 }, v.toFixed(up.digits)));
  }
  for (const v of across.found) {
    svg.append(drawn("line", { class: "grid", x1: x(v), x2: x(v), y1: top, y2: high - bottom }));
    svg.append(drawn("text", { class: "tick middle", x: x(v), y: high - bottom + 16 }, v.toFixed(across.digits)));
  }
  for (const piece of pieces(shown, value)) {
    const band = (sign) => piece.map((p) => [x(p[value] + sign * COVER * (p[spread] || 0)), y(p[height])]);
    const outline = [...band(1), ...band(-1).reverse()].map((p) => p.map((v) => v.toFixed(1)).join(",")).join(" ");
    svg.append(drawn("polygon", { class: `band ${kind}`, points: outline }));
  }
  for (const [key, classes] of [[read, "trace read"], [value, `trace ${kind}`]]) {
    for (const piece of pieces(shown, key)) {
      const line = piece.map((p) => `${x(p[key]).toFixed(1)},${y(p[height]).toFixed(1)}`).join(" ");
      svg.append(drawn("polyline", { class: classes, points: line }));
    }
  }
  const words = `${unit}, over ${upward ? `${over} in m` : "time in s"}`;
  svg.append(drawn("text", { class: "tick middle", x: (left + wide - right) / 2, y: high - 6 }, words));
  const figure = element("figure");
  figure.append(element("figcaption", title), svg);
  return figure;
}

function show(view) {
  part("state").textContent = view.state;
  part("state").dataset.state = view.state === "flying" ? "recording" : view.state;
  const when = view.now ? `, ${Math.round(view.now.time_s)} s after the start` : "";
  const where = view.now && view.now.altitude_m !== null ? `, ${view.over} ${Math.round(view.now.altitude_m)} m` : "";
  part("summary").textContent = view.summary + when + where;
  part("health").replaceChildren(...SHOWN.map((one) => card(view.now, one)));
  const over = view.profile.some((p) => p.altitude_m !== null) ? view.over : "time";
  part("traces").replaceChildren(...SHOWN.map((one) => chart(view.profile, over, one)));
  part("messages-part").hidden = view.messages.length === 0;
  part("messages").replaceChildren(...view.messages.map((text) => element("li", text)));
}

async function ask() {
  try {
    const answer = await fetch("view.json", { cache: "no-store" });
    show(await answer.json());
  } catch (error) {
    part("state").textContent = "the flight's program does not answer";
    part("state").dataset.state = "cut off";
  }
  setTimeout(ask, EVERY_MS);
}

ask();
