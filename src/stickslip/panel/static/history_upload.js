// A user's own file: sent, looked at (its columns, first values, guessed meanings and units), and then taken, or not.

import { h, openDialog } from "./dom.js";
import { formatQuantity } from "./quantity.js";

const NAMES = ["time", "drive_voltage", "end_effector_position", "stage_position", "sliding_displacement", "end_effector_velocity", "friction_force", "force", "position", "displacement", "voltage"];
const KINDS = ".csv,.txt,.tsv,.dat,.lvm,.mat,.npy,.npz,.mf4,.nc,.nxs";

export function uploadDialog(app, taken) {
  const dialog = openDialog("Import a file", (close) => {
    const fault = h("p", { class: "fault", role: "alert" });
    const place = h("div", {});
    const choose = h("input", { type: "file", id: "upload-file", accept: KINDS, onchange: () => send(choose.files[0]) });
    async function send(file) {
      if (!file) return;
      fault.textContent = "";
      place.replaceChildren(h("p", { class: "soft" }, "Reading …"));
      try {
        const look = await app.request(`/history/upload?${new URLSearchParams({ name: file.name })}`, file);
        dialog.classList.add("wide");
        place.replaceChildren(preview(app, look, fault, close, taken));
      } catch (error) {
        place.replaceChildren();
        fault.textContent = error.message;
      }
    }
    return h("div", {}, h("div", { class: "field" }, h("label", { htmlFor: "upload-file" }, "CSV or other text, MAT, MDF 4, NPY, NPZ, or a recording (.nc)"), choose), fault, place,
      h("div", { class: "row end" }, h("button", { type: "button", onclick: close }, "Cancel")));
  });
  return dialog;
}

function preview(app, look, fault, close, taken) {
  const name = h("input", { id: "upload-name", value: look.name.replace(/\.[^.]+$/, ""), spellcheck: false });
  const notes = h("input", { id: "upload-notes" });
  const rate = h("input", { id: "upload-rate", placeholder: "10 kHz", spellcheck: false });
  const drop = h("input", { type: "checkbox" });
  const whole = h("input", { type: "checkbox" });
  const read = look.cut ? look.complete : look.samples;
  const samples = look.first ? `the first ${look.samples} samples are looked at here, all ${look.cut ? "complete ones can be" : "are"} taken in` : `${read} ${look.cut ? "complete " : ""}samples`;
  const timed = look.columns.some((one) => one.guess === "time");
  const clash = (select) => rows.filter((one) => one.select !== select && one.select.value && one.select.value === select.value).length;
  const rows = look.columns.map((one) => {
    const names = [...new Set(["", ...NAMES, ...(one.guess ? [one.guess] : []), own(one.name)])];
    const select = h("select", { "aria-label": `What ${one.name} is`, disabled: !one.numeric }, ...names.map((each) => h("option", { value: each, selected: each === one.guess }, each === "" ? "leave out" : each.replaceAll("_", " "))));
    const unit = h("input", { value: one.unit || one.guessed_unit, "aria-label": `Unit of ${one.name}`, size: 6, spellcheck: false, disabled: !one.numeric });
    const said = one.unit ? "" : one.guessed_unit ? " guessed" : "";
    const values = one.numeric ? `${one.first.slice(0, 4).map((value) => (value === null ? "NaN" : formatQuantity(value, "", 4))).join(", ")} …` : "no numbers";
    const range = one.low === null ? "" : `${formatQuantity(one.low, "", 4)} to ${formatQuantity(one.high, "", 4)}`;
    return { one, select, unit, row: h("tr", {}, h("th", { scope: "row" }, one.name), h("td", {}, values, h("div", { class: "soft small-text" }, range)), h("td", {}, select), h("td", {}, unit, h("div", { class: "weak small-text" }, said))) };
  });
  async function take() {
    fault.textContent = "";
    const chosen = rows.filter(({ select }) => select.value);
    const twice = chosen.find(({ select }) => clash(select));
    if (twice) { fault.textContent = `Two columns are called ${twice.select.value.replaceAll("_", " ")}.`; return; }
    if (look.columns.length && !chosen.some(({ select }) => select.value !== "time")) { fault.textContent = "Say of at least one column what it is."; return; }
    try {
      const { name: made } = await app.request("/history/take", {
        token: look.token, name: name.value, notes: notes.value, sample_rate: rate.value.trim() || null, missing: drop.checked ? "drop" : "error", rows: whole.checked ? look.complete : null,
        columns: Object.fromEntries(chosen.map(({ one, select }) => [select.value, one.index])),
        units: Object.fromEntries(chosen.filter(({ unit }) => unit.value.trim()).map(({ select, unit }) => [select.value, unit.value.trim()])),
      });
      close();
      taken(made);
    } catch (error) {
      fault.textContent = error.message;
    }
  }
  return h("form", { onsubmit: take, noValidate: true },
    h("p", { class: "soft small-text" }, `${look.name}: ${samples}${look.columns.length ? ". Check what each column is, and its unit: guesses are marked." : ", a recording as it is."}`),
    look.cut ? h("p", { class: "weak small-text" }, `${look.cut[0].toUpperCase()}${look.cut.slice(1)}.`) : null,
    look.columns.length ? h("div", { class: "history-table", tabIndex: 0, role: "group", "aria-label": "Columns of the file" }, h("table", { class: "upload" }, h("thead", {}, h("tr", {}, h("th", {}, "Column"), h("th", {}, "Values"), h("th", {}, "Is"), h("th", {}, "Unit"))), h("tbody", {}, ...rows.map(({ row }) => row)))) : null,
    timed || !look.columns.length ? null : h("div", { class: "field" }, h("label", { htmlFor: "upload-rate" }, "Sample rate, for a file without a time"), rate),
    look.complete > 1 ? h("label", { class: "choice" }, whole, `Take only the complete rows: ${look.complete}`) : null,
    look.columns.length ? h("label", { class: "choice" }, drop, "Leave out samples without a number (empty, NaN, infinite)") : null,
    h("div", { class: "field" }, h("label", { htmlFor: "upload-name" }, "Name in the history"), name),
    h("div", { class: "field" }, h("label", { htmlFor: "upload-notes" }, "Notes"), notes),
    h("div", { class: "row end" }, h("button", { class: "primary" }, "Take it in")));
}

const own = (name) => name.toLowerCase().replace(/\[.*?\]|\(.*?\)/g, "").trim().replace(/\W+/g, "_").replace(/^_+|_+$/g, "") || "column";
