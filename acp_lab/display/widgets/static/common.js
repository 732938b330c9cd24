// Small things that every widget's drawing needs; put in front of each of them, so that no file is fetched.

const SVG = "http://www.w3.org/2000/svg";
const TICKS = 4;
const LONGEST = 6; // letters of a tick's text
const ICONS = {
  "zoom in": "M7 3v8M3 7h8",
  "zoom out": "M3 7h8",
  "show all": "M2 5V2h3M9 2h3v3M12 9v3H9M5 12H2V9",
  undo: "M5 3L2 6l3 3M2 6h6a3 3 0 0 1 0 6H5",
  play: "M4 2l8 5-8 5Z",
  pause: "M4 2v10M10 2v10",
  "step back": "M10 2L4 7l6 5Z",
  "step forward": "M4 2l6 5-6 5Z",
  repeat: "M3 5h7a2 2 0 0 1 0 5H3M5 3L3 5l2 2",
  reset: "M12 7a5 5 0 1 1-1.5-3.5M11 1v3H8",
};

function svg(tag, attributes = {}, parent = null) {
  const node = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  if (parent) parent.appendChild(node);
  return node;
}

function html(tag, className, parent, text = "") {
  const node = document.createElement(tag);
  node.className = className;
  node.textContent = text;
  parent?.appendChild(node);
  return node;
}

function button(name, parent, action) {
  const node = html("button", "acp-button", parent);
  node.type = "button";
  node.title = name;
  node.setAttribute("aria-label", name);
  svg("path", { d: ICONS[name] }, svg("svg", { viewBox: "0 0 14 14" }, node));
  node.addEventListener("click", action);
  return node;
}

// Numbers arrive as bytes: thousands of strokes as nested lists would take longer to send than to draw.
function numbers(view) {
  return new Float32Array(view.buffer.slice(view.byteOffset, view.byteOffset + view.byteLength));
}

function pathOf(overlay) {
  const v = numbers(overlay.data);
  const words = [];
  if (overlay.kind === "strokes") {
    for (let i = 0; i + 3 < v.length; i += 4) words.push(`M${v[i]} ${v[i + 1]}L${v[i + 2]} ${v[i + 3]}`);
  } else if (overlay.kind === "dots") {
    for (let i = 0; i + 1 < v.length; i += 2) words.push(`M${v[i]} ${v[i + 1]}h0`);
  } else {
    for (let i = 0; i + 1 < v.length; i += 2) words.push(`${i ? "L" : "M"}${v[i]} ${v[i + 1]}`);
    if (overlay.kind === "polygon" && v.length) words.push("Z");
  }
  return words.join("");
}

// Round numbers that divide a range into about TICKS parts, as {at, text}; none where an end is not finite, as of no
// values.
function ticksOf(low, high) {
  if (!Number.isFinite(low) || !Number.isFinite(high)) return [];
  const rough = (high - low) / TICKS || 1;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= rough);
  const ticks = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) ticks.push(k * step);
  const digits = Math.max(0, Math.ceil(-Math.log10(step) - 1e-9));
  const plain = ticks.map((tick) => tick.toFixed(Math.min(digits, 100)));
  // There is room for LONGEST letters: beyond that, 1000000 is 1e6, if that is shorter.
  const short = ticks.map((tick) => (tick ? Number(tick.toPrecision(12)).toExponential().replace("e+", "e") : "0"));
  const longest = (texts) => Math.max(...texts.map((text) => text.length));
  const texts = longest(plain) > Math.max(LONGEST, longest(short)) ? short : plain;
  return ticks.map((at, i) => ({ at, text: texts[i] }));
}
