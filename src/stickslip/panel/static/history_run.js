// One run of the history: what it is, its curves, notes and tags, what it was made of and what was made of it.

import { exportDialog, renameDialog } from "./recordings.js";
import { h } from "./dom.js";
import { KIND, isoTime, whenOf } from "./history.js";
import { calledShortly, showRecording } from "./livedata.js";
import { pathCard } from "./path.js";
import { makePlot } from "./plot.js";
import { formatQuantity } from "./quantity.js";

const LINKS = { fitted: "fitted to", verified: "verified on", steps: "stage from", fit: "of the fit", parameters: "with the parameters", prediction: "as predicted in", of: "of" };
const MADE = { fitted: "fit", verified: "verification", steps: "stage of a fit", fit: "made of this fit", parameters: "made with these parameters", prediction: "made of this prediction", of: "made of it" };

export async function showRun(element, app, name, acts) {
  const run = await app.request("/history/detail", { name });
  const facts = [["Kind", KIND[run.kind] ?? run.kind], ["File", run.name], ["When", whenOf(run)], ["Outcome", run.problem || run.outcome], ["Operator", run.operator],
    ["Rig", run.rig], ["Source", run.settings.source], ["Parameter set", run.parameter_set], ["Length", run.seconds ? `${formatQuantity(run.seconds, "s")}, ${run.samples} samples` : ""]];
  const fact = ([label, value]) => value && h("div", {}, h("dt", {}, label), h("dd", {}, value));
  const canKeep = run.name.endsWith(".nc") || ["fit", "verification"].includes(run.kind);
  const notes = h("textarea", { id: "run-notes", rows: 3, value: run.notes, disabled: !canKeep });
  const tags = h("input", { id: "run-tags", value: run.tags, placeholder: "brass, first batch", disabled: !canKeep, spellcheck: false });
  const save = h("button", { class: "primary small", disabled: !canKeep }, "Save notes and tags");
  const form = h("form", { class: "history-notes", onsubmit: async () => {
    try {
      await app.request("/history/annotate", { name, notes: notes.value, tags: tags.value.split(",") });
      app.notify("Notes and tags are kept.");
      acts.changed();
    } catch (error) {
      app.notify(error.message, "error");
    }
  } },
  h("div", { class: "field" }, h("label", { htmlFor: "run-notes" }, "Notes"), notes),
  h("div", { class: "field" }, h("label", { htmlFor: "run-tags" }, "Tags, with commas between them"), tags),
  h("div", { class: "row" }, save, canKeep ? null : h("span", { class: "soft small-text" }, run.kind === "parameters" ? "A parameter set says these in its file." : "Notes are kept in .nc files: take this file in first.")));

  const buttons = h("div", { class: "row" });
  const add = (text, act) => buttons.append(h("button", { type: "button", class: "small", onclick: act }, text));
  const recorded = ["recording", "prediction"].includes(run.kind) && !run.problem;
  if (recorded) add("Export…", () => exportDialog(name));
  if (recorded && run.name.endsWith(".nc")) add("Rename…", () => renameDialog({ app, act: (path, body) => app.request(path, body).catch((error) => app.notify(error.message, "error")) }, name, (to) => { acts.changed(); acts.open(to); }));
  if (["fit", "verification"].includes(run.kind)) buttons.append(h("a", { class: "button small", href: `/api/identify/report/${run.name}`, target: "_blank", rel: "noopener" }, "Report"));
  if (run.kind === "recording" && recorded) buttons.append(h("a", { class: "button small", href: `#identify?${new URLSearchParams({ recording: name })}` }, "Identify"));
  add("Move to the bin", () => acts.toBin([name]));

  const link = (to, text) => h("li", {}, h("button", { type: "button", class: "link", onclick: () => acts.open(to) }, calledShortly(to)), h("span", { class: "soft" }, ` · ${text}`));
  const of = Object.entries(run.links).flatMap(([kind, names]) => names.map((to) => link(to, LINKS[kind] ?? kind)));
  const made = run.made.map((one) => link(one.name, `${KIND[one.kind] ?? one.kind}: ${MADE[one.as] ?? one.as}`));
  const done = run.acts.map((one) => h("li", {}, `${one.act}${one.kind ? ` as ${one.kind}` : ""}${one.was ? ` from ${calledShortly(one.was)}` : ""}${one.file ? ` ${one.file}` : ""}`, h("span", { class: "soft when-cell" }, ` · ${isoTime(new Date(one.time), "medium")}`)));
  const part = (title, items, otherwise) => h("div", {}, h("h3", {}, title), items.length ? h("ul", { class: "history-links" }, ...items) : h("p", { class: "soft small-text" }, otherwise));
  const settings = Object.entries(run.settings).map(([key, value]) => h("tr", {}, h("th", {}, key), h("td", {}, typeof value === "string" ? value : JSON.stringify(value).replace(/[{}"]/g, "").replace(/,/g, ", ").replace(/:/g, ": "))));
  const canvas = h("div", { class: "history-canvas" });
  element.replaceChildren(h("div", { class: "card history-run" },
    h("h2", {}, calledShortly(name)), run.title ? h("p", { class: "soft" }, run.title) : null, buttons, h("dl", { class: "history-facts" }, ...facts.map(fact)),
    recorded ? canvas : null, form,
    h("div", { class: "history-parts" }, part("Made of", of, "of nothing else here"), part("Made of it", made, "nothing yet"), part("Done with it", done, "nothing yet")),
    settings.length ? h("details", {}, h("summary", {}, "Settings and numbers"), h("div", { class: "history-table" }, h("table", {}, h("tbody", {}, ...settings)))) : null));
  if (run.kind === "fit" && !run.problem) {
    const way = pathCard(app, name);
    element.append(way);
    return () => way.destroy();
  }
  return recorded ? draw(canvas, app, name) : () => {};
}

function draw(canvas, app, name) {
  let plot = null;
  let gone = false;
  async function refresh() {
    try {
      const { header, x, columns } = await showRecording(app, name, plot?.view ?? null, 2 * (plot?.pixels ?? 900));
      if (gone) return;
      if (!plot) {
        canvas.style.setProperty("--strips", new Set(header.columns.map((one) => one.unit)).size);
        plot = makePlot(canvas, { series: header.columns, label: "The recording" });
        plot.onView(() => { clearTimeout(timer); timer = setTimeout(refresh, 60); });
      }
      plot.setPresent(header.latest);
      plot.setData([x, ...columns]);
    } catch (error) {
      app.notify(error.message, "error");
    }
  }
  let timer = 0;
  refresh();
  return () => { gone = true; clearTimeout(timer); plot?.destroy(); };
}
