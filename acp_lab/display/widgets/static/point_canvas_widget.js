export default {
  render({ model, el }) {
    const canvas = new PointCanvas(model, el);
    return () => canvas.destroy();
  },
};
