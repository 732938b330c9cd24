export default {
  // Once per page: what the page before it held when it was loaded anew or closed, no hand holds any more.
  initialize({ model }) {
    if (!model.get("dragging")) return;
    model.set("dragging", false);
    model.save_changes();
  },
  render({ model, el }) {
    const canvas = new PointCanvas(model, el);
    return () => canvas.destroy();
  },
};
