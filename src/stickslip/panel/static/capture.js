// Capture settings of the chosen run: length, sampling, trigger, pre-trigger, repeats, averaging.

import { h } from "./dom.js";
import { makeQuantity } from "./quantity.js";

const DEFAULT_TRIGGER = { signal: "drive_voltage", level: "1 V", edge: "rising" };

export function makeCapture(bench) {
  const element = h("div", { class: "capture" });
  let key = "";
  let fields = []; // [field, its value in the capture settings as they are]

  function build() {
    const index = bench.experiment.content.runs.findIndex((one) => one.name === bench.chosen);
    const run = bench.experiment.content.runs[index];
    if (!run) return;
    const { capture } = run;
    const now = JSON.stringify([index, capture.trigger?.signal, capture.trigger?.edge, capture.interval === undefined, bench.experiment.channels]);
    if (now === key) { // the fields are the right ones: somebody may be typing in one
      for (const [one, read] of fields) one.set(read(run));
      return;
    }
    key = now;
    fields = [];
    const at = (...path) => ["runs", index, ...path];
    const field = (label, unit, get, path, hint = "") => {
      const read = (from) => inSI(get(from), unit);
      const made = makeQuantity({
        label, unit, value: read(run), app: bench.app, hint, change: (number) => bench.set(path, unit ? `${number} ${unit}` : number),
      });
      fields.push([made, read]);
      return made.element;
    };
    const { trigger } = capture;
    const unit = bench.experiment.channels.find((one) => one.name === trigger?.signal)?.unit ?? "";
    const setTrigger = (change) => bench.set(at("capture", "trigger"), change && { ...(trigger ?? DEFAULT_TRIGGER), ...change }).catch((error) => bench.app.notify(error.message, "error"));
    const signal = h("select", { id: "trigger", onchange: () => {
      const to = bench.experiment.channels.find((one) => one.name === signal.value);
      setTrigger(to ? { signal: to.name, level: to.unit === "V" ? "1 V" : `1e-6 ${to.unit}` } : null);
    } }, h("option", { value: "" }, "none: the begin of the drive"), ...bench.experiment.channels.map((one) => h("option", { value: one.name, selected: one.name === trigger?.signal }, one.label)));
    const edge = h("select", { id: "trigger-edge", onchange: () => setTrigger({ edge: edge.value }) }, ...["rising", "falling"].map((one) => h("option", { value: one, selected: one === (trigger?.edge ?? "rising") }, one)));
    const focused = document.activeElement?.closest?.(".capture") && document.activeElement.labels?.[0]?.textContent;
    element.replaceChildren(h("div", { class: "inputs" },
      field("Length", "s", (from) => from.capture.length, at("capture", "length")),
      capture.interval === undefined ? field("Every n-th sample", "", (from) => from.capture.down_sampling, at("capture", "down_sampling")) : field("Sampling", "s", (from) => from.capture.interval, at("capture", "interval"), "a whole multiple of the rig's"),
      field("Pre-trigger", "s", (from) => from.capture.pre_trigger ?? 0, at("capture", "pre_trigger")),
      h("div", { class: "field" }, h("label", { htmlFor: "trigger" }, "Trigger"), signal),
      trigger ? field("Trigger level", unit, (from) => from.capture.trigger.level, at("capture", "trigger", "level")) : null,
      trigger ? h("div", { class: "field" }, h("label", { htmlFor: "trigger-edge" }, "Edge"), edge) : null,
      field("Repeats", "", (from) => from.repeats ?? 1, at("repeats"), "so many recordings"),
      field("Averaging", "", (from) => from.capture.average ?? 1, at("capture", "average"), "runs in one recording")));
    if (focused) [...element.querySelectorAll("label")].find((one) => one.textContent === focused)?.control?.focus();
  }
  return { element, build };
}

const POWERS = { p: -12, n: -9, u: -6, "µ": -6, m: -3, k: 3 };
/** The number in SI of a text of the experiment file such as "0.25 ms". */
function inSI(text, unit) {
  if (text === undefined) return null;
  if (typeof text === "number") return text;
  const [, number, rest] = /^\s*([-+.\deE]+)\s*(.*)$/.exec(text) ?? [null, NaN, ""];
  const prefix = rest.length === unit.length + 1 ? rest[0] : "";
  return Number((Number(number) * 10 ** (POWERS[prefix] ?? 0)).toPrecision(12));
}
