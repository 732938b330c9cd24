// The next widget of the same box may not take the keyboard before someone clicks into it.

// "inert" is what the page itself respects: no call of focus(), however often it comes, moves the keyboard there.
function render({ el }) {
  let guarded = null;
  let timer = 0;

  function begin() {
    guarded = el.nextElementSibling;
    if (!guarded || !el.parentElement) {
      timer = setTimeout(begin, 20); // it is drawn when it likes
      return;
    }
    guarded.inert = true;
    el.parentElement.addEventListener("pointerdown", wake, { once: true });
  }

  // The click that wakes it counts: it is handed on to what lies under it.
  function wake(event) {
    guarded.inert = false;
    const under = document.elementFromPoint(event.clientX, event.clientY);
    if (under && guarded.contains(under)) under.dispatchEvent(new PointerEvent(event.type, event));
  }

  begin();
  return () => clearTimeout(timer);
}

export default { render };
