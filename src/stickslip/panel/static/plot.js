// Plots over a shared axis: zoom, pan, two cursors with their differences, freeze, SI prefixes, light and dark.
// No page of the panel is needed: notebooks use this module too.

import uPlot from "./vendor/uplot.js";
import { attachGestures } from "./gestures.js";
import { makeMarks, valueAt } from "./marks.js";
import { saveTools } from "./plot_export.js";
import { formatQuantity, prefixed, prefixPower } from "./quantity.js";

/** Tables [x, y, ...] over different x as one, with gaps that the lines cross. */
export const joined = (tables) => uPlot.join(tables.map((table) => table.map((one) => Array.from(one))));

const DASHES = [[], [8, 4], [2, 3], [10, 3, 2, 3]];
let plots = 0;

/**
 * A plot in an element; it fills it.
 *
 * series: [{ label, unit, color, strip, dash, width }]; color is a CSS colour or a variable's name ("--series-2"),
 *   left out: the next of the palette. Series of one `strip` (left out: of one unit) share a vertical axis; strips
 *   stand below each other over the same horizontal axis.
 * time: { label, unit, log } of that axis.
 * xy: the curves need not run from left to right; setData then takes [x1, y1, x2, y2, ...].
 * tools: buttons for autoscale, freeze and cursors; "save": only those that save. empty: what is said while there is nothing to draw.
 */
