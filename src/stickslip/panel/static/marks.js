// Two cursors on a plot, moved by mouse, finger or arrow keys, and the table of their values and differences.

import { formatQuantity } from "./quantity.js";

/** The value at an index, or the nearest one that is there. */
export function valueAt(column, index) {
  if (!column?.length || index < 0) return null;
  for (let away = 0; away < column.length; away++) {
    const found = column[index - away] ?? column[index + away];
    if (found !== null && found !== undefined) return found;
  }
  return null;
}

export function makeMarks({ root, strips, drawn, time, values, range, enabled }) {
  const at = { A: null, B: null };
  let read = {}; // what a cursor read while its samples were there: a zoom elsewhere has only those of its window
  const table = document.createElement("table");
  table.className = "plot-cursors";
  table.hidden = true;
  const lines = { A: [], B: [] };

  function line(name, strip, first) {
    const mark = document.createElement("div");
    mark.className = "plot-mark";
    mark.hidden = true;
    if (first) {
      mark.innerHTML = `<span>${name}</span>`;
      mark.tabIndex = 0;
      mark.setAttribute("role", "slider");
      mark.setAttribute("aria-label", `Cursor ${name}`);
      mark.addEventListener("keydown", (event) => {
        const sign = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
        if (!sign) return;
        const [from, to] = range();
        at[name] += sign * (to - from) * (event.shiftKey ? 0.05 : 0.002);
        event.preventDefault();
        event.stopPropagation();
        place();
      });
    }
    mark.addEventListener("mousedown", (event) => event.stopPropagation());
    mark.addEventListener("pointerdown", (event) => {
      event.stopPropagation();
      mark.setPointerCapture(event.pointerId);
      mark.onpointermove = (moved) => {
        const box = strip.plot.over.getBoundingClientRect();
        at[name] = strip.plot.posToVal(Math.min(Math.max(moved.clientX - box.left, 0), box.width), "x");
        place();
      };
      mark.onpointerup = mark.onpointercancel = () => (mark.onpointermove = null);
    });
    strip.plot.over.append(mark);
    return mark;
  }
  if (enabled) {
    for (const name of ["A", "B"]) lines[name] = strips.map((strip, i) => line(name, strip, i === 0));
  }

  /** The sample nearest to a time. */
  function nearest(x, t) {
    let low = 0, high = x.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (x[middle] > t) high = middle; else low = middle;
    }
    return Math.abs(x[low] - t) <= Math.abs((x[high] ?? Infinity) - t) ? low : high;
  }

  function place() {
    const [from, to] = range();
    for (const name of ["A", "B"]) {
      lines[name].forEach((mark, i) => {
        mark.hidden = at[name] === null || at[name] < from || at[name] > to;
        if (mark.hidden) return;
        mark.style.left = `${strips[i].plot.valToPos(at[name], "x")}px`;
        if (i === 0) {
          mark.setAttribute("aria-valuenow", String(at[name]));
          mark.setAttribute("aria-valuetext", formatQuantity(at[name], time.unit, 6));
        }
      });
    }
    table.hidden = at.A === null && at.B === null;
    if (!table.hidden) fill();
  }

  function fill() {
    const { x, data } = values();
    // Beyond the samples there is nothing to read, half a pixel aside.
    const [from, to] = range(), near = (to - from) / 2000;
    const within = (t) => t !== null && x.length && t >= x[0] - near && t <= x[x.length - 1] + near;
    const index = { A: within(at.A) ? nearest(x, at.A) : null, B: within(at.B) ? nearest(x, at.B) : null };
    const rows = [[time.label, at.A, at.B, time.unit]];
    const valuesOf = (name) => {
      if (index[name] !== null) read[name] = { t: at[name], values: drawn.map((one) => valueAt(data[one.index], index[name])) };
      return read[name]?.t === at[name] ? read[name].values : [];
    };
    const [a, b] = [valuesOf("A"), valuesOf("B")];
    drawn.forEach((one, i) => rows.push([one.label, a[i] ?? null, b[i] ?? null, one.unit]));
    const cell = (tag, text) => {
      const made = document.createElement(tag);
      made.textContent = text;
      if (tag === "td") made.className = "number";
      return made;
    };
    const head = document.createElement("tr");
    for (const text of ["", "A", "B", "B − A"]) head.append(cell(text ? "th" : "td", text));
    for (const th of [...head.children].slice(1)) th.className = "number";
    table.replaceChildren(head, ...rows.map(([label, a, b, unit], i) => {
      const row = document.createElement("tr");
      const difference = a === null || b === null ? null : b - a;
      const shown = formatQuantity(difference, unit, 5);
      const rate = i === 0 && unit === "s" && difference ? ` (${formatQuantity(1 / Math.abs(difference), "Hz")})` : "";
      row.append(cell("th", label), cell("td", formatQuantity(a, unit, 5)), cell("td", formatQuantity(b, unit, 5)), cell("td", shown + rate));
      return row;
    }));
  }

  return {
    table,
    place,
    at,
    forget() { read = {}; },
    /** Set a cursor where the mouse is, else to a third of the view. */
    set(name, plot) {
      const [from, to] = range();
      const left = plot?.cursor.left;
      at[name] = left >= 0 ? plot.posToVal(left, "x") : from + (to - from) * (name === "A" ? 1 / 3 : 2 / 3);
      place();
    },
    /** Show or hide both; whether they are shown. */
    toggle() {
      const on = at.A === null && at.B === null;
      const [from, to] = range();
      at.A = on ? from + (to - from) / 3 : null;
      at.B = on ? from + (2 * (to - from)) / 3 : null;
      place();
      return on;
    },
  };
}
