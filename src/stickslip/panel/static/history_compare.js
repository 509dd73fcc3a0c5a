// Two or more runs side by side: a channel of all on one clock, what each differs from the first, and a table of what
// was set or found otherwise.

import { h } from "./dom.js";
import { calledShortly } from "./livedata.js";
import { makePlot } from "./plot.js";
import { formatQuantity } from "./quantity.js";
import { unpack } from "./stream.js";

const LETTERS = "ABCDEFGH";

export async function showComparison(element, app, names) {
  const { differences, channels } = await app.request("/history/differences", { names });
  const canvas = h("div", { class: "history-canvas tall" });
  const rms = h("p", { class: "soft number", role: "status" });
  const select = h("select", { id: "compare-channel", onchange: () => build() }, ...channels.map((one) => h("option", { value: one, selected: one === "end_effector_position" }, one.replaceAll("_", " "))));
  const key = h("ol", { class: "history-key" }, ...names.map((name, i) => h("li", {}, h("strong", {}, LETTERS[i]), " ", calledShortly(name))));
  const cell = (value) => (value === null || value === undefined || value === "" ? "–" : typeof value === "number" ? String(Number(value.toPrecision(6))) : typeof value === "object" ? JSON.stringify(value) : String(value));
  const rows = Object.entries(differences).map(([what, values]) => h("tr", {}, h("th", {}, what), ...values.map((value) => h("td", {}, cell(value)))));
  const table = rows.length ? h("div", { class: "history-table", tabIndex: 0, role: "group", "aria-label": "What differs" }, h("table", {}, h("thead", {}, h("tr", {}, h("th", {}, "What differs"), ...names.map((_, i) => h("th", {}, LETTERS[i])))), h("tbody", {}, ...rows)))
    : h("p", { class: "soft" }, "Nothing was set or found otherwise.");
  element.replaceChildren(h("div", { class: "card history-run" }, h("h2", {}, `Comparison of ${names.length}`), key,
    ...(channels.length ? [h("div", { class: "row" }, h("label", { htmlFor: "compare-channel" }, "Channel"), select, h("span", { class: "soft" }, "Time 0 is the trigger.")), canvas, rms]
      : [h("p", { class: "soft" }, "They have no channel in common: no curves are drawn.")]),
    table));

  let plot = null;
  let gone = false;
  let timer = 0;
  function build() {
    plot?.destroy();
    plot = null;
    refresh();
  }
  async function refresh() {
    const [begin, end] = plot?.view ?? [null, null];
    const channel = select.value;
    try {
      const { header, arrays } = unpack(await app.request("/history/overlay", { names, channel, begin, end, points: 2 * (plot?.pixels ?? 900) }));
      if (gone || channel !== select.value) return;
      if (!plot) {
        const of = (i) => ({ unit: header.unit, color: `--series-${(i % 6) + 1}` });
        plot = makePlot(canvas, { label: "Comparison", time: { label: "time from the trigger", unit: "s" }, series: [
          ...names.map((_, i) => ({ ...of(i), label: `${LETTERS[i]} ${header.label}`, strip: "values" })),
          ...names.slice(1).map((_, i) => ({ ...of(i + 1), label: `${LETTERS[i + 1]} − A`, strip: "difference" })),
        ] });
        plot.onView(() => { clearTimeout(timer); timer = setTimeout(refresh, 60); });
      }
      plot.setData([Float64Array.from(arrays[0], (t) => header.from + t), ...arrays.slice(1)]);
      rms.textContent = header.rms.map((one, i) => `${LETTERS[i + 1]} − A: ${formatQuantity(one, header.unit, 3)} rms`).join(" · ");
    } catch (error) {
      rms.textContent = error.message;
    }
  }
  if (channels.length) refresh();
  return () => { gone = true; clearTimeout(timer); plot?.destroy(); };
}
