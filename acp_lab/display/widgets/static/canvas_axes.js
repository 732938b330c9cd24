// Ticks along the lower and left rim of a canvas whose picture is a map of something else than a place.
//
// An axis {label, unit, low, high} runs over the whole picture: low at its left or upper edge, high at the other one.

class Axes {
  constructor(scene) {
    this.scene = scene;
    this.group = svg("g", { class: "acp-axes" }, scene.svg);
  }

  // The value at a place in the picture; `along` is 0 for x, 1 for y.
  value(axis, place, along) {
    const size = this.scene.whole()[2 + along];
    return axis.low + ((place + 0.5) / size) * (axis.high - axis.low);
  }

  read([x, y]) {
    const shown = (axis, place, along) => `${this.value(axis, place, along).toFixed(1)} ${axis.unit}`;
    const [horizontal, vertical] = this.scene.model.get("axes");
    return `${shown(horizontal, x, 0)}, ${shown(vertical, y, 1)}`;
  }

  draw() {
    this.group.replaceChildren();
    const axes = this.scene.model.get("axes");
    if (axes.length !== 2) return;
    axes.forEach((axis, along) => this.drawOne(axis, along));
  }

  drawOne(axis, along) {
    const { scene } = this;
    const { box } = scene;
    const unit = scene.unit();
    const from = this.value(axis, box[along], along);
    const to = this.value(axis, box[along] + box[2 + along], along);
    const rim = along ? box[0] : box[1] + box[3];
    for (const { at: tick, text } of ticksOf(Math.min(from, to), Math.max(from, to))) {
      const share = (tick - from) / (to - from);
      if (share < 0.08 || share > 0.92) continue;
      const place = box[along] + share * box[2 + along];
      const [x, y] = along ? [rim, place] : [place, rim];
      const mark = svg("g", { transform: `translate(${x} ${y}) scale(${unit})` }, this.group);
      svg("path", { d: along ? "M0 0h6" : "M0 0v-6" }, mark);
      const at = along ? { x: 9, y: 4, "text-anchor": "start" } : { x: 0, y: -9, "text-anchor": "middle" };
      svg("text", at, mark).textContent = text;
    }
    const name = `${axis.label} [${axis.unit}]`;
    const [x, y] = along ? [box[0] + 8 * unit, box[1] + 16 * unit] : [box[0] + box[2] - 8 * unit, rim - 22 * unit];
    const title = svg("text", { class: "acp-axis-name", transform: `translate(${x} ${y}) scale(${unit})` }, this.group);
    title.setAttribute("text-anchor", along ? "start" : "end");
    title.textContent = name;
  }
}
