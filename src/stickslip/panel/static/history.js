// The History page: everything that was recorded, fitted, saved and verified in the folder; found again, annotated,
// compared, put into the bin and taken out of it; and files of others taken in.

import { h, openDialog } from "./dom.js";
import { styled } from "./elements.js";
import { showComparison } from "./history_compare.js";
import { showLog } from "./history_log.js";
import { showRun } from "./history_run.js";
import { uploadDialog } from "./history_upload.js";
import { calledShortly } from "./livedata.js";

const KINDS = [["", "everything"], ["recording", "recordings"], ["fit", "fits"], ["parameters", "parameter sets"], ["prediction", "predictions"], ["verification", "verifications"]];
const OUTCOMES = [["", "any outcome"], ["complete", "complete"], ["not as required", "not as required"], ["bad", "anything but complete"]];
export const KIND = { recording: "recording", fit: "fit", run: "run without a recording", parameters: "parameter set", prediction: "prediction", verification: "verification" };
const MOST_COMPARED = 8;

export async function mount(element, app) {
  await styled("./history.css");
  const ticked = new Set();
  let rows = [];
  let chosen = "";
  let leave = () => {};

  const search = h("input", { type: "search", placeholder: "words: name, notes, tag, operator …", "aria-label": "Search the history", oninput: later });
  const choice = (label, names) => h("select", { "aria-label": label, onchange: load }, ...names.map(([value, text]) => h("option", { value }, text)));
  const kind = choice("Kind", KINDS), outcome = choice("Outcome", OUTCOMES);
  const compare = h("button", { type: "button", class: "primary small", onclick: () => open([...ticked]) }, "Compare");
  const remove = h("button", { type: "button", class: "small", onclick: () => toBin([...ticked]) }, "Move to the bin");
  const count = h("p", { class: "soft number", role: "status" });
  const body = h("tbody");
  const list = h("section", { class: "card history-list", "aria-label": "Runs" },
    h("div", { class: "history-find" }, search, kind, outcome),
    h("div", { class: "row" }, compare, remove, h("span", { class: "grow" }),
      h("button", { type: "button", class: "small", onclick: () => uploadDialog(app, async (name) => { await load(); open([name]); }) }, "Import a file…"),
      h("button", { type: "button", class: "small quiet", onclick: openLog }, "Log"),
      h("button", { type: "button", class: "small quiet", onclick: binDialog }, "Bin…")),
    count, h("div", { class: "history-table", tabIndex: 0, role: "group", "aria-label": "List of runs" }, h("table", {}, h("thead", {}, h("tr", {}, h("th", {}, h("span", { class: "visually-hidden" }, "Tick")), h("th", {}, "Run"), h("th", { class: "number" }, "When"), h("th", {}, "Outcome"))), body)));
  const right = h("section", { class: "history-right", "aria-label": "Details" });
  element.append(h("h1", { class: "visually-hidden" }, "History"), h("div", { class: "history" }, list, right));

  let timer = 0;
  function later() { clearTimeout(timer); timer = setTimeout(load, 200); }
  let asked = 0;
  async function load() {
    const mine = ++asked;
    try {
      const found = await app.request(`/history?${new URLSearchParams({ search: search.value, kind: kind.value, outcome: outcome.value })}`);
      if (mine !== asked) return;
      rows = found.rows;
      const all = found.count > rows.length ? `${rows.length} of ${found.count}: search for the others` : `${found.count} ${found.count === 1 ? "entry" : "entries"}`;
      count.textContent = found.count || search.value || kind.value || outcome.value ? all : "Nothing is here yet: record a run on the Bench page, or import a file of your own.";
      for (const name of ticked) if (!rows.some((one) => one.name === name)) ticked.delete(name);
      draw();
    } catch (error) {
      app.notify(error.message, "error");
    }
  }
  function draw() {
    const focused = document.activeElement?.dataset?.run;
    body.replaceChildren(...rows.map((one) => {
      const box = h("input", { type: "checkbox", checked: ticked.has(one.name), "aria-label": `Tick ${calledShortly(one.name)}`, onchange: () => { if (box.checked) ticked.add(one.name); else ticked.delete(one.name); tell(); } });
      const about = [KIND[one.kind] ?? one.kind, one.operator, one.tags && `#${one.tags.replaceAll(", ", " #")}`].filter(Boolean).join(" · ");
      return h("tr", { class: one.name === chosen ? "shown" : "" }, h("td", {}, h("label", { class: "compare" }, box)),
        h("td", {}, h("button", { type: "button", class: "link", "data-run": one.name, title: one.name, onclick: () => open([one.name]) }, calledShortly(one.name)), h("div", { class: "soft small-text" }, about)),
        h("td", { class: "number when-cell" }, whenOf(one)), h("td", { class: one.problem || !["complete", ""].includes(one.outcome) ? "weak" : "" }, one.problem ? "unreadable" : (one.outcome || "–").split(":")[0]));
    }));
    if (focused) body.querySelector(`[data-run="${CSS.escape(focused)}"]`)?.focus();
    tell();
  }
  function tell() {
    compare.disabled = ticked.size < 2 || ticked.size > MOST_COMPARED;
    compare.textContent = ticked.size > 1 ? `Compare ${ticked.size}` : "Compare";
    compare.title = `Tick two to ${MOST_COMPARED} runs`;
    remove.disabled = !ticked.size;
  }
  async function open(names) {
    leave();
    leave = () => {};
    chosen = names.length === 1 ? names[0] : "";
    for (const row of body.children) row.classList.toggle("shown", row.querySelector("[data-run]").dataset.run === chosen);
    if (!names.length) { right.replaceChildren(nothing()); return; }
    history.replaceState(null, "", `#history?${new URLSearchParams(names.map((name) => ["run", name]))}`);
    try {
      const acts = { open: (name) => open([name]), toBin, changed: load };
      leave = names.length > 1 ? await showComparison(right, app, names) : await showRun(right, app, names[0], acts);
    } catch (error) {
      right.replaceChildren(h("div", { class: "card" }, h("p", { class: "fault", role: "alert" }, error.message)));
    }
    if (right.getBoundingClientRect().top > innerHeight / 2) right.scrollIntoView();
  }
  async function openLog() {
    await open([]);
    history.replaceState(null, "", "#history?log");
    leave = await showLog(right, app);
  }
  const nothing = () => h("div", { class: "card soft" }, h("h2", {}, "A run's details come here"), h("p", {}, "Choose one in the list: what made it, what was made of it, its notes and curves. Tick two or more to compare them: their curves on one clock, their difference, and what was set or found otherwise."));

  async function toBin(names) {
    try {
      await app.request("/history/delete", { names });
      app.notify(`${names.length === 1 ? calledShortly(names[0]) : `${names.length} runs`}: in the bin. Bin… brings them back.`);
      names.forEach((name) => ticked.delete(name));
      if (names.includes(chosen)) open([]);
      await load();
    } catch (error) {
      app.notify(error.message, "error");
    }
  }
  async function binDialog() {
    const names = await app.request("/history/bin").catch((error) => (app.notify(error.message, "error"), []));
    openDialog("The bin", (close) => {
      const restore = async (name, row) => {
        try {
          await app.request("/history/restore", { name });
          row.remove();
          await load();
        } catch (error) {
          app.notify(error.message, "error");
        }
      };
      const items = names.map((name) => {
        const row = h("li", {}, h("span", { class: "name" }, name), h("button", { type: "button", class: "small", "aria-label": `Restore ${name}`, onclick: () => restore(name, row) }, "Restore"));
        return row;
      });
      return h("div", {}, h("ul", { class: "recordings choices" }, ...(items.length ? items : [h("li", { class: "soft" }, "The bin is empty.")])),
        h("p", { class: "soft small-text" }, "It is the folder .bin; nothing is ever taken out of it but by you."),
        h("div", { class: "row end" }, h("button", { type: "button", onclick: close }, "Close")));
    });
  }

  const offs = [app.stream.on("recordings", later), app.stream.on("fit", (message) => message.phase === "done" && later()),
    app.stream.on("connection", ({ state }) => state === "connected" && load())];
  right.append(nothing());
  await load();
  const wanted = new URLSearchParams(location.hash.split("?")[1] ?? "").getAll("run");
  if (wanted.length) await open(wanted);
  else if (location.hash.endsWith("?log")) await openLog();
  return () => { offs.forEach((off) => off()); clearTimeout(timer); leave(); };
}

/** "2026-11-22 12:46" of a row. */
export function whenOf(row) {
  const told = new Date(row.begun);
  return isoTime(Number.isNaN(told.getTime()) ? new Date(1000 * row.changed) : told);
}
/** The same of any date; timeStyle "medium" has the seconds too. Swedish is written as ISO 8601 is. */
export const isoTime = (date, timeStyle = "short") => date.toLocaleString("sv-SE", { dateStyle: "short", timeStyle });
