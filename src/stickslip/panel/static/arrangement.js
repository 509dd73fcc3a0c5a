// The instruments on the desk: added, bound, arranged, taken away; kept with the experiment file.

import { h, openDialog } from "./dom.js";
import { bound, makeInstrument } from "./instruments.js";

export function makeArrangement(bench) {
  const element = h("div", { class: "instruments" });
  let made = [];
  let key = "";
  let arranging = false;
  let dragged = -1;

  const specs = () => bench.experiment.panel;
  const store = (list) => bench.set(["panel"], list).catch((error) => bench.app.notify(error.message, "error"));
  const arrange = h("button", { type: "button", class: "small", "aria-pressed": "false", onclick: () => {
    arranging = !arranging;
    arrange.setAttribute("aria-pressed", String(arranging));
    key = "";
    build();
  } }, "Arrange");
  const add = h("button", { type: "button", class: "small", onclick: addDialog }, "Add instrument…");

  function changed(index, change) {
    const list = specs().map((one) => ({ ...one }));
    Object.assign(list[index], change);
    return store(list);
  }
  function move(index, to) {
    const list = [...specs()];
    const [one] = list.splice(index, 1);
    list.splice(Math.min(Math.max(to, 0), list.length), 0, one);
    return store(list);
  }

  function handles(spec, index) {
    const button = (text, label, act) => h("button", { type: "button", class: "small", "aria-label": `${label}: ${spec.title || spec.kind}`, title: label, onclick: act }, text);
    const size = (name, by) => () => changed(index, { [name]: Math.min(Math.max(spec[name] + by, 1), 12) });
    return h("div", { class: "handles" },
      button("←", "Earlier", () => move(index, index - 1)), button("→", "Later", () => move(index, index + 1)),
      button("⇤", "Narrower", size("width", -1)), button("⇥", "Wider", size("width", 1)),
      button("−", "Lower", size("height", -1)), button("+", "Higher", size("height", 1)),
      button("✎", "Variables", () => addDialog(null, spec, index)),
      button("✕", "Take away", () => store(specs().filter((_, i) => i !== index))));
  }

  /** Rows of up to twelve twelfths, as high as their highest instrument. */
  function rows() {
    const found = [];
    let room = 0;
    specs().forEach((spec, index) => {
      if (spec.width > room || !found.length) { found.push([]); room = 12; }
      found.at(-1).push(index);
      room -= spec.width;
    });
    return found;
  }

  function build() {
    const now = JSON.stringify([specs(), bench.experiment.channels, arranging]);
    if (now === key) { made.forEach((one) => one.element && one.kind === "input" && one.update()); values(); return; }
    key = now;
    made.forEach((one) => one.destroy());
    made = specs().map((spec) => ({ ...makeInstrument(bench, spec), kind: spec.kind }));
    element.replaceChildren(...rows().map((members) => {
      const height = Math.max(...members.map((i) => specs()[i].height));
      const row = h("div", { class: "instrument-row" }, ...members.map((i) => {
        const spec = specs()[i];
        const card = h("article", { class: `card instrument ${spec.kind}-card`, "aria-label": spec.title || spec.kind, draggable: arranging }, arranging ? handles(spec, i) : null, made[i].element);
        card.style.flex = `${spec.width} 1 0`;
        if (arranging) {
          card.addEventListener("dragstart", () => (dragged = i));
          card.addEventListener("dragover", (event) => event.preventDefault());
          card.addEventListener("drop", (event) => { event.preventDefault(); if (dragged >= 0 && dragged !== i) move(dragged, i); dragged = -1; });
        }
        return card;
      }));
      row.classList.toggle("tall", height > 1);
      row.style.setProperty("--strips", Math.max(...members.map((i) => (specs()[i].kind === "plotter" ? specs()[i].variables.length : 1))));
      row.style.setProperty("--height", height);
      return row;
    }));
    if (!made.length) element.append(h("p", { class: "soft" }, "No instruments yet: add one."));
  }

  function addDialog(_, spec = { kind: "plotter", variables: [], title: "", width: 12, height: 4 }, index = -1) {
    return openDialog(index < 0 ? "Add an instrument" : "Change the instrument", (close) => {
      const kind = h("select", { id: "instrument-kind", onchange: list }, ...["plotter", "display", "input"].map((one) => h("option", { value: one, selected: one === spec.kind }, one)));
      const title = h("input", { id: "instrument-title", value: spec.title, maxLength: 60 });
      const filter = h("input", { id: "instrument-filter", placeholder: "find a variable", "aria-label": "Find a variable", oninput: list });
      const choices = h("div", { class: "choices", role: "group", "aria-label": "Variables" });
      const chosen = new Set(spec.variables);
      function list() {
        const channels = [...bench.experiment.channels, bound(bench, "position")];
        const of = { plotter: bench.experiment.channels, display: [...channels, ...bench.experiment.variables], input: bench.experiment.variables }[kind.value];
        choices.replaceChildren(...of.filter((one) => `${one.name} ${one.label}`.toLowerCase().includes(filter.value.toLowerCase())).map((one) =>
          h("label", { class: "choice" }, h("input", { type: "checkbox", checked: chosen.has(one.name), onchange: (event) => (event.target.checked ? chosen.add(one.name) : chosen.delete(one.name)) }),
            h("span", {}, one.label), h("span", { class: "soft" }, one.unit ? `${one.name} [${one.unit}]` : one.name))));
      }
      list();
      const submit = async (event) => {
        event.preventDefault();
        if (!chosen.size) return bench.app.notify("Choose a variable.", "warning");
        const sizes = index < 0 ? (kind.value === "plotter" ? { width: 12, height: 4 } : { width: 3, height: 1 }) : { width: spec.width, height: spec.height };
        const one = { kind: kind.value, variables: [...chosen], title: title.value, ...sizes };
        await store(index < 0 ? [...specs(), one] : specs().map((old, i) => (i === index ? one : old)));
        close();
      };
      return h("form", { onsubmit: submit },
        h("div", { class: "field" }, h("label", { htmlFor: "instrument-kind" }, "Kind"), kind),
        h("div", { class: "field" }, h("label", { htmlFor: "instrument-title" }, "Title"), title),
        filter, choices,
        h("div", { class: "row end" }, h("button", { type: "button", onclick: close }, "Cancel"), h("button", { class: "primary" }, index < 0 ? "Add" : "Change")));
    });
  }

  function values() {
    made.forEach((one) => one.kind === "display" && one.update());
  }
  return {
    element, build, values, buttons: [arrange, add],
    update: () => made.forEach((one) => one.update()),
    destroy: () => made.forEach((one) => one.destroy()),
  };
}
