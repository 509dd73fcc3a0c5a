// The sequence: runs for each combination of some variables' values, with repeats and rests, one after the other.

import { h } from "./dom.js";
import { formatQuantity } from "./quantity.js";

/** "50 V, 60 V" or "50 to 70 V by 5" as texts with units. */
export function valuesOf(text) {
  const range = /^\s*([-+.\d]+)\s*\S*\s+to\s+([-+.\d]+)\s*(\D*?)\s+by\s+([.\d]+)/.exec(text);
  if (!range) return text.split(",").map((one) => one.trim()).filter(Boolean);
  const [from, to, by] = [range[1], range[2], range[4]].map(Number);
  const count = Math.floor(Math.abs(to - from) / by + 1e-9);
  if (!(by > 0) || count > 1000) throw new Error(`“${text.trim()}” has no end: write 50 to 70 V by 5`);
  return Array.from({ length: count + 1 }, (_, i) => `${Number((from + Math.sign(to - from) * i * by).toPrecision(12))} ${range[3]}`.trim());
}

export function makeSequence(bench) {
  const list = h("div", { class: "sequence-items" });
  const fault = h("p", { class: "fault", role: "alert" });
  const said = h("p", { class: "soft small-text number", role: "status" });
  const order = h("label", { class: "choice" }, h("input", { type: "checkbox" }), "Repeat in rounds: all values, then all again");
  const home = h("label", { class: "choice" }, h("input", { type: "checkbox" }), "Walk home before each run");
  const goOn = h("label", { class: "choice" }, h("input", { type: "checkbox" }), "Continue after a failed run");
  const start = h("button", { type: "button", class: "primary", onclick: () => send("/sequence/start") }, "Start the sequence");
  const check = h("button", { type: "button", onclick: () => send("/sequence/check") }, "Check");
  const end = h("button", { type: "button", onclick: () => bench.act("/sequence/end") }, "End after this run");
  const add = h("button", { type: "button", class: "small", onclick: () => { items.push(newItem()); draw(); } }, "Add a run");
  const state = h("p", { class: "sequence-state number", role: "status" });
  const bar = h("progress", { max: 1, value: 0, hidden: true, "aria-label": "Progress of the sequence" });
  const editor = h("fieldset", { class: "bare" }, list, h("div", { class: "row" }, add, h("span", { class: "grow" }), check), order, home, goOn, start);
  const element = h("div", { class: "sequence" }, state, bar, end, editor, fault, said);
  const items = [];
  let now = { phase: "idle" };
  const newItem = () => ({ run: bench.chosen ?? "", matrix: [["", ""]], repeats: 1, rest: "0 s" });

  const field = (label, value, store, more = {}) => h("label", { class: "field" }, h("span", {}, label), h("input", { value, spellcheck: false, oninput: (event) => store(event.target.value), ...more }));
  function row(item, index) {
    const names = bench.experiment.variables.filter((one) => one.kind === "experiment").map((one) => one.name);
    const select = (value, options, label, store) => h("select", { "aria-label": label, onchange: (event) => { store(event.target.value); draw(); } }, ...options.map(([one, text]) => h("option", { value: one, selected: one === value }, text)));
    const axes = item.matrix.map((axis, i) => h("div", { class: "sequence-axis" },
      select(axis[0], [["", "as set"], ...names.map((one) => [one, one.replaceAll("_", " ")])], `Variable ${i + 1} of run ${index + 1}`, (value) => (axis[0] = value)),
      h("input", { value: axis[1], placeholder: "50 V, 60 V", title: "Values with commas between them, or: 50 to 70 V by 5", spellcheck: false, disabled: !axis[0], "aria-label": `Values of variable ${i + 1} of run ${index + 1}`, oninput: (event) => (axis[1] = event.target.value) })));
    return h("div", { class: "sequence-item", role: "group", "aria-label": `Run ${index + 1} of the sequence` },
      h("div", { class: "row" }, select(item.run, bench.experiment.content.runs.map((one) => [one.name, one.name]), `Run ${index + 1}`, (value) => (item.run = value)), h("span", { class: "grow" }),
        h("button", { type: "button", class: "small", "aria-label": `Remove run ${index + 1}`, onclick: () => { items.splice(index, 1); draw(); } }, "Remove")),
      ...axes, h("button", { type: "button", class: "small quiet", hidden: item.matrix.length >= 4, onclick: () => { item.matrix.push(["", ""]); draw(); } }, "Another variable"),
      h("div", { class: "inputs" }, field("Repeats", item.repeats, (value) => (item.repeats = value), { type: "number", min: 1 }), field("Rest after each", item.rest, (value) => (item.rest = value))));
  }
  function draw() {
    const focused = document.activeElement?.getAttribute("aria-label");
    if (!items.length && bench.experiment.content.runs.length) items.push(newItem());
    list.replaceChildren(...items.map(row));
    if (focused && element.contains(document.activeElement) === false) list.querySelector(`[aria-label="${CSS.escape(focused)}"]`)?.focus();
  }
  const asked = () => ({
    items: items.map((one) => ({ run: one.run, repeats: Number(one.repeats), rest: one.rest, matrix: Object.fromEntries(one.matrix.filter(([name]) => name).map(([name, text]) => {
      const values = valuesOf(text);
      if (!values.length) throw new Error(`${name.replaceAll("_", " ")}: which values?`);
      return [name, values];
    })) })),
    order: order.firstChild.checked ? "rounds" : "given", home_first: home.firstChild.checked, go_on: goOn.firstChild.checked,
  });
  async function send(path) {
    fault.textContent = said.textContent = "";
    try {
      await bench.needAccepted();
      const found = await bench.app.request(path, asked());
      if (path.endsWith("check")) said.textContent = `${found.count} ${found.count === 1 ? "run" : "runs"}, ${duration(found.seconds)}: ${found.titles.slice(0, 6).join("; ")}${found.count > 6 ? " …" : ""}`;
      else bench.show({ live: true });
    } catch (error) {
      fault.textContent = error.message;
    }
  }
  function tell(message) {
    now = message;
    const running = now.phase === "running";
    state.textContent = running ? `${now.at} of ${now.count}: ${now.title}${now.left === null ? "" : ` · ${duration(now.left)} left`}${now.said ? ` · ${now.said}` : ""}` : now.said ? `Sequence ${now.phase}: ${now.said}` : "Runs for each combination of values, one after the other.";
    bar.hidden = end.hidden = !running;
    bar.value = running ? (now.at - 1) / now.count : 0;
    control();
  }
  function control() {
    const other = Boolean(bench.app.control.holder) && !bench.app.control.mine;
    editor.disabled = other || now.phase === "running";
    end.disabled = other;
  }
  const off = bench.app.stream.on("sequence", tell);
  window.addEventListener("controlchange", control);
  return { element, build: () => { if (!element.contains(document.activeElement)) draw(); }, destroy() { off(); window.removeEventListener("controlchange", control); } };
}

/** "1 h 05 min", "3 min 20 s", "12 s". */
export function duration(seconds) {
  const s = Math.round(seconds);
  if (s < 60) return s < 10 ? formatQuantity(seconds, "s", 2) : `${s} s`;
  return s < 3600 ? `${Math.floor(s / 60)} min ${String(s % 60).padStart(2, "0")} s` : `${Math.floor(s / 3600)} h ${String(Math.floor((s % 3600) / 60)).padStart(2, "0")} min`;
}
