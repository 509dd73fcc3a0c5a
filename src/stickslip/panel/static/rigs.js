// The rig: what it can do, and another one.

import { h, openDialog } from "./dom.js";
import { formatQuantity as of } from "./quantity.js";

/** A button that says which rig is on the bench, and opens what can be chosen. */
export function makeRig(bench) {
  const name = h("span", {}, "Rig");
  const element = h("button", { type: "button", class: "small quiet", id: "rig", title: "What the rig can do; choose another", onclick: open }, name, "…");
  const show = () => (name.textContent = bench.experiment.rig.name);

  function open() {
    return openDialog("Rig", (close) => {
      const list = h("div", { class: "choices" }, "…");
      const fault = h("p", { class: "fault", role: "alert" });
      const choose = async (asked) => {
        fault.textContent = "";
        try {
          const { left_out: left } = await bench.app.request("/bench/rig", asked);
          close();
          if (left.length) bench.app.notify(`Left out here (Undo brings it back): ${left.join("; ")}`);
        } catch (error) { fault.textContent = error.message; }
      };
      bench.app.request("/bench/rigs").then(({ rigs, connected }) => list.replaceChildren(
        ...rigs.map((one) => one.bench ? h("button", { type: "button", onclick: () => choose({ kind: one.kind, bench: one.bench }) }, one.device) : backEnd(one, choose)),
        h("p", { class: "soft" }, connected.length ? `Connected: ${connected.map((one) => `${one.where} (${one.says})`).join(", ")}` : "Nothing that can be seen is connected to this machine."),
      )).catch((error) => (fault.textContent = error.message));
      return h("div", {}, facts(bench.experiment.rig), h("h3", {}, "Choose another"), list, fault,
        h("div", { class: "row end" }, h("button", { type: "button", onclick: close }, "Cancel")));
    });
  }
  return { element, show };
}

function backEnd(one, choose) {
  const options = h("input", { "aria-label": `Options of ${one.kind}`, value: one.options, spellcheck: false });
  return h("details", {}, h("summary", {}, one.device),
    h("form", { onsubmit: () => choose({ kind: one.kind, options: options.value }) },
      h("p", { class: "soft" }, `${one.does}; samples ${one.samples}. Safe state: ${one.safe_state}. Verified against ${one.verified}.`),
      options, h("button", { class: "small" }, `Use ${one.kind}`)));
}

/** End stops, those that there are. */
function stops({ min_position: low, max_position: high }, unit) {
  const ends = [low, high].filter((one) => one !== undefined).map((one) => of(one, unit));
  return ends.length ? `, end stop${ends.length > 1 ? "s" : ""} at ${ends.join(" and ")}` : "";
}

function facts(rig) {
  const { limits } = rig;
  const rows = [
    ["Output", `${of(rig.min_voltage, "V")} to ${of(rig.max_voltage, "V")} in steps of ${of(rig.step, "V")}, at ${of(rig.update_rate, "Hz")}`],
    ["Samples", `at ${of(rig.sample_rate, "Hz")}, ${rig.max_points.toLocaleString("en")} at most, ${rig.streams ? "as they are taken" : "when the run is over: end stops are watched only then"}`],
    ["Jitter of the begin", rig.jitter ? of(rig.jitter, "s") : "none: one clock"],
    ["Inputs", Object.entries(rig.inputs).map(([input, unit]) => `${input} (${unit})`).join(", ")],
    ["Limits", `${of(limits.min_voltage, "V")} to ${of(limits.max_voltage, "V")}${limits.max_slew ? `, ${of(limits.max_slew, "V/s")}` : ""}${stops(limits, rig.unit)}; stops at ${of(limits.stop_slew, "V/s")}`],
    ["Safe state", rig.safe_state],
    ...(rig.verified ? [["Verified against", rig.verified]] : []),
  ];
  return h("table", { class: "facts" }, h("caption", {}, rig.name), h("tbody", {}, ...rows.map(([what, said]) => h("tr", {}, h("th", { scope: "row" }, what), h("td", {}, said)))));
}
