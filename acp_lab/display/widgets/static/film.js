// The pictures of a film on the browser's side: asked for ahead of time, kept, and shown without a round trip.
//
// To a canvas it is the model: what it asks for comes from the picture that is shown, everything else from the kernel.

const AHEAD = 24; // pictures that should be here before their time comes
const MOST_ASKED = 8; // in one message; the next is sent when they are here, so that a slow kernel is never flooded
const MOST_KEPT = 240;
const PATIENCE_MS = 5000; // without an answer: then the question or its answer is lost, and is asked again

class Film {
  constructor(model) {
    this.model = model;
    this.at = model.get("place");
    this.edition = model.get("edition"); // of the pictures that are kept
    this.shown = null; // a picture; null for the one that came with the widget
    this.kept = new Map();
    this.asked = new Set();
    this.heard = performance.now(); // the last answer or question
    this.patience = PATIENCE_MS;
    this.arrived = () => {};
    this.isCutOff = false; // nobody answers any more, as after a restart of the kernel
    this.cutOff = () => {};
    this.hear = (message, buffers) => this.take(message, buffers);
    model.on("msg:custom", this.hear);
  }

  get(name) {
    return this.shown && name in this.shown ? this.shown[name] : this.model.get(name);
  }

  on(name, action) {
    this.model.on(name, action);
  }

  off(name, action) {
    this.model.off(name, action);
  }

  send(message) {
    try {
      this.model.send(message);
    } catch {
      this.asked.clear();
      this.isCutOff = true;
      this.cutOff();
    }
  }

  get count() {
    return this.model.get("count");
  }

  // The frame after this one; -1 at the end.
  next() {
    if (this.at + 1 < this.count) return this.at + 1;
    return this.model.get("repeat") ? 0 : -1;
  }

  // Ask for this frame and those that follow, as far as they are not here.
  ask() {
    if (this.edition !== this.model.get("edition")) return; // the old ones are forgotten first
    const now = performance.now();
    if (this.asked.size) {
      if (now - this.heard < this.patience) return;
      this.patience *= 2; // a kernel that is busy for minutes finds few questions in its queue
    }
    const wanted = [];
    for (let i = 0; i < Math.min(AHEAD, this.count) && wanted.length < MOST_ASKED; i++) {
      const frame = (this.at + i) % this.count;
      if (!this.kept.has(frame)) wanted.push(frame);
    }
    if (!wanted.length) return;
    this.asked = new Set(wanted);
    this.heard = now;
    this.send({ kind: "want", frames: wanted, edition: this.model.get("edition") });
  }

  take(message, buffers) {
    if (message.kind !== "picture" || message.edition !== this.model.get("edition")) return;
    const { frame, ...picture } = message;
    // First of all: whatever goes wrong with this picture, the others are asked for.
    this.asked.delete(frame);
    this.heard = performance.now();
    this.patience = PATIENCE_MS;
    this.isCutOff = false;
    picture.image = buffers[0];
    picture.overlays = message.overlays.map((overlay, i) => ({ ...overlay, data: buffers[i + 1] }));
    picture.url = buffers[0].byteLength ? URL.createObjectURL(new Blob([buffers[0]])) : "";
    const loader = new Image();
    loader.src = picture.url;
    picture.ready = picture.url ? loader.decode().catch(() => {}) : Promise.resolve();
    this.drop(frame);
    this.kept.set(frame, picture);
    if (this.kept.size > MOST_KEPT) this.drop(this.kept.keys().next().value);
    this.ask();
    this.arrived(frame);
  }

  drop(frame) {
    const picture = this.kept.get(frame);
    this.kept.delete(frame);
    // What is shown keeps its picture until the next one.
    if (picture?.url && picture !== this.shown) URL.revokeObjectURL(picture.url);
  }

  forget() {
    this.shown = null;
    this.edition = this.model.get("edition");
    for (const frame of [...this.kept.keys()]) this.drop(frame);
    this.asked.clear();
  }

  destroy() {
    this.model.off("msg:custom", this.hear);
    this.forget();
  }
}
