// Wheel and fingers on a plot: the wheel zooms where the plot has the focus, or with Ctrl; one finger pans, two zoom.

export function attachGestures(over, root, { zoom, pan }) {
  const fingers = new Map();
  const place = (event) => {
    const box = over.getBoundingClientRect();
    return (event.clientX - box.left) / box.width;
  };
  function wheel(event) {
    if (!event.ctrlKey && !root.contains(document.activeElement)) return;
    event.preventDefault();
    if (event.shiftKey) pan(Math.sign(event.deltaY || event.deltaX) * 0.1);
    else zoom(event.deltaY > 0 ? 1.25 : 0.8, place(event));
  }
  function down(event) {
    if (event.pointerType !== "touch") {
      root.focus({ preventScroll: true });
      return;
    }
    fingers.set(event.pointerId, place(event));
  }
  function move(event) {
    if (!fingers.has(event.pointerId)) return;
    const before = [...fingers.values()];
    const was = fingers.get(event.pointerId);
    fingers.set(event.pointerId, place(event));
    const now = [...fingers.values()];
    if (now.length === 1) pan(was - now[0]);
    else if (now.length === 2) {
      const [old, wide] = [Math.abs(before[0] - before[1]), Math.abs(now[0] - now[1])];
      if (old > 0.02 && wide > 0.02) zoom(old / wide, (now[0] + now[1]) / 2);
    }
  }
  const up = (event) => fingers.delete(event.pointerId);
  over.addEventListener("wheel", wheel, { passive: false });
  over.addEventListener("pointerdown", down);
  over.addEventListener("pointermove", move);
  for (const end of ["pointerup", "pointercancel", "pointerleave"]) over.addEventListener(end, up);
  return () => {
    over.removeEventListener("wheel", wheel);
    over.removeEventListener("pointerdown", down);
    over.removeEventListener("pointermove", move);
    for (const end of ["pointerup", "pointercancel", "pointerleave"]) over.removeEventListener(end, up);
  };
}
