// A picture over two axes with units, linear or logarithmic, that is pointed at: by a click, a finger, the arrow keys.

import { prefixed, prefixPower } from "./quantity.js";

const TICKS = 6;

/** Round numbers between two values; of a logarithmic axis 1, 2, 5 in each decade. */
export function ticksOf([low, high], log) {
  const found = [];
  if (log) {
    for (let decade = Math.floor(Math.log10(low)); decade <= Math.log10(high); decade++) {
      for (const lead of [1, 2, 5]) found.push(lead * 10 ** decade);
    }
  } else {
    const rough = (high - low) / TICKS, power = 10 ** Math.floor(Math.log10(rough));
    const step = power * [1, 2, 5, 10].find((lead) => lead * power >= rough);
    for (let i = Math.ceil(low / step - 1e-9); i * step <= high * (1 + 1e-9); i++) found.push(i * step);
  }
  return found.filter((one) => one >= low - 1e-9 * (high - low) && one <= high * (1 + 1e-9) || one === 0);
}

/**
 * x, y: { label, unit, log }; `draw(context, to, css)` draws inside, `to.x(value)` and `to.y(value)` are pixels.
 * `pick(x, y, to)` is told where somebody points, `step(dx, dy)` of an arrow key.
 */
export function makePicture(element, { label, x, y, draw, pick, step }) {
  const root = document.createElement("div");
  const canvas = document.createElement("canvas");
  root.className = "picture";
  root.tabIndex = 0;
  root.setAttribute("role", "group");
  root.setAttribute("aria-label", `${label}: arrows move the cursor`);
  root.append(canvas);
  element.append(root);
  const css = (name) => getComputedStyle(root).getPropertyValue(name).trim();
  let range = { x: [1, 2], y: [0, 1] };
  let to = null;

  function scales(width, height, em) {
    const box = { left: 4.2 * em, right: width - em, top: 0.6 * em, bottom: height - 3 * em };
    const share = ([low, high], log, value) => (log ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low));
    const back = ([low, high], log, part) => (log ? low * (high / low) ** part : low + part * (high - low));
    return {
      ...box,
      x: (value) => box.left + share(range.x, x.log, value) * (box.right - box.left),
      y: (value) => box.bottom - share(range.y, y.log, value) * (box.bottom - box.top),
      fromX: (px) => back(range.x, x.log, (px - box.left) / (box.right - box.left)),
      fromY: (py) => back(range.y, y.log, (box.bottom - py) / (box.bottom - box.top)),
    };
  }
  function paint() {
    const { clientWidth: width, clientHeight: height } = root;
    if (width < 60 || height < 60) return;
    const scale = devicePixelRatio, em = parseFloat(getComputedStyle(root).fontSize);
    Object.assign(canvas, { width: width * scale, height: height * scale });
    const context = canvas.getContext("2d");
    context.scale(scale, scale);
    to = scales(width, height, em);
    context.save();
    context.beginPath();
    context.rect(to.left, to.top, to.right - to.left, to.bottom - to.top);
    context.clip();
    draw(context, to, css);
    context.restore();
    context.strokeStyle = css("--line");
    context.strokeRect(to.left, to.top, to.right - to.left, to.bottom - to.top);
    context.font = `${0.85 * em}px ${getComputedStyle(root).fontFamily}`;
    context.fillStyle = css("--axis");
    const text = (axis, [low, high]) => {
      const power = axis.log ? 0 : prefixPower(Math.max(Math.abs(low), Math.abs(high)), axis.unit);
      return { power, said: `${axis.label} [${prefixed(power, axis.unit)}]`, of: (value) => String(Number((value / 10 ** power).toPrecision(3))) };
    };
    const across = text(x, range.x), up = text(y, range.y);
    context.textAlign = "center";
    let last = -Infinity;
    for (const one of ticksOf(range.x, x.log)) {
      if (to.x(one) - last < 2.6 * em) continue;
      last = to.x(one);
      context.fillText(across.of(one), last, to.bottom + 1.1 * em);
    }
    context.fillText(across.said, (to.left + to.right) / 2, to.bottom + 2.5 * em);
    context.textAlign = "right";
    for (const one of ticksOf(range.y, y.log)) context.fillText(up.of(one), to.left - 0.4 * em, to.y(one) + 0.3 * em);
    context.save();
    context.translate(0.95 * em, (to.top + to.bottom) / 2);
    context.rotate(-Math.PI / 2);
    context.textAlign = "center";
    context.fillText(up.said, 0, 0);
    context.restore();
  }
  let waiting = 0;
  const redraw = () => (waiting ||= requestAnimationFrame(() => { waiting = 0; paint(); }));

  function pointed(event) {
    if (!to || (event.type === "pointermove" && !(event.buttons & 1 && event.pointerType === "mouse"))) return;
    const box = canvas.getBoundingClientRect();
    pick(event.clientX - box.left, event.clientY - box.top, to);
  }
  for (const kind of ["pointerdown", "pointermove"]) canvas.addEventListener(kind, pointed);
  const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
  root.addEventListener("keydown", (event) => {
    if (!(event.key in ARROWS) || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    step(...ARROWS[event.key]);
  });
  const observer = new ResizeObserver(redraw);
  observer.observe(root);
  window.addEventListener("themechange", redraw);
  return {
    element: root,
    redraw,
    setRange(next) { range = next; redraw(); },
    destroy() {
      cancelAnimationFrame(waiting);
      observer.disconnect();
      window.removeEventListener("themechange", redraw);
      root.remove();
    },
  };
}
