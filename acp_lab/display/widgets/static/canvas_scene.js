// The picture, overlays, outline and handles of a PointCanvas, and which part of the image fills the stage.
//
// Convention: the SVG's user units are image pixels and (0, 0) is the centre of the top-left one, so the image
// begins at (-0.5, -0.5). Handles are drawn in screen pixels: their group is scaled back by `unit()`.

const HANDLE_PX = 9;
const GRIP_PX = 20; // how far from a handle a finger may miss it
const LOUPE_SHARE = 0.3;
const LOUPE_ZOOM = 4;
const MOST_ZOOM = 64;
const LEAST_WIDTH_PX = 200;
const MOST_ASPECT = 10; // of the stage, width by height
const NO_KERNEL = "no kernel answers: run the cell again";

class Scene {
  constructor(model, el) {
    this.model = model;
    this.hidden = new Set(); // labels of overlays that were switched off in the legend
    this.grabbed = []; // indices of the points that the hand holds
    this.picture = 0;
    this.isCutOff = false; // the kernel was started anew: this widget is not in it
    this.build(el);
    this.showImage();
    this.showView();
    this.showAll();
  }

  build(el) {
    this.root = html("div", "acp-canvas", el);
    // JupyterLab would take the arrow keys for its cells.
    this.root.dataset.lmSuppressShortcuts = "true";
    const bar = html("div", "acp-bar", this.root);
    this.title = html("span", "acp-title", bar);
    this.buttons = {};
    const tools = html("span", "acp-tools", bar);
    for (const name of ["undo", "reset"]) {
      this.buttons[name] = button(name, tools, () => this.goBack(name));
    }
    button("zoom in", tools, () => this.zoom(1.5));
    button("zoom out", tools, () => this.zoom(1 / 1.5));
    button("show all", tools, () => this.showWhole());
    this.stage = html("div", "acp-stage", this.root);
    this.svg = svg("svg", { class: "acp-svg", tabindex: "-1" }, this.stage);
    const id = `acp-${Math.random().toString(36).slice(2)}`;
    this.scene = svg("g", { id }, this.svg);
    this.blank = svg("rect", { class: "acp-blank", x: -0.5, y: -0.5 }, this.scene);
    this.image = svg("image", { x: -0.5, y: -0.5, preserveAspectRatio: "none" }, this.scene);
    this.overlays = svg("g", { class: "acp-overlays" }, this.scene);
    this.outlineShadow = svg("path", { class: "acp-outline-shadow" }, this.svg);
    this.outline = svg("path", { class: "acp-outline" }, this.svg);
    this.axes = new Axes(this);
    this.handles = svg("g", { class: "acp-handles" }, this.svg);
    this.loupe = svg("svg", { class: "acp-loupe", visibility: "hidden" }, this.svg);
    this.loupeBack = svg("rect", { class: "acp-loupe-back" }, this.loupe);
    svg("use", { href: `#${id}` }, this.loupe);
    this.loupeCross = svg("path", { class: "acp-loupe-cross" }, this.loupe);
    this.loupeRim = svg("rect", { class: "acp-loupe-rim", visibility: "hidden" }, this.svg);
    this.legend = html("div", "acp-legend", this.root);
    const foot = html("div", "acp-foot", this.root);
    this.status = html("span", "acp-status", foot);
    this.place = html("span", "acp-place", foot);
  }

  // Undo or reset; not below a hand that holds points, which would put down others than it took up.
  goBack(kind) {
    if (!this.grabbed.length) this.say({ kind });
  }

  say(message) {
    try {
      this.model.send(message);
    } catch {
      this.cutOff();
    }
  }

  // Nobody hears any more what a hand does here: it moves nothing.
  cutOff() {
    this.isCutOff = true;
    this.showAll();
  }

  isEditable() {
    return this.model.get("editable") && !this.isCutOff;
  }

  // ---- showing

  showAll() {
    this.showSize();
    this.showOverlays();
    this.showPoints();
    this.showText();
    const editable = this.isEditable();
    for (const node of Object.values(this.buttons)) node.hidden = !editable;
  }

