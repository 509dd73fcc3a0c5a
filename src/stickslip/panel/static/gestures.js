// Wheel and fingers on a plot: the wheel zooms where the plot has the focus, or with Ctrl; one finger pans, two zoom, a
// double tap shows everything. A finger that moves up or down scrolls the page (touch-action in the style sheet).

const TAP = { time: 350, distance: 30 }; // ms between two taps, pixels between them or from where a finger came down

export function attachGestures(over, root, { zoom, pan, autoscale }) {
  const fingers = new Map();
  let tap = null; // { x, y, time } of the finger that came down last, while it may be a tap
  let before = -Infinity; // when a tap ended
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
    tap = fingers.size === 1 ? { x: event.clientX, y: event.clientY } : null;
  }
  function move(event) {
    if (!fingers.has(event.pointerId)) return;
    if (tap && Math.hypot(event.clientX - tap.x, event.clientY - tap.y) < TAP.distance / 3) return;
    tap = null;
    const old = [...fingers.values()];
    const was = fingers.get(event.pointerId);
    fingers.set(event.pointerId, place(event));
    const now = [...fingers.values()];
    if (now.length === 1) pan(was - now[0]);
    else if (now.length === 2) {
      const [narrow, wide] = [Math.abs(old[0] - old[1]), Math.abs(now[0] - now[1])];
      if (narrow > 0.02 && wide > 0.02) zoom(narrow / wide, (now[0] + now[1]) / 2);
    }
  }
  function up(event) {
    if (!fingers.delete(event.pointerId) || event.type !== "pointerup" || !tap) return;
    tap = null;
    if (event.timeStamp - before < TAP.time) {
      before = -Infinity;
      autoscale();
    } else before = event.timeStamp;
  }
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
