// The hand on a PointCanvas: dragging points by mouse, finger or arrow keys, panning and zooming.
//
// While something is dragged, at most one message per animation frame goes to the kernel; `dragging` says so
// there, and the message that lets go is always sent.

const STEPS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

class PointCanvas extends Scene {
  constructor(model, el) {
    super(model, el);
    this.pointers = new Map(); // what is pressed: id -> its last place in the image
    this.drag = null; // {from: [x, y], to: [x, y], start: points, id}
    this.pending = 0;
    this.listen();
  }

  listen() {
    const { model } = this;
    this.changes = {
      "change:image": () => this.showImage(),
      "change:image_size": () => (this.showView(), this.showAll()),
      "change:view": () => this.showView(),
      "change:overlays": () => this.showOverlays(),
      "change:axes": () => this.showPoints(),
      "change:points": () => (this.dropStale(), this.showPoints()),
      "change:labels": () => this.showPoints(),
      "change:active": () => this.showPoints(),
      "change:closed": () => this.showPoints(),
      "change:problem": () => (this.showPoints(), this.showText()),
      "change:status": () => this.showText(),
      "change:title": () => this.showText(),
      "change:editable": () => this.showAll(),
      "change:height_px": () => this.showSize(),
      comm_live_update: () => this.cutOff(), // said once in the life of a view: when the kernel restarts
    };
    for (const [name, action] of Object.entries(this.changes)) model.on(name, action);
    const canvas = this.svg;
    canvas.addEventListener("pointerdown", (event) => this.press(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    canvas.addEventListener("pointerup", (event) => this.release(event));
    canvas.addEventListener("pointercancel", (event) => this.release(event));
    canvas.addEventListener("pointerleave", () => (this.place.textContent = ""));
    canvas.addEventListener("dblclick", () => this.model.get("clickable") || this.showWhole());
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    this.root.addEventListener("keydown", (event) => this.key(event));
    // The size on screen decides how large a handle is in image pixels.
    this.resized = new ResizeObserver(() => this.showPoints());
    this.resized.observe(this.stage);
  }

  destroy() {
    try {
      // Else what the hand holds would be held for ever.
      this.endSwing();
      this.letGo();
    } catch {
      // The model is closed already: nobody is left to tell.
    }
    for (const [name, action] of Object.entries(this.changes)) this.model.off(name, action);
    this.resized.disconnect();
    if (this.url) URL.revokeObjectURL(this.url);
  }

  wheel(event) {
    // A page that is only scrolled past must not stop here: the picture zooms once it was clicked, or with Ctrl.
    if (!(event.ctrlKey || event.metaKey || this.root.contains(document.activeElement))) return;
    event.preventDefault();
    this.zoom(Math.exp(-0.002 * event.deltaY * (event.deltaMode ? 20 : 1)), this.at(event));
  }

  at(event) {
    const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(this.svg.getScreenCTM().inverse());
    return [point.x, point.y];
  }

  isMap() {
    return this.model.get("axes").length === 2;
  }

  // Of handles that lie upon each other the nearest is meant, not the topmost.
  nearest(event) {
    const [x, y] = this.at(event);
    const distances = this.model.get("points").map((p) => Math.hypot(p[0] - x, p[1] - y));
    return distances.indexOf(Math.min(...distances));
  }

  press(event) {
    if (event.button > 0) return;
    this.svg.setPointerCapture(event.pointerId);
    this.endSwing();
    if (this.pointers.size) this.letGo(); // a second finger leaves what the first one drags where it is
    this.pointers.set(event.pointerId, this.at(event));
    // Two fingers pinch, they never click.
    this.pressed = { client: [event.clientX, event.clientY], moved: this.pointers.size > 1 };
    const points = this.model.get("points");
    const index = event.target.closest(".acp-handle") ? this.nearest(event) : -1;
    const handle = this.handles.childNodes[index];
    const inQuad = event.target === this.outline;
    (handle ?? this.svg).focus({ preventScroll: true });
    event.preventDefault();
    if (this.pointers.size > 1 || !this.isEditable() || !(handle || inQuad)) {
      this.letGo();
      if (this.pointers.size === 1 && this.model.get("orbits")) {
        this.swing = { from: this.at(event), start: this.model.get("orbit") };
      }
      return;
    }
    this.grabbed = handle ? [index] : points.map((_, i) => i);
    this.drag = { from: this.at(event), start: points, id: event.pointerId };
    // A press alone is no drag: `dragging` begins with the first motion.
  }

  move(event) {
    const at = this.at(event);
    this.place.textContent = this.isMap() ? this.axes.read(at) : `${at[0].toFixed(1)}, ${at[1].toFixed(1)} px`;
    if (!this.pointers.has(event.pointerId)) return;
    const before = this.pointers.get(event.pointerId);
    const [x, y] = this.pressed.client;
    if (Math.hypot(event.clientX - x, event.clientY - y) > 2) this.pressed.moved = true;
    if (this.drag && event.pointerId === this.drag.id) {
      this.drag.to = at;
      this.pointers.set(event.pointerId, at);
      if (!this.pending && this.pressed.moved) this.pending = requestAnimationFrame(() => this.carry(true));
      return;
    }
    if (this.swing) {
      this.swing.to = at;
      this.pointers.set(event.pointerId, at);
      if (!this.pending && this.pressed.moved) this.pending = requestAnimationFrame(() => this.turn(true));
    } else if (this.pointers.size === 1) {
      const [left, top, width, height] = this.box;
      this.setView([left + before[0] - at[0], top + before[1] - at[1], width, height]);
    } else {
      this.pinch(event, before, at);
    }
  }

  // The ground is dragged to turn what is seen; the kernel makes the new picture.
  turn(dragging) {
    this.pending = 0;
    if (!this.swing?.to) return;
    const { from, to, start } = this.swing;
    this.model.set("orbit", [start[0] + to[0] - from[0], start[1] + to[1] - from[1]]);
    this.model.set("dragging", dragging);
    this.model.save_changes();
  }

  endSwing() {
    if (!this.swing) return;
    cancelAnimationFrame(this.pending);
    this.pending = 0;
    // A click with an unsteady hand is no turn.
    if (this.pressed.moved) this.turn(false);
    this.swing = null;
  }

  pinch(event, before, at) {
    const other = [...this.pointers].find(([id]) => id !== event.pointerId)[1];
    const reach = (p) => Math.max(Math.hypot(p[0] - other[0], p[1] - other[1]), 1e-6);
    this.zoom(reach(at) / reach(before), other);
    this.pointers.set(event.pointerId, this.at(event));
  }

  carry(dragging) {
    this.pending = 0;
    if (!this.drag) return;
    const { from, to, start } = this.drag;
    this.push(this.shifted(start, this.grabbed, to[0] - from[0], to[1] - from[1]), dragging);
  }

  shifted(points, grabbed, dx, dy) {
    const [, , width, height] = this.whole();
    // Points may leave the image by its own size, no more: a point that nobody finds again helps nobody. Beyond a map
    // there is nothing.
    const held = (v, size) => {
      const [low, high] = this.isMap() ? [-0.5, size - 0.5] : [-size, 2 * size];
      return Math.round(100 * Math.min(Math.max(v, low), high)) / 100;
    };
    return points.map((p, i) => (grabbed.includes(i) ? [held(p[0] + dx, width), held(p[1] + dy, height)] : p));
  }

  push(points, dragging) {
    this.model.set("points", points);
    this.model.set("dragging", dragging);
    this.model.save_changes();
  }

  letGo() {
    if (!this.drag) return;
    cancelAnimationFrame(this.pending);
    // The last place, which may still wait for its animation frame; a press that never moved tells nothing.
    if (this.drag.to && this.pressed.moved) this.carry(false);
    this.pending = 0;
    this.drag = null;
    this.grabbed = [];
    this.showPoints();
  }

  // The points that are held are no more: what the hand does until it lets go moves nothing.
  dropStale() {
    if (!this.drag || this.model.get("points").length === this.drag.start.length) return;
    cancelAnimationFrame(this.pending);
    this.pending = 0;
    this.pointers.delete(this.drag.id);
    this.drag = null;
    this.grabbed = [];
    this.model.set("dragging", false);
    this.model.save_changes();
  }

  // A click on a handle counts as one, too: what is meant may lie next to a point that is there already.
  release(event) {
    const known = this.pointers.delete(event.pointerId);
    if (known) this.endSwing();
    if (this.drag && event.pointerId === this.drag.id) this.letGo();
    if (known && !this.pressed.moved && event.type === "pointerup" && this.model.get("clickable")) {
      const [x, y] = this.at(event);
      this.say({ kind: "click", x, y });
    }
  }

  key(event) {
    if (!this.isEditable() || event.target.closest?.("input, textarea")) return;
    const handle = event.target.closest?.(".acp-handle");
    if (event.key === "z" && (event.ctrlKey || event.metaKey)) {
      this.goBack("undo");
    } else if (handle && event.key in STEPS) {
      const length = event.shiftKey ? 10 : 1;
      const [dx, dy] = STEPS[event.key];
      const index = [...this.handles.childNodes].indexOf(handle);
      this.push(this.shifted(this.model.get("points"), [index], length * dx, length * dy), false);
    } else {
      return;
    }
    event.preventDefault();
    event.stopPropagation();
  }
}