  showSize() {
    const [, , width, seen] = this.aspect();
    const height = Math.max(seen, width / MOST_ASPECT);
    const limit = this.model.get("height_px");
    // A tall image gets some ground beside it, a wide one above and below: nobody could hit a stage that is a few pixels
    // wide or high.
    const most = Math.round(Math.max((limit * width) / height, Math.min(LEAST_WIDTH_PX, limit)));
    const tall = (limit * width) / height < most;
    this.stage.style.width = `min(100%, ${most}px)`;
    this.stage.style.aspectRatio = tall ? `${most} / ${limit}` : `${width} / ${height}`;
    // What stands above and below it is as wide, but a title needs some room.
    this.root.style.maxWidth = `${Math.max(most, 280)}px`;
  }

  showImage() {
    const bytes = this.model.get("image");
    const number = ++this.picture;
    const has = bytes && bytes.byteLength > 0;
    this.root.classList.toggle("acp-no-image", !has);
    if (!has) {
      this.image.removeAttribute("href");
      return;
    }
    const url = URL.createObjectURL(new Blob([bytes]));
    const loader = new Image();
    loader.src = url;
    const show = () => {
      // Pictures of a film may be decoded out of order.
      if (number !== this.picture) return URL.revokeObjectURL(url);
      this.image.setAttribute("href", url);
      if (this.url) URL.revokeObjectURL(this.url);
      this.url = url;
      this.root.dataset.pictures = number;
    };
    loader.decode().then(show, show);
  }

  showView() {
    const view = this.model.get("view");
    this.showSize();
    this.setView(view.length === 4 ? view : this.whole());
  }

  // All of the image; from there, back to the part of it that the kernel wants to be seen first.
  showWhole() {
    const whole = this.whole();
    const isWhole = whole.every((value, i) => value === this.box[i]);
    this.setView(isWhole ? this.aspect() : whole);
  }

  showOverlays() {
    this.overlays.replaceChildren();
    const named = new Map();
    for (const overlay of this.model.get("overlays")) {
      const hidden = this.hidden.has(overlay.label);
      const path = svg("path", { d: hidden ? "" : pathOf(overlay), class: `acp-overlay acp-${overlay.kind}` }, this.overlays);
      path.style.stroke = overlay.colour;
      path.style.strokeWidth = overlay.width_px;
      if (overlay.label && !named.has(overlay.label)) named.set(overlay.label, overlay.colour);
    }
    this.showLegend(named);
  }

  showLegend(named) {
    // In a film it is nearly always the same: building it anew would lay out the page anew.
    const told = JSON.stringify([[...named], [...this.hidden]]);
    if (told === this.legendTold) return;
    this.legendTold = told;
    this.legend.replaceChildren();
    for (const [label, colour] of named) {
      const item = html("button", "acp-legend-item", this.legend);
      item.type = "button";
      item.title = "show or hide";
      item.setAttribute("aria-pressed", String(!this.hidden.has(label)));
      html("span", "acp-swatch", item).style.background = colour;
      html("span", "", item, label);
      item.addEventListener("click", () => {
        if (!this.hidden.delete(label)) this.hidden.add(label);
        this.showOverlays();
      });
    }
  }

  showPoints() {
    const points = this.model.get("points");
    const labels = this.model.get("labels");
    const active = this.model.get("active");
    const editable = this.isEditable();
    const closed = this.model.get("closed") && points.length > 2;
    const shape = closed ? `M${points.map((p) => p.join(" ")).join("L")}Z` : "";
    this.outline.setAttribute("d", shape);
    this.outlineShadow.setAttribute("d", shape);
    this.root.classList.toggle("acp-bad", this.model.get("problem") !== "");
    this.root.classList.toggle("acp-editable", editable);
    while (this.handles.childNodes.length > points.length) this.handles.lastChild.remove();
    while (this.handles.childNodes.length < points.length) this.addHandle();
    const unit = this.unit();
    this.axes.draw();
    points.forEach(([x, y], i) => {
      const handle = this.handles.childNodes[i];
      handle.setAttribute("transform", `translate(${x} ${y}) scale(${unit})`);
      handle.setAttribute("aria-label", `point ${labels[i] ?? i + 1} at ${x.toFixed(1)}, ${y.toFixed(1)}`);
      handle.setAttribute("tabindex", editable ? "0" : "-1");
      handle.classList.toggle("acp-active", i === active);
      handle.lastChild.textContent = labels[i] ?? String(i + 1);
    });
    this.showLoupe(points);
  }

