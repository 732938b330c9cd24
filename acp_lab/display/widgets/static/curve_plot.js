// Curves over one shared axis, one panel per row, with a cursor that mouse, finger and arrow keys move.

const LEFT = 46;
const RIGHT = 10;
const ROW = 92; // height of a panel's plot, screen px
const GAP = 30; // between panels: the next one's heading
const FOOT = 30;

function shownValue(value) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  return size >= 1000 || (size < 0.01 && size > 0) ? value.toExponential(1) : value.toFixed(size < 10 ? 2 : 1);
}

class CurvePlot {
  constructor(model, el) {
    this.model = model;
    this.root = html("div", "acp-plot", el);
    this.root.dataset.lmSuppressShortcuts = "true";
    this.title = html("div", "acp-title", this.root);
    this.svg = svg("svg", { class: "acp-curves", tabindex: "0", role: "slider" }, this.root);
    this.pending = 0;
    this.changes = {
      "change:cursor": () => this.showCursor(),
      "change:curves": () => this.draw(),
      "change:x": () => this.draw(),
      "change:marks": () => this.draw(),
      "change:limits": () => this.draw(),
      "change:title": () => this.draw(),
      "change:x_label": () => this.draw(),
    };
    for (const [name, action] of Object.entries(this.changes)) model.on(name, action);
    this.svg.addEventListener("pointerdown", (event) => this.press(event));
    this.svg.addEventListener("pointermove", (event) => this.svg.hasPointerCapture(event.pointerId) && this.seek(event));
    this.svg.addEventListener("keydown", (event) => this.key(event));
    this.resized = new ResizeObserver(() => this.draw());
    this.resized.observe(this.root);
    this.draw();
  }

  destroy() {
    for (const [name, action] of Object.entries(this.changes)) this.model.off(name, action);
    this.resized.disconnect();
    if (!this.pending) return;
    // The last place of the cursor waits for an animation frame that may not come any more.
    cancelAnimationFrame(this.pending);
    this.model.save_changes();
  }

  draw() {
    const { model } = this;
    this.title.textContent = model.get("title");
    this.title.hidden = !model.get("title");
    this.width = Math.max(this.root.clientWidth, 160);
    this.x = numbers(model.get("x"));
    this.curves = model.get("curves").map((curve) => ({ ...curve, values: numbers(curve.data) }));
    const rows = [...new Set(this.curves.map((curve) => curve.row))];
    this.svg.replaceChildren();
    const height = rows.length * (ROW + GAP) + FOOT;
    this.svg.setAttribute("viewBox", `0 0 ${this.width} ${height}`);
    this.svg.style.height = `${height}px`;
    this.low = Math.min(...this.x);
    this.high = Math.max(...this.x);
    if (!this.x.length) [this.low, this.high] = [0, 1]; // of no numbers they would be infinite
    if (!(this.high > this.low)) this.high = this.low + 1;
    this.readings = [];
    rows.forEach((row, i) => this.drawRow(row, i * (ROW + GAP) + GAP));
    const bottom = rows.length * (ROW + GAP);
    for (const { at, text } of ticksOf(this.low, this.high)) {
      svg("text", { class: "acp-tick acp-tick-x", x: this.px(at), y: bottom + 13 }, this.svg).textContent = text;
    }
    const label = svg("text", { class: "acp-tick acp-tick-x", x: LEFT + (this.width - LEFT - RIGHT) / 2, y: bottom + 27 }, this.svg);
    label.textContent = model.get("x_label");
    this.line = svg("line", { class: "acp-cursor", y1: GAP, y2: bottom }, this.svg);
    this.showCursor();
  }

  px(x) {
    return LEFT + ((x - this.low) / (this.high - this.low)) * (this.width - LEFT - RIGHT);
  }