export function makePlot(element, { series, time = { label: "time", unit: "s" }, xy = false, tools = true, label = "Plot", empty = "" }) {
  const root = document.createElement("div");
  root.className = "plot";
  root.tabIndex = 0;
  root.setAttribute("role", "group");
  root.setAttribute("aria-label", `${label}: plus and minus zoom, arrows pan, 0 shows everything, A and B set cursors`);
  element.append(root); // before the strips: their fonts and colours are those of the page
  const stripsBox = document.createElement("div");
  stripsBox.className = "plot-strips";
  const key = uPlot.sync(`stickslip-${++plots}`).key;
  const drawn = series.map((one, i) => ({ ...one, index: i, color: one.color || `--series-${(i % 6) + 1}`, dash: one.dash ?? DASHES[Math.floor(i / 6) % 4] }));

  let data = drawn.map(() => []);
  let x = [];
  let held = null; // what came while frozen
  let heldExtent;
  let frozen = false;
  let view = null; // [from, to], or null: everything
  let extent = null; // what "everything" is at least
  let present = []; // values that legends show where no cursor is
  const viewers = new Set();

  const everything = () => {
    if (extent) return extent;
    let from = Infinity, to = -Infinity;
    const columns = xy ? data.map((one) => one[0] ?? []) : [x];
    for (const column of columns) {
      if (!column.length) continue;
      if (!xy) { from = Math.min(from, column[0]); to = Math.max(to, column[column.length - 1]); continue; }
      for (const value of column) { if (value < from) from = value; if (value > to) to = value; }
    }
    if (!(to > from) && time.log) return from > 0 && Number.isFinite(from) ? [from / 2, from * 2] : [1, 10];
    if (!(to > from)) return Number.isFinite(from) ? [from - 0.5, from + 0.5] : [0, 1];
    const margin = xy && !time.log ? 0.04 * (to - from) : 0;
    return [from - margin, to + margin];
  };
  const shownRange = () => view ?? everything();

  // --- strips
  const css = (name) => (name.startsWith("--") ? getComputedStyle(root).getPropertyValue(name).trim() : name);
  const names = [...new Set(drawn.map((one) => one.strip ?? one.unit))];
  const strips = names.map((name, i) => makeStrip(drawn.filter((one) => (one.strip ?? one.unit) === name), i === names.length - 1));

  function axisValues(unit, scale) {
    return (u, splits) => {
      const exponent = prefixPower(Math.max(...splits.map(Math.abs)), unit);
      const step = splits.length > 1 ? Math.abs(splits[1] - splits[0]) / 10 ** exponent : 1;
      const digits = Math.min(Math.max(Math.ceil(-Math.log10(step) - 1e-6), 0), 6);
      if (time.log && u.scales[scale].distr === 3) return splits.map((value) => (value === null ? "" : String(Number((value / 10 ** exponent).toPrecision(3)))));
      return splits.map((value) => trimmed(value / 10 ** exponent, step, digits));
    };
  }
  function axisLabel(unit, scale, text) {
    return (u) => {
      const { min, max } = u.scales[scale];
      const shown = prefixed(prefixPower(Math.max(Math.abs(min ?? 0), Math.abs(max ?? 1)), unit), unit);
      return text ? `${text}${shown ? ` [${shown}]` : ""}` : shown && `[${shown}]`;
    };
  }

  function makeStrip(members, last) {
    const box = document.createElement("div");
    box.className = "plot-strip";
    const head = document.createElement("div");
    head.className = "plot-head";
    const canvas = document.createElement("div");
    canvas.className = "plot-canvas";
    box.append(head, canvas);
    stripsBox.append(box);
    const outputs = members.map((one) => {
      const item = document.createElement("span");
      item.className = "plot-key";
      item.innerHTML = '<svg viewBox="0 0 22 8" aria-hidden="true"><line x1="0" y1="4" x2="22" y2="4" stroke-width="3"/></svg><span></span><output aria-live="off"></output>';
      item.children[1].textContent = one.label;
      head.append(item);
      return item;
    });
    const strip = { members, box, canvas, outputs, yView: null, plot: null };
    const { fontSize, fontFamily } = getComputedStyle(root);
    const em = parseFloat(fontSize);
    const font = `${Math.round(em * 0.85)}px ${fontFamily}`;
    const unit = members[0].unit;
    const axis = (scale, of, text) => ({
      scale, stroke: () => css("--axis"), grid: { stroke: () => css("--grid"), width: 1 }, ticks: { stroke: () => css("--grid"), width: 1, size: 5 },
      font, labelFont: font, values: axisValues(of, scale), label: axisLabel(of, scale, text), labelSize: 1.35 * em, labelGap: 0,
    });
    const options = {
      mode: xy ? 2 : 1,
      width: 300, height: 150, padding: [0.55 * em, em, last ? 0 : 4, 0],
      legend: { show: false },
      cursor: {
        sync: xy ? undefined : { key, setSeries: false, scales: ["x", null] },
        drag: { x: true, y: true, uni: 40, setScale: false },
        points: { show: !xy, size: 7 },
        bind: { dblclick: () => () => (autoscale(), null) },
      },
      scales: {
        x: { time: false, auto: false, distr: time.log ? 3 : 1, range: () => shownRange() },
        y: { range: (u, min, max) => strip.yView ?? padded(min, max) },
      },
      axes: [
        { ...axis("x", time.unit, last ? time.label : ""), space: 3.4 * em, ...(time.log ? { splits: logSplits } : {}), size: last ? 1.9 * em : 6, ...(last ? {} : { values: () => [], label: undefined, labelSize: 0 }) },
        { ...axis("y", unit, ""), space: 1.7 * em, size: 4 * em },
      ],
      series: [xy ? null : {}, ...members.map((one) => ({
        stroke: () => css(one.color), width: one.width ?? em / 7.5, dash: one.dash, spanGaps: true, points: { show: false },
        ...(xy ? { facets: [{ scale: "x", auto: false }, { scale: "y", auto: true }], paths: curve } : {}),
      }))],
      hooks: { setSelect: [(u) => selected(u, strip)], setCursor: [() => showValues(strip)] },
    };
    strip.plot = new uPlot(options, xy ? [null, ...members.map(() => [[], []])] : [[], ...members.map(() => [])], canvas);
    return strip;
  }

  function curve(u, index) {
    const [xs, ys] = u.data[index];
    const stroke = new Path2D();
    for (let i = 0; i < xs.length; i++) {
      const px = u.valToPos(xs[i], "x", true), py = u.valToPos(ys[i], "y", true);
      if (i) stroke.lineTo(px, py); else stroke.moveTo(px, py);
    }
    return { stroke, fill: null, clip: null };
  }

  function selected(u, strip) {
    const { left, top, width, height } = u.select;
    if (width < 4 && height < 4) return;
    if (width > 4 && width < u.over.clientWidth) view = [u.posToVal(left, "x"), u.posToVal(left + width, "x")];
    if (height > 4 && height < u.over.clientHeight) strip.yView = [u.posToVal(top + height, "y"), u.posToVal(top, "y")];
    u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    changed();
  }

  function showValues(strip) {
    const idx = xy ? null : strip.plot.cursor.idx;
    strip.members.forEach((one, i) => {
      const column = xy ? data[one.index]?.[1] : data[one.index];
      const value = idx == null && present[one.index] != null ? present[one.index] : valueAt(column, idx ?? (column?.length ?? 0) - 1);
      strip.outputs[i].children[2].textContent = xy ? "" : formatQuantity(value, one.unit);
    });
  }

  // --- drawing
  function draw() {
    const [from, to] = shownRange();
    nothing.hidden = !empty || data.some((one) => one.length && (!xy || one[0].length));
    for (const strip of strips) {
      const rows = strip.members.map((one) => data[one.index] ?? []);
      strip.plot.batch(() => {
        strip.plot.setData(xy ? [null, ...rows.map((row) => (row.length ? row : [[], []]))] : [x, ...rows], false);
        strip.plot.setScale("x", { min: from, max: to });
      });
      showValues(strip);
    }
    marks.place();
  }
  let waiting = 0;
  const later = () => (waiting ||= requestAnimationFrame(() => { waiting = 0; draw(); }));
  function changed() {
    for (const act of viewers) act(view);
    later();
  }
  function autoscale() {
    view = null;
    for (const strip of strips) strip.yView = null;
    changed();
  }
  function setView(range) {
    view = range && range[1] > range[0] ? [...range] : null;
    if (view && time.log) view[0] = Math.max(view[0], 1e-6 * view[1]);
    changed();
  }
  /** Zoom by a factor about a place (0 left to 1 right), or pan by a part of the width. */
  function zoom(factor, at = 0.5) {
    const [from, to] = shownRange();
    const middle = from + at * (to - from), least = 1e-9 * Math.max(Math.abs(from), Math.abs(to), 1e-9);
    if (factor < 1 && (to - from) * factor < least) return;
    setView([middle - (middle - from) * factor, middle + (to - middle) * factor]);
  }
  function pan(part) {
    const [from, to] = shownRange();
    setView([from + part * (to - from), to + part * (to - from)]);
  }
  function freeze(on) {
    frozen = on;
    buttons.freeze?.setAttribute("aria-pressed", String(on));
    if (on) return;
    if (heldExtent !== undefined) extent = heldExtent;
    if (held) take(held);
    held = null;
    heldExtent = undefined;
  }
  function take(arrays) {
    if (xy) data = drawn.map((_, i) => [arrays[2 * i] ?? [], arrays[2 * i + 1] ?? []]);
    else [x, ...data] = arrays;
    later();
  }

  // --- tools
  const marks = makeMarks({ root, strips, drawn, time, values: () => ({ x, data }), range: shownRange, enabled: !xy });
  const buttons = {};
  if (tools) {
    const bar = document.createElement("div");
    bar.className = "plot-tools";
    const add = (name, text, title, act, pressed) => {
      const button = document.createElement("button");
      Object.assign(button, { type: "button", className: "small quiet", textContent: text, title });
      if (pressed) button.setAttribute("aria-pressed", "false");
      button.onclick = act;
      bar.append(button);
      buttons[name] = button;
    };
    const all = tools !== "save";
    if (all) add("autoscale", "Autoscale", "Show everything (0, or a double click)", autoscale);
    if (all) add("in", "+", "Zoom in (+, or drag a rectangle)", () => zoom(0.5));
    if (all) add("out", "−", "Zoom out (-)", () => zoom(2));
    if (all) add("freeze", "Freeze", "Hold the picture; the recording goes on (F)", () => freeze(!frozen), true);
    if (all && !xy) {
      add("cursors", "Cursors", "Two cursors and their differences (A, B)", () => buttons.cursors.setAttribute("aria-pressed", String(marks.toggle())), true);
      buttons.cursors.setAttribute("aria-pressed", "false");
    }
    saveTools(bar, label, () => ({ strips, drawn, x, data, xy, time, css, range: shownRange() }));
    root.append(bar);
  }
  const nothing = document.createElement("p");
  Object.assign(nothing, { className: "plot-empty soft", textContent: empty, hidden: true });
  root.append(stripsBox, nothing, marks.table);
  root.addEventListener("keydown", (event) => {
    if (event.target !== root || event.ctrlKey || event.metaKey || event.altKey) return;
    const acts = {
      "+": () => zoom(0.5), "=": () => zoom(0.5), "-": () => zoom(2), ArrowLeft: () => pan(-0.1), ArrowRight: () => pan(0.1),
      0: autoscale, f: () => freeze(!frozen), a: () => marks.set("A", strips[0].plot), b: () => marks.set("B", strips[0].plot),
    };
    const act = acts[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!act) return;
    act();
    if ("ab".includes(event.key.toLowerCase())) buttons.cursors?.setAttribute("aria-pressed", "true");
    event.preventDefault();
  });
  const detach = strips.map((strip) => attachGestures(strip.plot.over, root, { zoom, pan, autoscale }));

  const fit = () => {
    for (const strip of strips) {
      const { clientWidth: width, clientHeight: height } = strip.canvas;
      if (width > 40 && height > 30) strip.plot.setSize({ width, height });
    }
    marks.place();
  };
  const observer = new ResizeObserver(fit);
  for (const strip of strips) observer.observe(strip.canvas);
  const colour = () => {
    for (const strip of strips) {
      strip.members.forEach((one, i) => {
        const line = strip.outputs[i].querySelector("line");
        line.style.stroke = css(one.color);
        line.style.strokeDasharray = one.dash.join(" ");
      });
      strip.plot.redraw(false, true);
    }
  };
  window.addEventListener("themechange", colour);
  requestAnimationFrame(() => { fit(); colour(); later(); });

  return {
    element: root,
    /** [x, y of the first series, ...], numbers in SI; while frozen they wait. */
    setData(arrays) {
      if (frozen) held = arrays;
      else take(arrays);
    },
    /** The range of the horizontal axis that is shown at least, or null: that of the data. */
    setExtent(range) {
      if (frozen) heldExtent = range;
      else { extent = range; later(); }
    },
    /** What legends show of each series while no cursor is over the plot; null: its last point. */
    setPresent(values) { if (!frozen) present = values; },
    /** Other curves come: the vertical axes follow them, and what cursors had read is forgotten. */
    follow() {
      if (frozen) return;
      for (const strip of strips) strip.yView = null;
      marks.forget();
    },
    setCursors(at) {
      Object.assign(marks.at, at);
      buttons.cursors?.setAttribute("aria-pressed", String(marks.at.A !== null || marks.at.B !== null));
    },
    setView, zoom, pan, autoscale, freeze,
    get view() { return view; },
    get range() { return shownRange(); },
    get frozen() { return frozen; },
    /** Width of the drawing in device pixels: how many points are worth having. */
    get pixels() { return Math.round((strips[0].plot.over.clientWidth || 800) * devicePixelRatio); },
    /** Call with [from, to] or null when the view changes; returns what ends it. */
    onView(act) { viewers.add(act); return () => viewers.delete(act); },
    marks,
    destroy() {
      cancelAnimationFrame(waiting);
      observer.disconnect();
      window.removeEventListener("themechange", colour);
      detach.forEach((end) => end());
      strips.forEach((strip) => strip.plot.destroy());
      root.remove();
    },
  };
}

/** Places of a logarithmic axis; uPlot's own have no end where it begins far below 1. */
function logSplits(u, axis, min, max) {
  const found = [];
  for (let power = Math.floor(Math.log10(min)); 10 ** power <= max; power++) {
    for (let digit = 1; digit < 10; digit++) found.push(Number(`${digit}e${power}`));
  }
  return found.filter((one) => one >= min && one <= max);
}

function padded(min, max) {
  if (min === null || max === null || !Number.isFinite(min) || !Number.isFinite(max)) return [0, 1];
  const span = max - min || Math.abs(max) * 0.2 || 1e-9;
  return [min - 0.08 * span, max + 0.08 * span];
}

function trimmed(value, step, digits) {
  const exact = Math.abs(step * 10 ** digits - Math.round(step * 10 ** digits)) < 1e-6 ? digits : digits + 1;
  return Number(value.toFixed(exact)).toFixed(exact);
}
