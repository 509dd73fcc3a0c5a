// The instruments of the Bench page: plotter, display, input; each is { element, update(), destroy() }.

import { h } from "./dom.js";
import { shortName, showRecording } from "./livedata.js";
import { joined, makePlot } from "./plot.js";
import { formatQuantity, makeQuantity } from "./quantity.js";

/** What a name is bound to: a channel, the position, or a variable of the experiment. */
export function bound(bench, name) {
  const { channels, rig, variables } = bench.experiment;
  const channel = channels.find((one) => one.name === name);
  if (channel) return { ...channel, kind: "channel", value: () => bench.live.latest(name) };
  if (name === "position") return { name, unit: rig.unit, label: "position from home", kind: "channel", value: () => bench.run.position };
  const variable = variables.find((one) => one.name === name);
  if (variable) return { ...variable, kind: "variable", value: () => bench.experiment.variables.find((one) => one.name === name)?.value };
  return { name, unit: "", label: `${name} (is gone)`, kind: "gone", value: () => undefined };
}

export function makeInstrument(bench, spec) {
  return { plotter, display, input }[spec.kind](bench, spec);
}

function display(bench, spec) {
  const parts = spec.variables.map((name) => {
    const to = bound(bench, name);
    const value = h("output", { class: "reading number", "aria-live": "off" });
    const when = h("span", { class: "when" });
    const title = h("span", {}, spec.variables.length === 1 && spec.title ? spec.title : to.label);
    return { to, value, when, element: h("div", { class: "display" }, h("span", { class: "soft" }, title, when), value) };
  });
  const element = h("div", { class: "displays" }, ...parts.map((part) => part.element));
  const update = () => {
    parts.forEach(({ to, value }) => (value.textContent = formatQuantity(to.value(), to.unit)));
    // Nothing is measured once the output ramps down: what is shown is older than that. Where a whole run ended, is known.
    const old = bench.live.data.filled > 0 ? { stopped: " at stop", failed: " at end", done: " at end" }[bench.run.phase] ?? "" : "";
    parts.forEach(({ to, when }) => (when.textContent = to.name !== "position" ? old : bench.run.before_ramp ? " before the ramp" : ""));
    element.classList.toggle("stale", Boolean(old) && parts.some(({ to }) => to.name !== "position"));
  };
  const off = bench.live.listen(update);
  update();
  return { element, update, destroy: off };
}

function input(bench, spec) {
  const fields = spec.variables.map((name) => {
    const to = bound(bench, name);
    if (to.kind !== "variable") return { to, field: { element: h("div", { class: "soft" }, `${to.label}: cannot be set`), set() {} } };
    return { to, field: variableField(bench, { ...to, value: to.value() }) };
  });
  const update = () => fields.forEach(({ to, field }) => field.set(to.value()));
  return { element: titled(spec, h("div", { class: "inputs" }, ...fields.map(({ field }) => field.element))), update, destroy() {} };
}

const titled = (spec, content) => (spec.title ? h("div", { class: "titled" }, h("h2", { class: "soft" }, spec.title), content) : content);

/** A field for a variable of the experiment; the server checks the whole experiment with the new value. */
export function variableField(bench, variable, label = variable.label) {
  return makeQuantity({
    label, unit: variable.unit, value: variable.value, app: bench.app, hint: variable.unit ? `in ${variable.unit}` : "",
    change: (value, text) => bench.set(variable.path, variable.unit ? withUnit(text, value, variable.unit) : value),
  });
}

const withUnit = (text, value, unit) => (/[A-Za-zµμΩ°%]\s*$/.test(text) && !/^[-+.\d]*e[-+]?\d+$/i.test(text) ? text : `${value} ${unit}`);

