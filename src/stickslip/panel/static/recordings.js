// The recordings of the folder: open, compare, rename, export.

import { h, openDialog } from "./dom.js";
import { shortName } from "./livedata.js";

const MOST_SHOWN = 300;

export function makeRecordings(bench) {
  const list = h("ul", { class: "recordings" });
  const back = h("button", { type: "button", class: "small", hidden: true, onclick: () => bench.show({ live: true, recordings: [] }) }, "Show the live run");
  const search = h("input", { type: "search", placeholder: "find a recording", "aria-label": "Find a recording", oninput: update });
  const own = h("label", { class: "choice", hidden: true }, h("input", { type: "checkbox", onchange: (event) => bench.show({ live: event.target.checked }) }), h("span", {}, "Compare with the live run"));
  const element = h("div", {}, back, own, search, list);
  let found = [];
  /** What is ticked is what is shown: the live run too is ticked, or not. */
  function tick(name, on) {
    const others = bench.shown.recordings.filter((one) => one !== name);
    const recordings = on ? [...others, name].slice(-5) : others;
    const first = on && !others.length && bench.shown.live && !busy();
    bench.show({ recordings, live: recordings.length ? bench.shown.live && !first : true });
  }
  const busy = () => ["preparing", "running", "stopping"].includes(bench.run.phase);

  async function build() {
    try {
      found = await bench.app.request("/recordings");
      update();
    } catch (error) {
      bench.app.notify(error.message, "error");
    }
  }
  function update() {
    const { live, recordings } = bench.shown;
    back.hidden = live && !recordings.length;
    const open = document.activeElement?.dataset?.recording;
    const words = search.value.toLowerCase().split(/\s+/);
    search.hidden = found.length < 6;
    const wanted = found.filter(({ name }) => words.every((word) => name.toLowerCase().includes(word)));
    list.replaceChildren(...wanted.slice(0, MOST_SHOWN).map(({ name, bytes, unfinished }) => {
      const shown = recordings.includes(name);
      const compare = h("input", { type: "checkbox", checked: shown, "aria-label": `Compare ${shortName(name)}`, onchange: () => tick(name, !shown) });
      return h("li", { class: shown ? "shown" : "" },
        h("label", { class: "compare", title: "Compare: show it with the others" }, compare),
        h("button", { type: "button", class: "small quiet name", title: `${name}, ${(bytes / 1000).toFixed(0)} kB`, "data-recording": name, onclick: () => bench.show({ live: false, recordings: [name] }) }, shortName(name), unfinished ? h("span", { class: "soft" }, " · stopped") : null),
        h("button", { type: "button", class: "small quiet", "aria-label": `Rename ${shortName(name)}`, title: "Rename", onclick: () => renameDialog(bench, name, (to) => { bench.show({ recordings: bench.shown.recordings.map((one) => (one === name ? to : one)) }); build(); }) }, "✎"),
        h("button", { type: "button", class: "small quiet", "aria-label": `Export ${shortName(name)}`, title: "Export", onclick: () => exportDialog(name) }, "⤓"));
    }));
    own.hidden = !recordings.length || !bench.live.data.filled;
    own.querySelector("input").checked = live;
    if (wanted.length > MOST_SHOWN) list.append(h("li", { class: "soft" }, `${wanted.length - MOST_SHOWN} more: search for them.`));
    if (found.length && !wanted.length) list.append(h("li", { class: "soft" }, "None is called so."));
    if (!found.length) list.append(h("li", { class: "soft" }, "None yet: press Start."));
    if (open) list.querySelector(`[data-recording="${CSS.escape(open)}"]`)?.focus();
  }
  return { element, build, update };
}

/** Ask for another name; `renamed(to)` when it has it. */
export function renameDialog(bench, name, renamed) {
  openDialog("Rename the recording", (close) => {
    const parts = name.split("/");
    const field = h("input", { id: "rename", value: parts.at(-1).replace(/\.nc$/, ""), spellcheck: false });
    const rename = async () => {
      const to = [...parts.slice(0, -1), `${field.value.replace(/\.nc$/, "")}.nc`].join("/");
      if (to === name) return close();
      if (await bench.act("/recordings/rename", { name, to })) {
        close();
        renamed(to);
      }
    };
    return h("form", { onsubmit: rename }, h("div", { class: "field" }, h("label", { htmlFor: "rename" }, `Name in ${parts.slice(0, -1).join("/") || "the folder"}`), field),
      h("div", { class: "row end" }, h("button", { type: "button", onclick: close }, "Cancel"), h("button", { class: "primary" }, "Rename")));
  });
}

export async function exportDialog(name) {
  const formats = await (await fetch("/recordings/formats")).json();
  openDialog(`Export ${shortName(name)}`, (close) => h("div", {},
    h("div", { class: "choices" }, ...formats.map(([kind, text]) =>
      h("a", { class: "button", href: `/recordings/export?${new URLSearchParams({ name, kind })}`, download: "", onclick: () => setTimeout(close) }, text))),
    h("div", { class: "row end" }, h("button", { type: "button", onclick: close }, "Cancel"))));
}
