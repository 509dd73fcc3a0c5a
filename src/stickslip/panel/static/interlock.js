// The interlock of the rig, at the top of every page: armed or not, permits, a fault that waits to be acknowledged.

import { h, openDialog } from "./dom.js";

const WORDS = { armed: "Armed", disarmed: "Not armed", withheld: "Permit missing", fault: "Fault" };
const MEANING = {
  armed: "The output is enabled: a run may start.",
  disarmed: "The output is not enabled. Arm it on purpose; no run starts before.",
  withheld: "A permit is missing. No run starts before it is given.",
  fault: "A fault ended a run. Look at the rig, then acknowledge it with a reason; no run starts before.",
  simulated: "This rig is simulated: there is no output to enable. Faults and permits are those of a real one.",
};

/** Keeps the button and the bar of a fault; asks by `app.request`. */
export function makeInterlock(app, button, bar) {
  let state = { state: "disarmed", simulated: true, fault: "", since: "", permits: {}, site: [] };
  let refresh = () => {};
  const free = () => state.simulated && state.state === "disarmed";

  function show() {
    button.textContent = free() ? "Simulated" : WORDS[state.state];
    button.dataset.state = free() ? "simulated" : state.state;
    bar.hidden = state.state !== "fault";
    bar.replaceChildren(h("span", {}, `Fault: ${state.fault}`), h("button", { type: "button", class: "small", onclick: open }, "Acknowledge…"));
    refresh();
  }

  function open() {
    const dialog = openDialog("Interlock", (close) => {
      const why = h("input", { id: "interlock-why", maxLength: 400, autocomplete: "off" });
      const fault = h("p", { class: "fault", role: "alert" });
      const ask = async (what, body = {}) => {
        fault.textContent = "";
        try {
          await app.request(`/interlock/${what}`, { why: why.value, ...body });
          why.value = "";
        } catch (error) { fault.textContent = error.message; }
      };
      const act = (text, what, kind = "", body = {}) => h("button", { type: "button", class: kind, onclick: () => ask(what, body) }, text);
      const now = h("div", {}), acts = h("div", { class: "row" });
      refresh = () => {
        const shown = free() ? "simulated" : state.state;
        now.replaceChildren(...[
          h("p", {}, h("strong", { id: "interlock-state" }, free() ? "Simulated" : WORDS[state.state])),
          h("p", { class: "soft" }, MEANING[shown]),
          state.fault && h("p", { class: "latched" }, `${state.since}: ${state.fault}`),
          state.armed_by && h("p", { class: "soft" }, `Armed by ${state.armed_by}.`),
          h("table", { class: "permits" }, h("caption", {}, "Permits"), h("tbody", {}, ...Object.entries(state.permits).map(([name, one]) => h("tr", {},
            h("th", { scope: "row" }, name),
            h("td", { class: one.given ? "" : "missing" }, one.given ? "given" : `missing: ${one.who}, ${one.why}`),
            h("td", {}, act(one.given ? "Withdraw" : "Give", "permit", "small", { name, given: !one.given })))))),
          state.site.length > 0 && h("p", { class: "soft" }, `Limits of the site: ${state.site.join(", ")}.`),
        ].filter(Boolean));
        acts.replaceChildren(...[
          state.state === "fault" && act("Acknowledge the fault", "acknowledge", "primary"),
          shown === "disarmed" && act("Arm", "arm", "primary"),
          shown === "armed" && act("Disarm", "disarm"),
          h("span", { class: "grow" }), h("button", { type: "button", onclick: close }, "Close"),
        ].filter(Boolean));
      };
      refresh();
      return h("div", { class: "interlock" }, now, h("div", { class: "field" }, h("label", { htmlFor: "interlock-why" }, "Why (the log keeps it)"), why), fault, acts);
    });
    dialog.addEventListener("close", () => { refresh = () => {}; });
  }

  button.onclick = open;
  app.stream.on("interlock", (message) => { state = message; show(); });
  show();
}
