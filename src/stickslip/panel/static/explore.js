// The Explore page: every slider redraws the motion, the friction loop and the step curves while it moves.

import { begin, changed, finite, fromLink, kindOf, loopOf, makeHistory, modelFields, resampled, toLink, wire, withLaw, withShape } from "./explore_state.js";
import { latestWins } from "./latest.js";
import { makePlot } from "./plot.js";
import { formatQuantity } from "./quantity.js";
import { makeChoice, makeSlider, makeSwitch } from "./sliders.js";
import { unpack } from "./stream.js";
import { button, make, showDialog, styled } from "./elements.js";

const MOST_PINS = 3;
const PIN_COLOURS = ["--series-4", "--series-5", "--series-6"];
const CURVE_SHARE = 0.3; // of the time: a pair of step curves costs some twenty motions

const named = (answer) => {
  const { header, arrays } = unpack(answer);
  return { ...header, ...Object.fromEntries(header.names.map((name, i) => [name, arrays[i]])) };
};

export async function mount(element, app) {
  await styled("./explore.css");
  const choices = await app.request("/api/explore/choices");
  const link = () => (location.hash.startsWith("#explore?") ? fromLink(choices, location.hash.slice("#explore?".length)) : null);
  const linked = link();
  let state = linked?.state ?? begin(choices);
  let pins = []; // { label, state, motion, steps }
  let motion = null, steps = null; // the last good ones
  const of = { motion: null, steps: null }; // the states that they are of
  let history = makeHistory(state);
  let touched = ""; // the field that was changed last, for the name of a pin
  const ending = [];

  // --- frame
  const title = make("h1", { className: "visually-hidden", textContent: "Explore" });
  const bar = make("div", { className: "explore-bar" });
  const panel = make("section", { className: "card explore-sliders" });
  panel.setAttribute("aria-label", "Parameters");
  const stage = make("div", { className: "explore-plots" });
  const root = make("div", { className: "explore" });
  const problem = make("p", { className: "fault explore-problem" });
  problem.setAttribute("role", "alert");
  const late = make("p", { className: "soft explore-problem", textContent: "The rest of the step curves is left out: this law takes too long for it.", hidden: true });
  const right = make("div", { className: "explore-right" }, bar, problem, late, stage);
  root.append(panel, right);
  element.append(title, root);

  const undo = button("Undo", "Undo (Ctrl+Z)", () => go(history.undo()));
  const redo = button("Redo", "Redo (Ctrl+Shift+Z)", () => go(history.redo()));
  const pin = button("Pin", "Keep these curves to compare with", addPin);
  const copy = button("Copy link", "A link that holds all of this", copyLink);
  const python = button("Open in Python", "The lines that give the same result", openPython);
  const again = button("Reset", "Back to the parameter set as it was published", () => go(begin(choices, state.set, state), true));
  const numbers = make("dl", { className: "explore-numbers" });
  const pinned = make("div", { className: "explore-pins" });
  bar.append(numbers, make("span", { className: "grow" }), undo, redo, pin, copy, python, again, pinned);
  const shownNumbers = {};
  for (const [name, label] of [["net_displacement", "Net displacement"], ["mean_speed", "Mean speed"], ["step", "Steady step"]]) {
    shownNumbers[name] = make("dd", { textContent: "–", className: name === "step" ? "of-steps" : "of-motion" });
    numbers.append(make("div", {}, make("dt", { textContent: label }), shownNumbers[name]));
  }

  // --- sliders, made anew when the law or the waveform changes
  let controls = new Map(); // "friction.sigma_0" -> control
  function build() {
    controls = new Map();
    const open = new Map([...panel.querySelectorAll("details")].map((one) => [one.dataset.name, one.open]));
    const section = (name, heading, ...content) => {
      const details = make("details", { open: open.get(name) ?? true }, make("summary", { textContent: heading }), ...content);
      details.dataset.name = name;
      return details;
    };
    const sliders = (key, fields) => fields.map((field) => control(key, field));
    const lawFields = kindOf(choices, state.set).laws[state.law].flatMap((field) => elementsOf(field, state.friction));
    const sets = Object.entries(choices.sets).map(([name, set]) => [name, `${name}: ${set.title}`]);
    const plain = (names) => names.map((name) => [name, name.replace(/(?<=[a-z])(?=[A-Z][a-z]{3})/g, " ")]);
    panel.replaceChildren(
      section("drive", "Drive",
        makeChoice("Waveform", plain(Object.keys(choices.shapes)), state.shape, (shape) => choose(withShape(choices, state, shape))).element,
        ...sliders("waveform", choices.shapes[state.shape]), control("duration", choices.duration)),
      section("friction", "Friction",
        makeChoice("Law", plain(Object.keys(kindOf(choices, state.set).laws)), state.law, (law) => choose(withLaw(choices, state, law))).element,
        ...sliders("friction", lawFields)),
      section("model", "Actuator",
        makeChoice("Parameter set", sets, state.set, (set) => choose(begin(choices, set, state))).element,
        ...sliders("model", modelFields(choices, state.set))),
    );
    if (!plots || units() === drawn) return;
    [motion, steps, pins] = [null, null, []]; // of what slides, where this turns
    pinsChanged();
  }
  function elementsOf(field, values) {
    if (field.name in values) return [field];
    const names = Object.keys(values).filter((name) => name.replace(/_\d+$/, "") === field.name);
    return names.map((name) => ({ ...field, name, meaning: `${field.meaning.replace("each element", "element")} ${name.match(/\d+$/)[0]}`, symbol: "" }));
  }
  function control(section, field) {
    const key = section === "duration" ? "duration" : `${section}.${field.name}`;
    const now = () => (section === "duration" ? state.duration : state[section][field.name]);
    const next = (value) => changed(choices, state, section, field.name, value);
    const acts = {
      app,
      drag(value) {
        touched = key;
        apply(next(value), key);
      },
      settle,
      // A typed value is tried first: refused, it leaves everything as it was.
      async type(value) {
        const wished = next(value);
        const answer = await app.request("/api/explore/motion", wire(wished));
        touched = key;
        apply(wished, key);
        show(named(answer), wished);
        settle();
      },
    };
    const made = field.switch ? makeSwitch(field, now(), acts) : makeSlider(field, now(), acts);
    made.now = now;
    controls.set(key, made);
    return made.element;
  }

  // --- state
  function apply(next, moved = "") {
    state = next;
    for (const [key, one] of controls) if (key !== moved || !one.range.matches(":active, :focus")) one.set(one.now());
      else if (one.range.type === "range") one.set(one.now());
    ask();
  }
  function ask() {
    motions.want(state);
    curves.want(state);
    tellStale();
  }
  function choose(next) {
    state = next;
    build();
    ask();
    settle();
  }
  function settle() {
    history.add(state);
    settled();
  }
  function settled() {
    undo.disabled = !history.canUndo;
    redo.disabled = !history.canRedo;
    window.history.replaceState(null, "", `#explore?${toLink(state, pins)}`);
  }
  function go(next, isNew = false) {
    if (!next) return;
    const same = next.law === state.law && next.shape === state.shape && next.set === state.set;
    const elements = Object.keys(next.friction).join() === Object.keys(state.friction).join();
    if (isNew) history.add(next);
    if (same && elements) apply(next);
    else {
      state = next;
      build();
      ask();
    }
    settled();
  }

  // --- answers
  /** Of what slides, or of what turns. */
  const units = () => kindOf(choices, state.set).units;
  const motions = latestWins({
    abreast: 2,
    async ask(wish) {
      // Meanwhile the curves are those of before.
      const slow = setTimeout(() => {
        problem.textContent = "Computing…";
        problem.classList.add("busy");
        stage.classList.add("stale");
      }, 1500);
      try {
        return await app.request("/api/explore/motion", wire(wish));
      } finally {
        clearTimeout(slow);
      }
    },
    take: (answer, wish) => drawnIn(wish) && show(named(answer), wish),
    refuse(error) {
      const one = controls.get(error.field);
      clear();
      if (one) one.say(error.message);
      else problem.textContent = error.message;
      stage.classList.add("stale");
    },
  });
  const curves = latestWins({
    ask: (wish) => app.request("/api/explore/steps", wire(wish)),
    take(answer, wish) {
      if (!drawnIn(wish)) return;
      steps = { ...named(answer), now: wish.waveform };
      of.steps = wish;
      const step = steps.step.length ? steps.step[0] : NaN;
      shownNumbers.step.textContent = steps.step.length ? (Number.isFinite(step) ? formatQuantity(step, drawn.position) : "none") : "–";
      drawSteps();
      tellStale();
    },
    refuse() {}, // the motion's answer says what is wrong
    share: CURVE_SHARE,
  });
  function clear() {
    for (const one of controls.values()) one.say("");
    problem.textContent = "";
    problem.classList.remove("busy");
    stage.classList.remove("stale");
  }
  /** What belongs to an earlier state is dimmed; a style waits a moment, for a slider's answers come soon. */
  function tellStale() {
    const other = (one) => one !== null && one !== state;
    for (const name of ["motion", "steps"]) root.classList.toggle(`stale-${name}`, other(of[name]));
    numbers.setAttribute("aria-busy", String(other(of.motion) || other(of.steps)));
  }
  function show(found, wish) {
    motion = found;
    of.motion = wish;
    tellStale();
    clear();
    problem.textContent = found.problem ? `The simulation ${found.problem}.` : "";
    const say = (name, { value, unit }) => (shownNumbers[name].textContent = formatQuantity(value, unit));
    for (const name of ["net_displacement", "mean_speed"]) say(name, found.numbers[name]);
    draw();
  }

  // --- plots
  let plots = null, drawn = null; // and their units
  const drawnIn = ({ set }) => kindOf(choices, set).units === drawn;
  function buildPlots() {
    drawn = units();
    const { position, force } = drawn;
    for (const one of Object.values(plots ?? {})) one.destroy();
    stage.replaceChildren();
    const place = (name, heading) => {
      const box = make("section", { className: `card explore-${name}` }, make("h2", { textContent: heading }));
      const inside = make("div", { className: "explore-canvas" });
      box.append(inside);
      stage.append(box);
      return inside;
    };
    const extra = (unit) => pins.map((one, i) => ({ label: one.label, unit, color: PIN_COLOURS[i], dash: [7, 4] }));
    const step = (at) => [{ label: "step", unit: position, color: "--series-1" }, { label: at, unit: position, color: "--series-2", dash: [3, 3] }, ...extra(position)];
    plots = {
      motion: makePlot(place("motion", "Motion"), {
        label: "Motion", tools: true,
        series: [
          { label: "drive", unit: "V", color: "--series-6" },
          { label: "stage", unit: position, color: "--series-2" },
          { label: "end-effector", unit: position, color: "--series-1" },
          ...extra(position),
        ],
      }),
      loop: makePlot(place("loop", "Friction loop"), {
        label: "Friction force over sliding displacement", xy: true, tools: "save", time: { label: "sliding displacement", unit: position },
        series: [{ label: "friction force", unit: force, color: "--series-3" }, ...extra(force)],
      }),
      amplitude: makePlot(place("amplitude", "Step over voltage"), {
        label: "Step over voltage", xy: true, tools: "save", time: { label: "amplitude", unit: "V" }, series: step("this drive"),
      }),
      frequency: makePlot(place("frequency", "Step over frequency"), {
        label: "Step over frequency", xy: true, tools: "save", time: { label: "frequency", unit: "Hz", log: true }, series: step("this drive"),
      }),
    };
    draw();
    drawSteps();
  }
  function draw() {
    if (!motion || !plots) return;
    const { time } = motion;
    const others = pins.map((one) => (one.motion ? resampled(one.motion.time, one.motion.end_effector_position, time) : []));
    plots.motion.setData([time, motion.drive_voltage, motion.stage_position, motion.end_effector_position, ...others]);
    plots.loop.setData([motion, ...pins.map((one) => one.motion)].flatMap(loopOf));
    root.dataset.drawn = String(Number(root.dataset.drawn ?? 0) + 1);
  }
  function drawSteps() {
    if (!steps || !plots) return;
    const at = (x) => (steps.step.length ? [[x, x], [0, steps.step[0]]] : [[], []]);
    const pair = (one, axis) => (one?.[axis]?.length ? finite(one[axis], one[`step_over_${axis}`]) : [[], []]);
    for (const axis of ["amplitude", "frequency"]) {
      if (steps[axis].length) plots[axis].setExtent([axis === "amplitude" ? 0 : steps[axis][0], steps[axis].at(-1)]);
      plots[axis].setData([...pair(steps, axis), ...at(steps.now[axis]), ...pins.flatMap((one) => pair(one.steps, axis))]);
    }
    late.hidden = steps.in_time[0] !== 0;
    root.dataset.curves = String(Number(root.dataset.curves ?? 0) + 1);
  }

  // --- pins
  async function addPin() {
    if (!motion) return;
    if (pins.length === MOST_PINS) return app.notify(`${MOST_PINS} curves are pinned; take one away first.`);
    pins.push({ label: `${"ABC".split("").find((letter) => !pins.some((one) => one.label.startsWith(letter)))}: ${nameOf(touched)}`, state, motion, steps });
    pinsChanged();
  }
  function nameOf(key) {
    const [section, name] = key.split(".");
    const value = section === "duration" ? state.duration : state[section]?.[name];
    if (value === undefined || typeof value === "boolean") return state.law;
    const fields = section === "duration" ? [choices.duration] : section === "model" ? modelFields(choices, state.set) : section === "friction" ? kindOf(choices, state.set).laws[state.law] : choices.shapes[state.shape];
    const field = fields.find((one) => one.name === name);
    return field ? `${field.symbol} = ${formatQuantity(value, field.unit)}` : state.law;
  }
  function pinsChanged() {
    pinned.replaceChildren(...pins.map((one, i) => {
      const chip = make("span", { className: "chip" }, make("span", { className: `swatch pin-${i + 1}` }), make("span", { textContent: one.label }));
      const back = button("Restore", `Go back to ${one.label}`, () => go(one.state, true));
      const off = button("✕", `Take away ${one.label}`, () => {
        pins = pins.filter((other) => other !== one);
        pinsChanged();
      });
      chip.append(back, off);
      return chip;
    }));
    pin.disabled = pins.length === MOST_PINS;
    buildPlots();
    settled();
  }
  async function restorePins(found) {
    pins = await Promise.all(found.filter((one) => drawnIn(one.state)).map(async (one) => {
      const ask = async (path) => named(await app.request(path, wire(one.state)));
      const [moved, curve] = await Promise.all([ask("/api/explore/motion"), ask("/api/explore/steps")].map((answer) => answer.catch(() => null)));
      return { ...one, motion: moved, steps: curve };
    }));
    pinsChanged();
  }

  // --- link and Python
  async function copyLink() {
    settled();
    try {
      await navigator.clipboard.writeText(location.href);
      app.notify("The link is in the clipboard: it holds every value and the pinned curves.");
    } catch {
      const field = make("input", { value: location.href, readOnly: true });
      field.setAttribute("aria-label", "Link");
      showDialog("Link to this state", field);
      field.select();
    }
  }
  async function openPython() {
    try {
      const { code } = await app.request("/api/explore/python", wire(state));
      const text = make("pre", { className: "code", textContent: code, tabIndex: 0 });
      showDialog("The same in Python", text, button("Copy", "Copy the lines", async () => {
        try {
          await navigator.clipboard.writeText(code);
          app.notify("The lines are in the clipboard.");
        } catch {
          getSelection().selectAllChildren(text);
        }
      }));
    } catch (error) {
      app.notify(error.message, "error");
    }
  }
  function keys(event) {
    if (!(event.ctrlKey || event.metaKey) || event.target.matches?.("textarea")) return;
    const key = event.key.toLowerCase();
    if (key === "z" && !event.shiftKey) go(history.undo());
    else if (key === "y" || (key === "z" && event.shiftKey)) go(history.redo());
    else return;
    event.preventDefault();
  }
  window.addEventListener("keydown", keys);
  // Somebody put another link into the address bar.
  function hashChanged() {
    const found = link();
    if (!found) return;
    go(found.state, true);
    restorePins(found.pins);
  }
  window.addEventListener("hashchange", hashChanged);
  ending.push(() => window.removeEventListener("keydown", keys), () => window.removeEventListener("hashchange", hashChanged));

  build();
  buildPlots();
  apply(state);
  if (linked?.pins.length) restorePins(linked.pins);
  else settled();
  return () => {
    motions.end();
    curves.end();
    ending.forEach((end) => end());
    for (const one of Object.values(plots)) one.destroy();
  };
}