  drawRow(row, top) {
    const curves = this.curves.filter((curve) => curve.row === row);
    const marks = this.model.get("marks").filter((mark) => mark.row === row);
    const finite = curves.flatMap((curve) => [...curve.values].filter(Number.isFinite));
    let low = Math.min(...finite, 0);
    let high = Math.max(...finite, ...marks.map((mark) => mark.value));
    if (this.model.get("limits").length === 2) [low, high] = this.model.get("limits");
    if (!(high > low)) high = low + 1;
    const room = 0.05 * (high - low);
    low -= low < 0 ? room : 0;
    high += room;
    const py = (value) => top + ROW - ((Math.min(Math.max(value, low - 1e3 * room), high + 1e3 * room) - low) / (high - low)) * ROW;
    for (const { at, text } of ticksOf(low, high)) {
      svg("line", { class: "acp-grid", x1: LEFT, x2: this.width - RIGHT, y1: py(at), y2: py(at) }, this.svg);
      svg("text", { class: "acp-tick", x: LEFT - 5, y: py(at) + 4 }, this.svg).textContent = text;
    }
    svg("rect", { class: "acp-frame", x: LEFT, y: top, width: this.width - LEFT - RIGHT, height: ROW }, this.svg);
    const window_ = svg("svg", { x: LEFT, y: top, width: this.width - LEFT - RIGHT, height: ROW }, this.svg);
    const inside = svg("g", { transform: `translate(${-LEFT} ${-top})` }, window_);
    for (const mark of marks) {
      svg("line", { class: "acp-mark", x1: LEFT, x2: this.width - RIGHT, y1: py(mark.value), y2: py(mark.value) }, inside);
      // Its name stands at the end of the line that the curves keep away from.
      const away = (end) => Math.min(...curves.flatMap((curve) => end(curve.values).map((value) => Math.abs(value - mark.value))).filter(Number.isFinite));
      const few = Math.ceil(this.x.length / 6);
      const first = away((values) => [...values.slice(0, few)]) > away((values) => [...values.slice(-few)]);
      const place = { x: first ? LEFT + 4 : this.width - RIGHT - 4, y: py(mark.value) + (py(mark.value) < top + 14 ? 12 : -3) };
      svg("text", { class: `acp-tick${first ? " acp-tick-first" : ""}`, ...place }, inside).textContent = mark.label;
    }
    for (const curve of curves) {
      let path = "";
      let pen = "M";
      curve.values.forEach((value, i) => {
        if (Number.isFinite(value)) path += `${pen}${this.px(this.x[i])} ${py(value)}`;
        pen = Number.isFinite(value) ? "L" : "M";
      });
      svg("path", { class: "acp-curve", d: path, style: `stroke: ${curve.colour}` }, inside);
    }
    this.drawHeading(row, curves, top, py);
  }

  drawHeading(row, curves, top, py) {
    const heading = svg("text", { class: "acp-heading", x: LEFT, y: top - 7 }, this.svg);
    svg("tspan", { class: "acp-row-name" }, heading).textContent = row;
    for (const curve of curves) {
      const swatch = svg("tspan", { dx: 10, style: `fill: ${curve.colour}` }, heading);
      swatch.textContent = "●";
      const reading = svg("tspan", { dx: 4 }, heading);
      const dot = svg("circle", { class: "acp-at", r: 4, style: `fill: ${curve.colour}` }, this.svg);
      this.readings.push({ curve, reading, dot, py });
    }
  }

  showCursor() {
    if (!this.line) return;
    const i = Math.min(Math.max(this.model.get("cursor"), 0), this.x.length - 1);
    const at = this.x.length ? this.px(this.x[i]) : LEFT;
    this.line.setAttribute("x1", at);
    this.line.setAttribute("x2", at);
    for (const { curve, reading, dot, py } of this.readings) {
      const value = curve.values[i];
      const isCut = Number.isFinite(curve.most) && value >= curve.most;
      reading.textContent = `${curve.label} ${isCut ? "≥ " : ""}${shownValue(value)}`.trim();
      const shows = Number.isFinite(value);
      dot.setAttribute("visibility", shows ? "visible" : "hidden");
      dot.setAttribute("cx", at);
      dot.setAttribute("cy", shows ? py(value) : 0);
    }
    this.svg.setAttribute("aria-valuenow", i);
    this.svg.setAttribute("aria-valuemax", Math.max(this.x.length - 1, 0));
    this.svg.setAttribute("aria-label", `${this.model.get("title")} cursor`.trim());
  }

  press(event) {
    if (event.button > 0) return;
    this.svg.setPointerCapture(event.pointerId);
    this.svg.focus({ preventScroll: true });
    this.seek(event);
  }

  seek(event) {
    const wanted = event.clientX - this.svg.getBoundingClientRect().left;
    let best = 0;
    this.x.forEach((x, i) => {
      if (Math.abs(this.px(x) - wanted) < Math.abs(this.px(this.x[best]) - wanted)) best = i;
    });
    this.put(best);
  }

  key(event) {
    const step = { ArrowLeft: -1, ArrowRight: 1, PageUp: -10, PageDown: 10, Home: -1e9, End: 1e9 }[event.key];
    if (!step) return;
    event.preventDefault();
    event.stopPropagation();
    this.put(Math.min(Math.max(this.model.get("cursor") + step, 0), this.x.length - 1));
  }

  put(cursor) {
    if (cursor === this.model.get("cursor")) return;
    this.model.set("cursor", cursor);
    // The line follows at once; the kernel, which may have a picture to make, hears once per animation frame.
    if (!this.pending) {
      this.pending = requestAnimationFrame(() => {
        this.pending = 0;
        this.model.save_changes();
      });
    }
  }
}

export default {
  render({ model, el }) {
    const plot = new CurvePlot(model, el);
    return () => plot.destroy();
  },
};
