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
  const clock = h("p", { class: "soft small-text" });
  const select = h("select", { id: "compare-channel", onchange: () => build() }, ...channels.map((one) => h("option", { value: one, selected: one === "end_effector_position" }, one.replaceAll("_", " "))));
  const key = h("ol", { class: "history-key" }, ...names.map((name, i) => h("li", {}, h("strong", {}, LETTERS[i]), " ", calledShortly(name))));
  element.replaceChildren(h("div", { class: "card history-run" }, h("h2", {}, `Comparison of ${names.length}`), key,
    ...(channels.length ? [h("div", { class: "row" }, h("label", { htmlFor: "compare-channel" }, "Channel"), select), clock, canvas, rms]
      : [h("p", { class: "soft" }, "They have no channel in common: no curves are drawn.")]),
    tableOf(differences, names.length)));

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
      const { zeros, apart } = header;
      if (!plot) {
        const of = (i) => ({ unit: header.unit, color: `--series-${(i % 6) + 1}` });
        plot = makePlot(canvas, { label: "Comparison", time: { label: timeLabel(zeros), unit: "s" }, series: [
          ...names.map((_, i) => ({ ...of(i), label: `${LETTERS[i]} ${header.label}`, strip: "values" })),
          ...apart.map((i) => ({ ...of(i), label: `${LETTERS[i]} − A`, strip: "difference" })),
        ] });
        plot.onView(() => { clearTimeout(timer); timer = setTimeout(refresh, 60); });
      }
      plot.setPresent(header.latest);
      plot.setData([Float64Array.from(arrays[0], (t) => header.from + t), ...arrays.slice(1)]);
      clock.textContent = alignment(zeros);
      const left = names.map((_, i) => i).filter((i) => i && !apart.includes(i));
      rms.textContent = [...apart.map((i, k) => `${LETTERS[i]} − A: ${formatQuantity(header.rms[k], header.unit, 3)} rms`),
        ...left.map((i) => `${LETTERS[i]} − A: not given, they have no time 0 in common`)].join(" · ");
    } catch (error) {
      rms.textContent = error.message;
    }
  }
  if (channels.length) refresh();
  return () => { gone = true; clearTimeout(timer); plot?.destroy(); };
}

const timeLabel = (zeros) => (zeros.every(({ event }) => event && event === zeros[0].event) ? `time from the ${zeros[0].event}` : "time");

/** "Time 0 is the begin of the drive. B has no trigger." */
function alignment(zeros) {
  const lettersOf = (wanted) => zeros.flatMap((zero, i) => (wanted(zero) ? [LETTERS[i]] : []));
  const listed = (letters) => (letters.length > 1 ? `${letters.slice(0, -1).join(", ")} and ${letters.at(-1)}` : letters[0]);
  const events = [...new Set(zeros.map(({ event }) => event))];
  const said = events.map((event) => {
    const letters = lettersOf((zero) => zero.event === event);
    const of = letters.length === zeros.length ? "" : ` of ${listed(letters)}`;
    return event ? `Time 0${of} is the ${event}.` : `Time 0${of} is that of the file: neither a trigger nor the begin of a drive is recorded.`;
  });
  const without = lettersOf(({ event, triggered }) => event && !triggered);
  if (without.length) said.push(`${listed(without)} ${without.length > 1 ? "have" : "has"} no trigger.`);
  return said.join(" ");
}

function tableOf(differences, count) {
  if (!differences.length) return h("p", { class: "soft" }, "Nothing was set or found otherwise.");
  const cell = (value, unit) => {
    if (value === null || value === undefined || value === "") return "–";
    if (typeof value === "number") return formatQuantity(value, unit, 6);
    return typeof value === "object" ? JSON.stringify(value) : String(value);
  };
  const rows = differences.map(({ what, values, units }) => h("tr", {}, h("th", { scope: "row" }, what), ...values.map((value, i) => h("td", {}, cell(value, units[i])))));
  const heads = Array.from({ length: count }, (_, i) => h("th", {}, LETTERS[i]));
  const table = h("table", { class: "history-differences" }, h("thead", {}, h("tr", {}, h("th", {}, "What differs"), ...heads)), h("tbody", {}, ...rows));
  table.style.setProperty("--columns", count);
  return h("div", { class: "history-table", tabIndex: 0, role: "group", "aria-label": "What differs" }, table);
}
