// Asks for view.json once a second and draws the flight: values now, profiles over altitude, and a course over time
// where the altitude does not move or is not known. Whatever comes is set as text, never as markup.
"use strict";

const EVERY_MS = 1000;
const SVG = "http://www.w3.org/2000/svg";
const COVER = 1.96;
const STILL_M = 10; // within which an altitude wanders in a hover
const HOVER_S = 300; // of which the course is shown
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

// Over altitude values go across and the altitude up, over time the time goes across and values up.
function chart(points, over, [title, kind, unit, , , [value, spread, read]]) {
  const upward = over !== "time";
  const [wide, high, left, right, top, bottom] = [440, upward ? 420 : 240, 56, 12, 10, 40];
  const along = upward ? "altitude_m" : "time_s";
  const shown = points.filter((p) => p[along] !== null);
  const values = shown.flatMap((p) => [p[value], p[read]]).filter((v) => v !== null);
  if (values.length < 2) return element("p", `${title}: no values yet`, "quiet");
  const ranges = [range(values, 0.1), range(shown.map((p) => p[along]), 1.0)];
  const [[x0, x1], [y0, y1]] = upward ? ranges : ranges.reverse();
  const [width, height] = [wide - left - right, high - top - bottom];
  const x = (v) => left + ((v - x0) / (x1 - x0)) * width;
  const y = (v) => high - bottom - ((v - y0) / (y1 - y0)) * height;
  const place = (v, p) => (upward ? [x(v), y(p[along])] : [x(p[along]), y(v)]).map((at) => at.toFixed(1)).join(",");
  const svg = drawn("svg", { viewBox: `0 0 ${wide} ${high}`, role: "img" });
  svg.append(drawn("title", {}, `${title} over ${over}`));
  const [across, up] = [ticks(x0, x1, 4), ticks(y0, y1, 6)];
  for (const v of up.found) {
    svg.append(drawn("line", { class: "grid", x1: left, x2: wide - right, y1: y(v), y2: y(v) }));
    svg.append(drawn("text", { class: "tick end", x: left - 6, y: y(v) + 4 }, v.toFixed(up.digits)));
  }
  for (const v of across.found) {
    svg.append(drawn("line", { class: "grid", x1: x(v), x2: x(v), y1: top, y2: high - bottom }));
    svg.append(drawn("text", { class: "tick middle", x: x(v), y: high - bottom + 16 }, v.toFixed(across.digits)));
  }
  const inside = drawn("svg", { x: left, y: top, width, height, viewBox: `${left} ${top} ${width} ${height}` });
  svg.append(inside); // what is wider than the chart ends at its edge
  for (const piece of pieces(shown, value)) {
    const band = (sign) => piece.map((p) => place(p[value] + sign * COVER * (p[spread] || 0), p));
    inside.append(drawn("polygon", { class: `band ${kind}`, points: [...band(1), ...band(-1).reverse()].join(" ") }));
  }
  for (const [key, classes] of [[read, "trace read"], [value, `trace ${kind}`]]) {
    for (const piece of pieces(shown, key)) {
      inside.append(drawn("polyline", { class: classes, points: piece.map((p) => place(p[key], p)).join(" ") }));
    }
  }
  const words = upward ? `${unit}, over ${over} in m` : `time in s; ${unit} upward`;
  svg.append(drawn("text", { class: "tick middle", x: (left + wide - right) / 2, y: high - 6 }, words));
  const figure = element("figure");
  figure.append(element("figcaption", title), svg);
  return figure;
}

// How far the altitude has moved; nowhere where it is not known.
function moved(points) {
  const altitudes = points.map((p) => p.altitude_m).filter((a) => a !== null);
  return altitudes.length ? Math.max(...altitudes) - Math.min(...altitudes) : 0;
}

function draw(id, points, over) {
  part(`${id}-part`).hidden = points.length === 0;
  part(id).replaceChildren(...(points.length ? SHOWN.map((one) => chart(points, over, one)) : []));
}

function show(view) {
  part("state").textContent = view.state;
  part("state").dataset.state = view.state === "flying" ? "recording" : view.state;
  const when = view.now ? `, ${Math.round(view.now.time_s)} s after the start` : "";
  const where = view.now && view.now.altitude_m !== null ? `, ${view.over} ${Math.round(view.now.altitude_m)} m` : "";
  part("summary").textContent = view.summary + when + where;
  part("health").replaceChildren(...SHOWN.map((one) => card(view.now, one)));
  const known = view.profile.some((p) => p.altitude_m !== null);
  const late = known ? view.profile.filter((p) => p.time_s >= view.now.time_s - HOVER_S) : view.profile;
  draw("profile", moved(view.profile) >= STILL_M ? view.profile : [], view.over);
  draw("course", moved(late) < STILL_M ? late : [], "time");
  part("course-why").textContent = known ? `The ${view.over} does not move.` : "The altitude is not known.";
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