function plotter(bench, spec) {
  const box = h("div", { class: "plotter" });
  let plot = null;
  let offView = () => {};
  let made = "";
  let asked = 0;
  let busy = false;
  let again = false;

  /** A channel has one colour, in whichever plotter it is. */
  const colour = (name, v) => {
    const { channels } = bench.experiment, at = channels.findIndex((one) => one.name === name);
    return at < 0 ? channels.length + v : at;
  };
  /** Sources: the live run and the recordings that are shown; more than one are told apart by colour. */
  const sources = () => [...(bench.shown.live ? ["live"] : []), ...bench.shown.recordings];
  function build() {
    const from = sources();
    const key = JSON.stringify([from, spec.variables, bench.experiment.channels]);
    if (key === made) return;
    made = key;
    offView();
    const view = plot?.view ?? null, cursors = { ...plot?.marks.at };
    plot?.destroy();
    const several = from.length > 1;
    const series = from.flatMap((source, s) => spec.variables.map((name, v) => {
      const to = bound(bench, name);
      const label = several ? `${to.label} · ${source === "live" ? "this run" : shortName(source)}` : to.label;
      return { label, unit: to.unit, strip: name, color: `--series-${((several ? s : colour(name, v)) % 6) + 1}`, dash: several && s ? [[9, 4], [3, 3], [12, 3, 3, 3]][(s - 1) % 3] : [] };
    }));
    plot = makePlot(box, { series, label: spec.title || "Plotter", empty: "Press Start: the run is drawn here as it goes on. Recordings that are ticked are drawn here too." });
    offView = plot.onView(() => later());
    if (view) plot.setView(view);
    plot.setCursors(cursors);
  }
  async function columns(source, view) {
    if (source !== "live") {
      const { header, x, columns: found } = await showRecording(bench.app, source, view, 2 * plot.pixels);
      const at = spec.variables.map((name) => header.columns.findIndex((one) => one.name === name));
      ends.set(source, at.map((i) => header.latest[i]));
      return [x, ...at.map((i) => found[i] ?? new Float32Array(x.length))];
    }
    const { header } = bench.live.data;
    return !header || !view || header.bucket === 1 ? bench.live.whole(spec.variables) : bench.live.window(spec.variables, view, 2 * plot.pixels);
  }
  /** What the legend says of the live run is what the tiles say; of a recording, its last sample. */
  const ends = new Map();
  const present = (from) => from.flatMap((source) => spec.variables.map((name, v) => (source === "live" ? bench.live.latest(name) : ends.get(source)?.[v])));
  async function refresh() {
    if (busy) { again = true; return; }
    busy = true;
    build();
    const mine = ++asked;
    try {
      const from = sources();
      const view = plot.view && [plot.view[0] - 0.05 * (plot.view[1] - plot.view[0]), plot.view[1] + 0.05 * (plot.view[1] - plot.view[0])];
      const tables = await Promise.all(from.map((source) => columns(source, view)));
      if (mine === asked && plot) {
        plot.setExtent(from.length === 1 && from[0] === "live" ? bench.live.extent() : null);
        plot.setPresent(present(from));
        plot.setData(tables.length === 1 ? tables[0] : joined(tables));
      }
    } catch (error) {
      bench.app.notify(error.message, "error");
    } finally {
      busy = false;
      if (again) { again = false; later(); }
    }
  }
  let timer = 0;
  function later() {
    clearTimeout(timer);
    timer = setTimeout(() => { timer = 0; refresh(); }, 40);
  }
  const off = bench.live.listen((what) => {
    if (what === "trace") plot?.follow();
    const simple = sources().length === 1 && bench.shown.live && plot && (!plot.view || bench.live.data.header?.bucket === 1);
    if (what === "block" && simple && made) {
      plot.setExtent(bench.live.extent());
      plot.setPresent(present(["live"]));
      plot.setData(bench.live.whole(spec.variables));
    } else if (what === "block") timer ||= setTimeout(() => { timer = 0; refresh(); }, 150);
    else refresh();
  });
  queueMicrotask(refresh);
  return { element: titled(spec, box), update: refresh, destroy() { off(); offView(); clearTimeout(timer); plot?.destroy(); plot = null; } };
}
