// The Studies page: how far the studies of the folder are, and a picture of each; begun here, stopped anywhere.

import { palette, SHADES } from "./design_pictures.js";
import { h } from "./dom.js";
import { styled } from "./elements.js";
import { latestWins } from "./latest.js";
import { makePicture } from "./picture.js";
import { formatQuantity } from "./quantity.js";
import { makeChoice } from "./sliders.js";
import { unpack } from "./stream.js";

const CELLS = [["median", "median"], ["tenth", "10 % are below"], ["nine_tenths", "90 % are below"], ["least", "least"], ["greatest", "greatest"], ["count", "members"], ["failed", "share that fails"]];
const OFTEN = 2000; // ms between looks at the studies
const spoken = (name) => name.replaceAll("_", " ");
const kept = { name: "", choices: {} }; // while other pages are looked at

export async function mount(element, app) {
  await Promise.all(["./history.css", "./design.css", "./studies.css"].map(styled));
  let state = null, picture = null, shown = "";

  const act = (what, body) => () => app.request(`/studies/${what}`, body()).then(({ name }) => open(name), say);
  const button = (text, does, more = {}) => h("button", { type: "button", onclick: does, ...more }, text);
  const fault = h("p", { class: "fault", role: "alert" }), list = h("ul", { tabIndex: 0, "aria-label": "Studies of the folder" });
  const empty = h("p", { class: "soft" }, "No study is here yet: put a study file into the folder, or a store.");
  const file = h("select"), begin = button("Start study", act("begin", () => ({ file: file.value })), { class: "primary" });
  const title = h("h2"), said = h("p", { role: "status" }), bar = h("progress", { "aria-label": "Done" }), facts = h("dl", { class: "history-facts" });
  const goOn = button("Continue", act("begin", () => ({ file: state.file || file.value, name: kept.name })), { class: "primary" });
  const stop = button("Stop", act("stop", () => ({ name: kept.name })), { title: "On any machine" });
  const choices = h("div", { class: "studies-choose" }), canvas = h("div", { class: "studies-canvas" });
  const at = h("p", { class: "number studies-at", role: "status" }), of = h("p", { class: "soft small-text" });
  const ends = [h("output"), h("output")], key = h("p", { class: "soft small-text design-key" }, ends[0], h("span", { class: "ramp" }), ends[1]);
  const card = (label, ...content) => h("section", { class: "card history-run", "aria-label": label }, ...content);
  const look = card("Picture", h("h2", {}, "Results so far"), choices, canvas, key, at, of);
  const right = h("div", { class: "history-right", hidden: true }, card("The study", title, said, bar, facts, h("div", { class: "row" }, goOn, stop)), look);
  element.append(h("h1", { class: "visually-hidden" }, "Studies"), h("div", { class: "history studies" },
    h("section", { class: "card history-list", "aria-label": "All studies" }, empty, list, h("label", { class: "field" }, h("span", {}, "Study file"), file), begin, fault), right));
  const say = (error) => { fault.textContent = error.message; };
  function open(name) {
    fault.textContent = "";
    right.hidden ||= name !== kept.name;
    kept.name = name;
    looks.want(name);
  }

  const looks = latestWins({
    share: 0.5,
    async ask(name) {
      const found = await app.request("/studies");
      name ||= found.stores[0]?.name ?? "";
      return { ...found, name, state: name && await app.request("/studies/state", { name }) };
    },
    take(answer) {
      ({ name: kept.name, state } = answer);
      listed(answer);
      if (state) told();
    },
    refuse: say,
  });
  function listed({ files, stores }) {
    empty.hidden = stores.length || files.length;
    begin.disabled = file.disabled = !files.length;
    const now = JSON.stringify([files, stores.map((row) => [row.name, row.runs]), kept.name]);
    if (list.dataset.now === now) return;
    list.dataset.now = now;
    const [focused, chosen] = [document.activeElement?.dataset?.study, file.value];
    file.replaceChildren(...files.map((name) => new Option(name, name, false, name === chosen)));
    list.replaceChildren(...stores.map(({ name, runs }) => h("li", { class: name === kept.name && "shown" }, button(name, () => open(name), { class: "link", "data-study": name }), runs ? " runs here" : null)));
    if (focused) list.querySelector(`[data-study="${CSS.escape(focused)}"]`)?.focus();
  }
  function told() {
    const whole = state.share === 1;
    right.hidden = false;
    right.dataset.share = bar.value = state.share ?? 0;
    title.textContent = state.title || state.name;
    said.textContent = state.said;
    said.className = state.wrong ? "fault" : "";
    look.hidden = facts.hidden = bar.hidden = !state.rows;
    stop.disabled = !state.grows;
    goOn.disabled = !state.rows || whole || state.runs || !(state.file || file.value);
    if (!state.rows) return;
    facts.replaceChildren(...state.rows.map(([name, text]) => h("div", {}, h("dt", {}, name), h("dd", { class: "number" }, text))));
    if (choices.dataset.of !== kept.name) choose(state);
    draw();
  }
  function choose({ varied, results }) {
    choices.dataset.of = kept.name;
    const now = (kept.choices[kept.name] ??= { result: results[0]?.name, across: varied[0]?.name, up: varied[1]?.name ?? "", statistic: "median" });
    const choice = (label, field, options) => makeChoice(label, options, now[field], (value) => { now[field] = value; draw(); }).element;
    const [found, given] = [results, varied].map((some) => some.map(({ name }) => [name, spoken(name)]));
    choices.replaceChildren(choice("Result", "result", found), choice("Across", "across", given), choice("Upwards", "up", [...given, ["", "the result itself"]]), choice("In each cell", "statistic", CELLS));
  }

  function draw() {
    const wish = { name: kept.name, ...kept.choices[kept.name] }, now = JSON.stringify([wish, state.share]);
    if (shown !== now) pictures.want(wish);
    shown = now;
  }
  const pictures = latestWins({
    share: 0.3,
    ask: (wish) => app.request("/studies/picture", wish),
    take: (answer, wish) => wish.name === kept.name && paint(wish, unpack(answer)),
    refuse(error) { of.textContent = error.message; at.textContent = ""; canvas.hidden = key.hidden = true; },
  });
  function paint({ result, across, up, statistic }, { header, arrays: [x, y, cells] }) {
    const unit = (name) => [...state.varied, ...state.results].find((one) => one.name === name).unit;
    const axis = (name, log) => ({ label: spoken(name), unit: unit(name), log });
    const axes = { x: axis(across, header.log[0]), y: axis(up || result, header.log[1]) };
    const number = (one) => (!up || statistic === "count" ? one.toLocaleString("en") : statistic === "failed" ? `${Number((100 * one).toPrecision(3))} %` : formatQuantity(one, unit(result)));
    const there = cells.filter(Number.isFinite), wide = x.length - 1;
    const [low, high] = [Math.min(...there), Math.max(...there)];
    const scale = low > 0 && high / low > 30 ? Math.log : (one) => one;
    const share = (value) => (scale(value) - scale(low)) / (scale(high) - scale(low) || 1);
    let cursor = null;
    const focused = picture?.element === document.activeElement;
    picture?.destroy();
    canvas.hidden = key.hidden = false;
    picture = makePicture(canvas, {
      label: `${spoken(result)} over ${spoken(across)} and ${axes.y.label}`, ...axes,
      draw(context, to, css) {
        const shades = palette([css("--sunk"), css("--series-1"), css("--text")]);
        const box = (column, row) => [to.x(x[column]), to.y(y[row + 1]), to.x(x[column + 1]) - to.x(x[column]) + 0.5, to.y(y[row]) - to.y(y[row + 1]) + 0.5];
        cells.forEach((value, i) => {
          if (!Number.isFinite(value)) return;
          context.fillStyle = shades[Math.round(share(value) * (SHADES - 1))];
          context.fillRect(...box(i % wide, Math.floor(i / wide)));
        });
        if (!cursor) return;
        context.strokeStyle = css("--series-2");
        context.strokeRect(...box(...cursor));
      },
      pick: (px, py, to) => point(x.findLastIndex((edge) => edge <= to.fromX(px)), y.findLastIndex((edge) => edge <= to.fromY(py))),
      step: (dx, dy) => point((cursor?.[0] ?? 0) + dx, (cursor?.[1] ?? 0) + dy),
    });
    picture.setRange({ x: [x[0], x.at(-1)], y: [y[0], y.at(-1)] });
    if (focused) picture.element.focus();
    function point(column, row) {
      cursor = [Math.min(Math.max(column, 0), wide - 1), Math.min(Math.max(row, 0), y.length - 2)];
      const between = (edges, i, one) => `${one.label} ${formatQuantity(edges[i], one.unit, 3)} to ${formatQuantity(edges[i + 1], one.unit, 3)}`;
      const value = cells[cursor[1] * wide + cursor[0]];
      at.textContent = `${between(x, cursor[0], axes.x)}, ${between(y, cursor[1], axes.y)}: ${Number.isFinite(value) ? number(value) : "no member"}`;
      picture.redraw();
    }
    at.textContent = "Select a cell by pointer or arrow keys.";
    [ends[0].textContent, ends[1].textContent] = [number(low), number(high)];
    of.textContent = header.said;
    right.dataset.pictures = String(Number(right.dataset.pictures ?? 0) + 1);
  }

  const timer = setInterval(() => document.hidden || looks.busy || looks.want(kept.name), OFTEN);
  looks.want(kept.name);
  return () => {
    clearInterval(timer);
    looks.end();
    pictures.end();
    picture?.destroy();
  };
}