  addHandle() {
    const handle = svg("g", { class: "acp-handle", role: "button" }, this.handles);
    svg("circle", { class: "acp-grip", r: GRIP_PX }, handle);
    svg("circle", { class: "acp-ring-shadow", r: HANDLE_PX }, handle);
    svg("circle", { class: "acp-ring", r: HANDLE_PX }, handle);
    svg("circle", { class: "acp-dot", r: 1.5 }, handle);
    svg("text", { class: "acp-label", x: HANDLE_PX + 3, y: -HANDLE_PX + 1 }, handle);
  }

  showLoupe(points) {
    const single = this.grabbed.length === 1;
    const visibility = single ? "visible" : "hidden";
    this.loupe.setAttribute("visibility", visibility);
    this.loupeRim.setAttribute("visibility", visibility);
    if (!single) return;
    const [x, y] = points[this.grabbed[0]];
    const [left, top, width, height] = this.box;
    const side = LOUPE_SHARE * Math.min(width, height);
    // In the corner that the finger is not in.
    const at = { x: x > left + width / 2 ? left : left + width - side, y: top, width: side, height: side };
    const seen = side / LOUPE_ZOOM;
    for (const [name, value] of Object.entries(at)) {
      this.loupe.setAttribute(name, value);
      this.loupeRim.setAttribute(name, value);
    }
    this.loupe.setAttribute("viewBox", `${x - seen / 2} ${y - seen / 2} ${seen} ${seen}`);
    for (const [name, value] of [["x", x - seen], ["y", y - seen], ["width", 2 * seen], ["height", 2 * seen]]) {
      this.loupeBack.setAttribute(name, value);
    }
    const gap = seen / 12;
    const arm = seen / 5;
    this.loupeCross.setAttribute(
      "d",
      `M${x - arm} ${y}H${x - gap}M${x + gap} ${y}H${x + arm}M${x} ${y - arm}V${y - gap}M${x} ${y + gap}V${y + arm}`,
    );
  }

  showText() {
    const problem = this.model.get("problem");
    this.title.textContent = this.model.get("title");
    this.status.textContent = this.isCutOff ? NO_KERNEL : problem || this.model.get("status");
    this.status.setAttribute("role", problem ? "alert" : "status");
  }

  // ---- the view: which part of the image fills the stage

  whole() {
    const [width, height] = this.model.get("image_size");
    return width && height ? [-0.5, -0.5, width, height] : [-0.5, -0.5, 640, 480];
  }

  aspect() {
    const view = this.model.get("view");
    return view.length === 4 ? view : this.whole();
  }

  setView(box) {
    this.box = box.map(Number);
    this.svg.setAttribute("viewBox", this.box.join(" "));
    const [, , width, height] = this.whole();
    for (const node of [this.image, this.blank]) {
      node.setAttribute("width", width);
      node.setAttribute("height", height);
    }
    this.image.classList.toggle("acp-pixels", this.unit() < 0.25);
    this.showPoints();
  }

  unit() {
    const { width, height } = this.svg.getBoundingClientRect();
    if (!width || !height) return 1;
    return Math.max(this.box[2] / width, this.box[3] / height);
  }

  zoom(factor, about = null) {
    const [, , wholeWidth, wholeHeight] = this.whole();
    const [x, y, width, height] = this.box;
    const [px, py] = about ?? [x + width / 2, y + height / 2];
    const most = Math.max(2 * wholeWidth, 2 * wholeHeight);
    const newWidth = Math.min(Math.max(width / factor, wholeWidth / MOST_ZOOM), most);
    const scale = newWidth / width;
    this.setView([px - (px - x) * scale, py - (py - y) * scale, newWidth, height * scale]);
  }
}
