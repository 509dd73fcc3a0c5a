// The two pictures of the Design page: the map of the step with its cursor, and the front of drives.

import { makePicture } from "./picture.js";

export const SHADES = 64;

/** Colours from nothing to the most, of "#rrggbb" stops. */
export function palette(stops) {
  const parts = stops.map((one) => [1, 3, 5].map((i) => parseInt(one.slice(i, i + 2), 16)));
  return Array.from({ length: SHADES }, (_, i) => {
    const at = (i / (SHADES - 1)) * (parts.length - 1), k = Math.min(Math.floor(at), parts.length - 2);
    return `rgb(${parts[k].map((one, c) => Math.round(one + (at - k) * (parts[k + 1][c] - one))).join(" ")})`;
  });
}

/** Halfway between neighbours, and as far beyond the ends: where the cells of a grid meet. */
function edges(values, log) {
  const of = log ? Math.log : (one) => one, back = log ? Math.exp : (one) => one;
  const at = Array.from(values, of);
  const inner = at.slice(1).map((one, i) => (one + at[i]) / 2);
  return [2 * at[0] - inner[0], ...inner, 2 * at.at(-1) - inner.at(-1)].map(back);
}

/** The map: `setData({ voltage, frequency, net_step, status })`; `moved(voltage, frequency, step, pointed)` says
 * where the cursor is, and whether somebody moved it. */
export function makeMap(element, { moved }) {
  let data = null, cells = null, cursor = { volts: 0.65, hertz: 0 }, at = [0, 0];
  const picture = makePicture(element, {
    label: "Map of the step over frequency and voltage",
    x: { label: "frequency", unit: "Hz", log: true }, y: { label: "voltage", unit: "V" },
    draw(context, to, css) {
      if (!data) return;
      const most = Math.max(...Array.from(data.net_step, (one) => (Number.isFinite(one) ? Math.abs(one) : 0))) || 1;
      const forward = palette([css("--sunk"), css("--series-1"), css("--text")]);
      const back = palette([css("--sunk"), css("--series-2"), css("--text")]);
      const wide = data.frequency.length;
      data.net_step.forEach((value, i) => {
        const [row, column] = [Math.floor(i / wide), i % wide];
        const left = to.x(cells.x[column]), top = to.y(cells.y[row + 1]);
        const [width, height] = [to.x(cells.x[column + 1]) - left, to.y(cells.y[row]) - top];
        const there = data.status[i] === 0 && Number.isFinite(value);
        context.fillStyle = there ? (value < 0 ? back : forward)[Math.round((Math.abs(value) / most) * 0.85 * (SHADES - 1))] : css("--panel");
        context.fillRect(left, top, width + 0.5, height + 0.5);
        if (there) return;
        context.strokeStyle = css("--soft");
        context.beginPath();
        context.moveTo(left, top + height);
        context.lineTo(left + width, top);
        context.stroke();
      });
      const [px, py] = [to.x(data.frequency[at[1]]), to.y(data.voltage[at[0]])];
      for (const [width, colour] of [[4, "--panel"], [1.5, "--text"]]) {
        Object.assign(context, { lineWidth: width, strokeStyle: css(colour) });
        context.beginPath();
        context.moveTo(to.left, py); context.lineTo(to.right, py);
        context.moveTo(px, to.top); context.lineTo(px, to.bottom);
        context.stroke();
      }
      context.lineWidth = 1;
    },
    pick: (px, py, to) => set(nearest(data.voltage, to.fromY(py), false), nearest(data.frequency, to.fromX(px), true)),
    step: (dx, dy) => data && set(at[0] + dy, at[1] + dx),
  });
  const nearest = (values, wanted, log) => {
    const off = Array.from(values, (one) => Math.abs(log ? Math.log(one / wanted) : one - wanted));
    return off.indexOf(Math.min(...off));
  };
  function set(row, column) {
    const within = (one, values) => Math.min(Math.max(one, 0), values.length - 1);
    at = [within(row, data.voltage), within(column, data.frequency)];
    cursor = { volts: data.voltage[at[0]] / data.voltage.at(-1), hertz: data.frequency[at[1]] };
    tell(true);
  }
  function tell(pointed) {
    picture.redraw();
    moved(data.voltage[at[0]], data.frequency[at[1]], data.net_step[at[0] * data.frequency.length + at[1]], pointed);
  }
  return {
    element: picture.element,
    /** The cursor stays at its frequency, and at its share of the greatest voltage. */
    setData(next) {
      data = next;
      cells = { x: edges(data.frequency, true), y: edges(data.voltage, false) };
      at = [nearest(data.voltage, cursor.volts * data.voltage.at(-1), false), nearest(data.frequency, cursor.hertz || data.frequency[0], true)];
      picture.setRange({ x: [cells.x[0], cells.x.at(-1)], y: [cells.y[0], cells.y.at(-1)] });
      tell(false);
    },
    destroy: picture.destroy,
  };
}

/** The front: `setData({ speed, speed_unit, other, label, unit })`; `chosen(i)` of its points. */
export function makeFront(element, { chosen }) {
  let data = null, at = -1;
  const speed = { label: "speed in the worst condition", unit: "" }, axis = { label: "", unit: "" };
  const picture = makePicture(element, {
    label: "Front of drives, speed against what it costs",
    x: speed, y: axis,
    draw(context, to, css) {
      if (!data) return;
      const dot = (i, radius, colour) => {
        context.fillStyle = css(colour);
        context.beginPath();
        context.arc(to.x(data.speed[i]), to.y(data.other[i]), radius, 0, 2 * Math.PI);
        context.fill();
      };
      data.speed.forEach((_, i) => dot(i, 4, "--series-1"));
      if (at >= 0) { dot(at, 9, "--text"); dot(at, 6, "--series-2"); }
    },
    pick(px, py, to) {
      if (!data) return;
      const far = data.speed.map((one, i) => Math.hypot(to.x(one) - px, to.y(data.other[i]) - py));
      choose(far.indexOf(Math.min(...far)));
    },
    step: (dx, dy) => data && choose(Math.min(Math.max(at + dx + dy, 0), data.speed.length - 1)),
  });
  function choose(i) {
    at = i;
    picture.redraw();
    chosen(i);
  }
  return {
    element: picture.element,
    setData(next) {
      data = next;
      at = -1;
      speed.unit = next.speed_unit;
      Object.assign(axis, { label: next.label, unit: next.unit });
      const wide = (values) => [Math.min(0, ...values), 1.05 * Math.max(...values)];
      picture.setRange({ x: wide(next.speed), y: wide(next.other) });
    },
    destroy: picture.destroy,
  };
}
