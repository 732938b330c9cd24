// A PointCanvas that plays a film, with its controls: play, step, repeat, and a slider.

const TELL_MS = 100; // how often the kernel hears where a playing film is

class FilmCanvas extends PointCanvas {
  constructor(model, el) {
    super(new Film(model), el);
    this.film = this.model;
    this.timer = 0;
    this.id = Math.random().toString(36).slice(2); // of this view of the film
    this.byHand = false; // whether a hand moved it since the kernel was told
    this.leads = false; // whether that hand was the last one, as far as this view knows
    this.film.arrived = (frame) => frame === this.film.at && (this.showControls(), this.showFrame());
    this.film.cutOff = () => this.showText();
    this.film.ask();
  }

  build(el) {
    super.build(el);
    const bar = html("div", "acp-film", null);
    this.stage.after(bar);
    this.playing = button("play", bar, () => (this.timer ? this.pause() : this.play()));
    button("step back", bar, () => this.step(-1));
    button("step forward", bar, () => this.step(1));
    this.repeat = button("repeat", bar, () => {
      this.model.model.set("repeat", !this.model.get("repeat"));
      this.model.model.save_changes();
    });
    this.slider = html("input", "acp-slider", bar);
    this.slider.type = "range";
    this.slider.min = 0;
    this.slider.setAttribute("aria-label", "frame");
    this.slider.addEventListener("input", () => this.moveTo(Number(this.slider.value)));
    this.count = html("span", "acp-place", bar);
  }

  listen() {
    super.listen();
    const film = {
      "change:seek": () => this.goTo(this.model.get("seek")[1], false),
      "change:place": () => this.follow(),
      "change:leader": () => this.follow(),
      "change:edition": () => (this.model.forget(), this.showPicture(), this.showControls(), this.model.ask()),
      "change:count": () => this.showControls(),
      "change:repeat": () => this.showControls(),
    };
    for (const [name, action] of Object.entries(film)) this.model.on(name, action);
    Object.assign(this.changes, film);
    this.showControls();
  }

  destroy() {
    clearTimeout(this.timer);
    if (this.telling) {
      clearTimeout(this.telling);
      this.tell(); // a view that is made anew begins here
    }
    super.destroy();
    this.model.destroy();
  }

  // ---- playing

  play() {
    this.moveTo(this.film.next() < 0 ? 0 : this.film.at);
    this.due = performance.now();
    this.timer = setTimeout(() => this.tick(), 0);
    this.showControls();
  }

  pause() {
    clearTimeout(this.timer);
    this.timer = 0;
    this.showControls();
  }

  tick() {
    const next = this.film.next();
    if (next < 0) return this.pause();
    const now = performance.now();
    if (this.film.kept.has(next)) {
      // Late once is not late for ever, and nothing is hurried to catch up.
      this.due = Math.max(this.due + this.model.get("interval_ms"), now);
      this.goTo(next);
    } else {
      this.film.ask();
      if (this.film.isCutOff) return this.pause();
      this.due = now;
    }
    this.timer = setTimeout(() => this.tick(), Math.max(this.due - performance.now(), 4));
  }

  step(by) {
    this.pause();
    this.moveTo(Math.min(Math.max(this.film.at + by, 0), this.film.count - 1));
  }

  // The hand moves it, not the time.
  moveTo(frame) {
    this.byHand = this.leads = true;
    this.goTo(frame);
  }

  goTo(frame, tells = true) {
    this.film.at = frame;
    this.showControls();
    if (this.film.kept.has(frame)) this.showFrame();
    if (tells && !this.telling) {
      this.telling = setTimeout(() => {
        this.telling = 0;
        this.tell();
      }, TELL_MS);
    }
    this.film.ask();
  }

  tell() {
    this.film.send({ kind: "at", frame: this.film.at, view: this.id, by_hand: this.byHand });
    this.byHand = false;
  }

  // Go where the hand on another view put the film. Of two hands at a time the last one counts, for both.
  follow() {
    const leader = this.model.get("leader");
    if (!leader || this.byHand || (leader === this.id && this.leads)) return;
    this.leads = false;
    clearTimeout(this.telling);
    this.telling = 0;
    if (this.timer) this.pause();
    this.goTo(this.model.get("place"), false);
  }

  // ---- showing

  showControls() {
    const { at, count, kept } = this.model;
    this.slider.max = Math.max(count - 1, 0);
    this.slider.value = at;
    this.count.textContent = `${at + 1} / ${count}${kept.has(at) ? "" : " …"}`;
    const name = this.timer ? "pause" : "play";
    if (this.playing.title !== name) rename(this.playing, name);
    this.repeat.setAttribute("aria-pressed", String(this.model.get("repeat")));
  }

  // At most one per animation frame: what nobody can see need not be drawn.
  showFrame() {
    if (this.showing) return;
    this.showing = requestAnimationFrame(() => {
      this.showing = 0;
      const picture = this.film.kept.get(this.film.at);
      if (!picture || picture === this.film.shown) return;
      const before = this.film.shown;
      this.film.shown = picture;
      this.showPicture();
      const isGone = before && ![...this.film.kept.values()].includes(before);
      if (isGone && before.url) URL.revokeObjectURL(before.url);
    });
  }

  showPicture() {
    this.showImage();
    this.showOverlays();
    const view = String(this.model.get("view"));
    if (view === this.viewShown) this.showPoints();
    else this.showView();
    this.viewShown = view;
    this.showText();
  }

  showText() {
    super.showText();
    if (this.model.isCutOff) this.status.textContent = NO_KERNEL;
  }

  showImage() {
    const picture = this.model.shown;
    if (!picture?.url) return super.showImage();
    const number = ++this.picture;
    picture.ready.then(() => {
      if (number !== this.picture) return;
      this.root.classList.remove("acp-no-image");
      this.image.setAttribute("href", picture.url);
      this.root.dataset.pictures = number;
    });
  }
}

function rename(node, name) {
  node.title = name;
  node.setAttribute("aria-label", name);
  node.querySelector("path").setAttribute("d", ICONS[name]);
}

export default {
  render({ model, el }) {
    const canvas = new FilmCanvas(model, el);
    return () => canvas.destroy();
  },
};
