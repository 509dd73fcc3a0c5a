// The instruments on the desk: added, bound, arranged, taken away; kept with the experiment file.

import { h, openDialog } from "./dom.js";
import { bound, makeInstrument } from "./instruments.js";

export function makeArrangement(bench) {
  const element = h("div", { class: "instruments" });
  let made = [];
  let key = "";
  let arranging = false;
  let dragged = -1; // the instrument that a pointer moves
  let focus = null; // [index, "move" or "size"]: who works by the keyboard stays where they were

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

  /** Above each instrument: a handle to move it by, a corner to size it by, for a pointer or for the arrow keys. */
  function handles(spec, index) {
    const called = spec.title || spec.kind;
    const sized = (width, height) => changed(index, { width: Math.min(Math.max(width, 1), 12), height: Math.min(Math.max(height, 1), 12) });
    const keys = (what, act) => (event) => {
      const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
      if (!way) return;
      event.preventDefault();
      focus = [what === "move" ? Math.min(Math.max(index + way[0] + way[1], 0), specs().length - 1) : index, what];
      act(...way);
    };
    const grip = h("button", { type: "button", class: "small grip", "data-grip": `${index} move`, title: "Drag it to another place; or arrow keys",
      "aria-label": `Move ${called}: place ${index + 1} of ${specs().length}; arrow keys`, onkeydown: keys("move", (x, y) => move(index, index + x + y)),
      onpointerdown: (event) => drag(event, index) }, "⠿ ", called);
    const corner = h("button", { type: "button", class: "corner", "data-grip": `${index} size`, title: "Drag to another size; or arrow keys",
      "aria-label": `Size of ${called}: ${spec.width} of 12 wide, ${spec.height} high; arrow keys`, onkeydown: keys("size", (x, y) => sized(spec.width + x, spec.height + y)),
      onpointerdown: (event) => stretch(event, spec, sized) });
    return [h("div", { class: "handles" }, grip, h("span", { class: "grow" }),
      h("button", { type: "button", class: "small", "aria-label": `Change ${called}`, onclick: () => addDialog(null, spec, index) }, "Change…"),
      h("button", { type: "button", class: "small", "aria-label": `Remove ${called}`, onclick: () => store(specs().filter((_, i) => i !== index)) }, "Remove")), corner];
  }
  /** What a pointer does from when it came down on a handle. */
  function follow(event, moved, ended) {
    if (event.button) return;
    const { currentTarget: on, pointerId } = event;
    on.setPointerCapture(pointerId);
    on.onpointermove = moved;
    on.onpointerup = on.onpointercancel = (last) => {
      on.onpointermove = on.onpointerup = on.onpointercancel = null;
      ended(last);
    };
  }
  function drag(event, index) {
    const cards = [...element.querySelectorAll(".instrument")];
    const under = (at) => cards.findIndex((card) => {
      const box = card.getBoundingClientRect();
      return at.clientX >= box.left && at.clientX <= box.right && at.clientY >= box.top && at.clientY <= box.bottom;
    });
    dragged = index;
    follow(event, (at) => {
      const to = under(at);
      cards.forEach((card, i) => { card.classList.toggle("dragged", i === index); card.classList.toggle("target", i === to && i !== index); });
    }, (at) => {
      const to = at.type === "pointerup" ? under(at) : -1;
      dragged = -1;
      cards.forEach((card) => card.classList.remove("dragged", "target"));
      if (to >= 0 && to !== index) move(index, to);
    });
  }
  function stretch(event, spec, sized) {
    const card = event.currentTarget.closest(".instrument"), from = card.getBoundingClientRect();
    const to = (at) => [Math.round(spec.width * (1 + (at.clientX - event.clientX) / from.width)), Math.round(spec.height * (1 + (at.clientY - event.clientY) / from.height))];
    follow(event, (at) => {
      const [width, height] = to(at);
      card.dataset.size = `${Math.min(Math.max(width, 1), 12)} × ${Math.min(Math.max(height, 1), 12)}`;
    }, (at) => {
      delete card.dataset.size;
      if (at.type === "pointerup") sized(...to(at));
    });
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
        const card = h("article", { class: `card instrument ${spec.kind}-card`, "aria-label": spec.title || spec.kind }, ...(arranging ? handles(spec, i) : []), made[i].element);
        card.style.flex = `${spec.width} 1 0`;
        return card;
      }));
      row.classList.toggle("tall", height > 1);
      row.style.setProperty("--strips", Math.max(...members.map((i) => (specs()[i].kind === "plotter" ? specs()[i].variables.length : 1))));
      row.style.setProperty("--height", height);
      return row;
    }));
    element.classList.toggle("arranging", arranging);
    if (focus && arranging) element.querySelector(`[data-grip="${focus.join(" ")}"]`)?.focus();
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
      const submit = async () => {
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
