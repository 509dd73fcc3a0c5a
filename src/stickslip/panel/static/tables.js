// The table of all variables, and the log.

import { h } from "./dom.js";
import { variableField } from "./instruments.js";
import { formatQuantity } from "./quantity.js";

export function makeVariables(bench) {
  const filter = h("input", { placeholder: "find", "aria-label": "Find a variable", oninput: show });
  const body = h("tbody");
  const element = h("div", {}, filter, h("table", { class: "variables" }, h("thead", {}, h("tr", {}, h("th", {}, "Variable"), h("th", {}, "Value"))), body));
  let rows = [];
  let key = "";

  function build() {
    const { channels, variables } = bench.experiment;
    const now = JSON.stringify([channels, variables.map(({ name, unit }) => [name, unit])]);
    if (now !== key) {
      key = now;
      rows = [...channels.map((one) => {
        const value = h("td", { class: "number", "data-channel": one.name }, "–");
        return { one, text: `${one.name} ${one.label}`, value, row: h("tr", {}, label(one, "measured"), value) };
      }), ...variables.map((one) => {
        const field = variableField(bench, one, `${one.label} (${one.name})`);
        return { one, text: `${one.name} ${one.label}`, field, row: h("tr", {}, label(one, one.kind), h("td", { class: "set" }, field.element)) };
      })];
      show();
    }
    for (const { one, field } of rows) field?.set(variables.find(({ name }) => name === one.name)?.value);
  }
  function show() {
    const wanted = filter.value.toLowerCase();
    values();
    body.replaceChildren(...rows.filter(({ text }) => text.toLowerCase().includes(wanted)).map(({ row }) => row));
  }
  function values() {
    for (const { one, value } of rows) if (value) value.textContent = formatQuantity(bench.live.latest(one.name), one.unit);
  }
  bench.live.listen(values);
  return { element, build };
}

const label = (one, kind) => h("td", {}, h("div", {}, one.label), h("div", { class: "soft name" }, `${one.name}${one.unit ? ` [${one.unit}]` : ""} · ${kind}`));

export function makeLog(app) {
  const lines = h("ol", { class: "log" });
  const element = h("div", {}, lines);
  const known = new Set();
  const off = app.stream.on("log", ({ entries }) => {
    for (const entry of entries) {
      if (known.has(entry.id)) continue;
      known.add(entry.id);
      lines.prepend(h("li", { "data-level": entry.level }, h("time", { dateTime: entry.time, class: "soft number" }, new Date(entry.time).toLocaleTimeString([], { hourCycle: "h23" })), " ", entry.why ? `${entry.text} (${entry.why})` : entry.text));
      if (entry.level === "error") app.notify(entry.text, "error");
    }
    while (lines.children.length > 500) lines.lastChild.remove();
  });
  const reset = app.stream.on("connection", ({ restarted }) => { if (restarted) { known.clear(); lines.replaceChildren(); } });
  return { element, destroy() { off(); reset(); } };
}
