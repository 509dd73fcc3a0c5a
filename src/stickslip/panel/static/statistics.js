// Live statistics of the run: rms and range of each channel, the step and its drift, where home is; alarms on them.

import { h, openDialog } from "./dom.js";
import { formatQuantity } from "./quantity.js";

export function makeStatistics(bench) {
  const body = h("tbody");
  const none = h("p", { class: "soft small-text" }, "Numbers come with the next run.");
  const table = h("table", { class: "statistics" }, h("thead", {}, h("tr", {}, h("th", {}, "Statistic"), h("th", { class: "number" }, "Value"), h("th", {}, "Alarm"))), body);
  const element = h("div", {}, none, table);
  let rows = new Map();
  let alarms = [];

  function tell({ values, alarms: now }) {
    alarms = now;
    const names = [...new Set([...Object.keys(values), ...alarms.map((one) => one.statistic)])];
    none.hidden = names.length > 1;
    if (names.join() !== [...rows.keys()].join()) {
      rows = new Map(names.map((name) => {
        const value = h("td", { class: "number" });
        const set = h("button", { type: "button", class: "small quiet", onclick: () => dialog(name, values[name]?.unit ?? "") });
        return [name, { value, set, row: h("tr", {}, h("th", { scope: "row" }, values[name]?.label ?? name), value, h("td", {}, set)) }];
      }));
      body.replaceChildren(...[...rows.values()].map((one) => one.row));
    }
    for (const [name, { value, set, row }] of rows) {
      const now = values[name], alarm = alarms.find((one) => one.statistic === name);
      value.textContent = now ? formatQuantity(now.value, now.unit) : "–";
      row.classList.toggle("alarm", Boolean(now?.alarm));
      const text = alarm ? [alarm.low !== null ? `≥ ${alarm.low}` : "", alarm.high !== null ? `≤ ${alarm.high}` : "", alarm.stop ? "stops" : ""].filter(Boolean).join(", ") : "Set…";
      if (set.textContent !== text) set.textContent = text;
      set.setAttribute("aria-label", `Alarm on ${now?.label ?? name}: ${alarm ? text : "none"}`);
    }
  }
  function dialog(name, unit) {
    const alarm = alarms.find((one) => one.statistic === name);
    openDialog(`Alarm on ${name}`, (close) => {
      const low = h("input", { id: "alarm-low", value: alarm?.low ?? "", placeholder: unit ? `none, or in ${unit}` : "none", spellcheck: false });
      const high = h("input", { id: "alarm-high", value: alarm?.high ?? "", placeholder: unit ? `none, or in ${unit}` : "none", spellcheck: false });
      const stop = h("input", { type: "checkbox", checked: alarm?.stop ?? false });
      const fault = h("p", { class: "fault", role: "alert" });
      const store = async (made) => {
        try {
          await bench.app.request("/statistics/alarms", { alarms: [...alarms.filter((one) => one.statistic !== name), ...made] });
          close();
        } catch (error) {
          fault.textContent = error.message;
        }
      };
      const submit = () => store([{ statistic: name, low: low.value.trim() || null, high: high.value.trim() || null, stop: stop.checked }]);
      return h("form", { onsubmit: submit }, h("div", { class: "field" }, h("label", { htmlFor: "alarm-low" }, "Not below"), low), h("div", { class: "field" }, h("label", { htmlFor: "alarm-high" }, "Not above"), high),
        h("label", { class: "choice" }, stop, "Stop the run, and a sequence"), fault,
        h("div", { class: "row end" }, alarm ? h("button", { type: "button", onclick: () => store([]) }, "No alarm") : null, h("button", { type: "button", onclick: close }, "Cancel"), h("button", { class: "primary" }, "Set")));
    });
  }
  const off = bench.app.stream.on("statistics", tell);
  return { element, destroy: off };
}
