// The log: who did what, when, from where and why; of the panel and of the rig on its bench.

import { h } from "./dom.js";
import { isoTime } from "./history.js";

/** Shows it in `room`; returns what ends it. */
export async function showLog(room, app) {
  const search = h("input", { type: "search", placeholder: "words: armed, limits, a name, a reason \u2026", "aria-label": "Search the log", oninput: later });
  const body = h("tbody"), none = h("p", { class: "soft", role: "status" });
  const heads = ["When", "What", "Why", "Who", "From"].map((one) => h("th", {}, one));
  room.replaceChildren(h("section", { class: "card history-log", "aria-label": "Log" }, h("h2", {}, "Log"),
    h("p", { class: "soft" }, "Every act on the panel and on the rig, newest first. The files log.jsonl in the panel's and the rig's folders are only appended to."), search, none,
    h("div", { class: "history-table", tabIndex: 0, role: "group", "aria-label": "Lines of the log" }, h("table", {}, h("thead", {}, h("tr", {}, ...heads)), body))));
  let timer = 0, asked = 0;
  function later() { clearTimeout(timer); timer = setTimeout(load, 200); }
  async function load() {
    const mine = ++asked;
    try {
      const { rows } = await app.request(`/history/log?${new URLSearchParams({ search: search.value })}`);
      if (mine !== asked) return;
      none.textContent = rows.length ? "" : search.value ? "No line has all these words." : "Nothing was done yet.";
      body.replaceChildren(...rows.map((one) => h("tr", { "data-level": one.level },
        h("td", { class: "number when-cell" }, isoTime(new Date(one.time), "medium")), h("td", {}, one.what), h("td", {}, one.why),
        h("td", {}, one.who), h("td", { class: "soft" }, [one.of, one.where].filter(Boolean).join(", ")))));
    } catch (error) {
      app.notify(error.message, "error");
    }
  }
  const off = app.stream.on("log", later);
  await load();
  return () => { off(); clearTimeout(timer); };
}
