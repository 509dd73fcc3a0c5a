// The form of the Identify page: recordings, model, what is free, how hard to look.

import { button, make } from "./elements.js";
import { begin, changed, kindOf, withLaw } from "./explore_state.js";
import { calledShortly } from "./livedata.js";
import { makeQuantity, needAccepted } from "./quantity.js";
import { capital, makeChoice, makeSwitch, symbolOf } from "./sliders.js";

const channelOf = ({ position }) => [
  { name: "delay", unit: "s", symbol: "t_d", meaning: "delay of the sensor" },
  { name: "offset", unit: position, symbol: "x₀", meaning: "offset of the sensor" },
];
// The gain too: a stage that nobody measured is wrong by some percent, and friction would make up for it.
const USUAL = ["gain", "sigma_0", "sigma_1", "coulomb_force", "stiffness_1", "stiffness_2", "stiffness_3", "strength_1", "strength_2", "strength_3", "delay", "offset"];
const GIVEN = ["external_force", "incline", "hysteresis", "creep"]; // what no walk is asked for
const STAGE = ["gain", "natural_frequency", "damping_ratio"]; // what clamped steps give
const EFFORT = { quick: ["Quick: from the start values", 1, 0], hops: ["Careful: look for lower minima", 1, 2], starts: ["Thorough: four starts", 4, 2] };
const HEADS = { Loops: "The end-effector fixed to the stage, driven slowly to and fro: gives hysteresis and creep", Step: "The end-effector fixed to the stage: gives the stage's frequency, damping and gain", Fit: "A walk, to which the friction is fitted", Predict: "A walk that the fit has not seen", Recording: "" };

/** `asked`: the recording that a link asks for, instead of those of the last fit. */
export async function fitForm(app, choices, last, asked, start, cancel) {
  let state = last ? restored(choices, last) : begin(choices);
  let free = new Set(last?.free ?? USUAL);
  let role = new Map(); // recording -> "loops", "step", "fit" or "verify"
  for (const [use, names] of Object.entries(asked ? {} : { loops: last?.loops, step: last?.steps, fit: last?.recordings, verify: last?.others }))
    for (const name of names ?? []) role.set(name, use);
  const steps = () => [...role.values()].includes("step");
  let own = Boolean(last) && !asked; // somebody chose the model: a recording no longer does

  const element = make("form", { className: "card identify-form", noValidate: true });
  element.setAttribute("aria-label", "What to fit");
  const fault = make("p", { className: "fault" });
  fault.setAttribute("role", "alert");
  const list = make("div", { className: "identify-list" });
  const window_ = { begin: last?.begin ?? null, end: last?.end ?? null };
  let slewRate = last?.slew_rate ?? null;
  const slew = makeQuantity({
    label: "Slew rate", unit: "V/s", value: slewRate, app, hint: "At which the amplifier follows a jump, limited by its current into the piezo; leave empty: at once",
    empty: "at once", change: (value) => (slewRate = value),
  });
  const limits = ["begin", "end"].map((name) => makeQuantity({
    label: name === "begin" ? "From" : "To", unit: "s", value: window_[name], app, hint: "Leave empty for all of it",
    empty: "all", change: (value) => (window_[name] = value),
  }));
  const model = make("div", {});
  const effort = makeChoice("Effort", Object.entries(EFFORT).map(([name, [text]]) => [name, text]), "quick", () => {});
  const go = make("button", { type: "submit", className: "primary", textContent: "Start fit", disabled: true }); // until the recordings are there
  const stop = button("Cancel", "End the fit; what was found until then stays", () => cancel().catch(say), "");
  const refresh = button("Refresh", "Look for new recordings and parameter sets", () => refreshed());
  element.append(
    make("div", { className: "identify-title" }, make("h2", { textContent: "Recordings" }), refresh), list,
    make("div", { className: "identify-window" }, ...limits.map((one) => one.element), slew.element),
    make("h2", { textContent: "Model" }), model, effort.element, fault, make("div", { className: "identify-buttons" }, go, stop),
  );
  const say = (error) => (fault.textContent = error.message);

  async function recordings() {
    const found = await app.request("/api/identify/recordings");
    const usable = found.filter((each) => !each.problem);
    const wanted = usable.find((one) => one.name === asked);
    if (asked && !wanted) app.notify(`${calledShortly(asked)} is not there, or no fit can be made to it.`, "warning");
    if (!role.size) usual(usable, wanted);
    asked = null;
    const rows = found.map((one) => {
      const box = (use, text) => {
        const unfit = Boolean(one.problem) || (one.clamped !== undefined && one.clamped !== (use === "step" || use === "loops"));
        const input = make("input", { type: "checkbox", checked: role.get(one.name) === use, disabled: unfit });
        input.setAttribute("aria-label", `${text} ${one.name}`);
        input.addEventListener("change", () => {
          if (input.checked) role.set(one.name, use);
          else role.delete(one.name);
          for (const other of input.closest("tr").querySelectorAll("input")) if (other !== input) other.checked = false;
          if (input.checked && use === "fit") follow(one);
          build();
        });
        return make("td", {}, make("label", {}, input));
      };
      const about = one.problem || `${Number(one.seconds.toPrecision(3))} s, ${one.samples} samples`;
      return make("tr", { className: one.problem ? "unusable" : "" }, box("loops", "Loops"), box("step", "Step"), box("fit", "Fit"), box("verify", "Predict"),
        make("td", {}, make("div", { textContent: calledShortly(one.name), title: one.name }), make("div", { className: "soft small-text", textContent: about })));
    });
    list.replaceChildren(rows.length
      ? make("table", {}, make("thead", {}, make("tr", {}, ...Object.entries(HEADS).map(([text, title]) => make("th", { textContent: text, title })))), make("tbody", {}, ...rows))
      : make("p", { className: "soft", textContent: "There are no recordings in the panel's folder yet: record some on the Bench page." }));
  }

  /** As a campaign does it: the newest walk of the bench, or what was asked for, with the newest clamped loops and step
   * of that rig. Of somebody's own file nobody knows what it is for. */
  function usual(found, one = found.find((each) => each.bench && !each.clamped)) {
    if (!one) return;
    for (const [use, jumps] of [["loops", false], ["step", true]]) {
      const fits = (each) => each.clamped && each.jumps === jumps;
      const newest = fits(one) ? one : found.find((each) => fits(each) && each.set === one.set);
      if (newest) role.set(newest.name, use);
    }
    if (!one.clamped) role.set(one.name, "fit");
    follow(one);
    build();
  }
  /** What a recording says of its rig holds for the model, until somebody chooses otherwise. */
  function follow(one) {
    if (own) return;
    // Of somebody's own file only the unit is known: of a set that slides, or of one that turns.
    const set = [one.set, state.set, ...Object.keys(choices.sets)].find((name) => choices.sets[name]?.unit === one.unit);
    if (set && set !== state.set) state = begin(choices, set);
    if (one.stage_reaction !== undefined) state = changed(choices, state, "model", "stage_reaction", one.stage_reaction);
    // A file that does not say it leaves it as the other walks say.
    const others = [...role].some(([name, use]) => use === "fit" && name !== one.name);
    if (one.slew_rate === undefined && others) return;
    slewRate = one.slew_rate ?? null;
    slew.set(slewRate);
  }

  let known = new Map(); // name -> field
  const boxes = [];
  function build() {
    boxes.length = 0;
    const values = [...Object.keys(state.friction)], kind = kindOf(choices, state.set), channel = channelOf(kind.units);
    const field = (name) => {
      const described = kind.laws[state.law].find((one) => one.name === name || one.name === name.replace(/_\d+$/, ""));
      return { ...described, name, meaning: described.meaning.replace("each element", `element ${name.match(/\d+$/)?.[0]}`) };
    };
    const law = values.map(field);
    const stage = kind.model.filter((one) => !one.switch && !GIVEN.includes(one.name));
    known = new Map([...law, ...stage, ...channel].map((one) => [one.name, one]));
    const plain = Object.keys(kind.laws).map((name) => [name, name.replace(/(?<=[a-z])(?=[A-Z][a-z]{3})/g, " ")]);
    const sets = Object.entries(choices.sets).map(([name, set]) => [name, `${name}: ${set.title}`]);
    const reaction = makeSwitch(kind.model.find((one) => one.name === "stage_reaction"), state.model.stage_reaction, {
      drag(on) { own = true; state = changed(choices, state, "model", "stage_reaction", on); }, settle() {},
    });
    const open = model.querySelector("details")?.open ?? stage.some((one) => free.has(one.name));
    const given = steps() ? [make("p", { className: "soft small-text", textContent: "Gain, natural frequency and damping come from the steps." })] : [];
    const more = make("details", { open }, make("summary", { textContent: "Stage and piezo" }), ...given, ...stage.map((one) => row("model", one)));
    model.replaceChildren(
      makeChoice("Parameter set", sets, state.set, (set) => { own = true; state = begin(choices, set); build(); }).element,
      makeChoice("Friction law", plain, state.law, (name) => { state = withLaw(choices, state, name); build(); }).element,
      make("p", { className: "soft small-text", textContent: "Tick the parameters to fit. The numbers are the initial guess; the other parameters stay fixed." }),
      ...law.map((one) => row("friction", one)), ...channel.map((one) => row("", one)), more, reaction.element,
    );
  }
  function row(section, one) {
    const tick = make("input", { type: "checkbox", checked: free.has(one.name) });
    tick.setAttribute("aria-label", `Fit ${one.meaning}`);
    if (section === "model" && STAGE.includes(one.name) && steps()) Object.assign(tick, { checked: false, disabled: true });
    tick.addEventListener("change", () => (tick.checked ? free.add(one.name) : free.delete(one.name)));
    if (!section) return make("div", { className: "identify-free" }, tick, make("span", {}, `${capital(one.meaning)} `, symbolOf(one.symbol)));
    const box = makeQuantity({
      label: "", unit: one.unit, value: state[section][one.name], app,
      change(value) {
        state = changed(choices, state, section, one.name, value);
        for (const other of boxes) other();
      },
    });
    boxes.push(() => box.set(state[section][one.name]));
    box.element.querySelector("label").append(`${capital(one.meaning)} `, symbolOf(one.symbol));
    box.element.prepend(tick);
    box.element.classList.add("identify-free");
    return box.element;
  }

  /** Sets that were saved meanwhile can be chosen too. */
  async function offered() {
    const { sets, by_unit: kinds } = await app.request("/api/explore/choices");
    if (Object.keys(sets).join("\n") === Object.keys(choices.sets).join("\n")) return;
    choices.sets = sets[state.set] ? sets : { ...sets, [state.set]: choices.sets[state.set] };
    Object.assign(choices.by_unit, kinds);
    build();
  }

  const refreshed = () => Promise.all([recordings(), offered()]).catch(say);

  function request() {
    const named = (use) => [...role].filter(([, one]) => one === use).map(([name]) => name);
    if (!named("fit").length) throw new Error("Choose at least one recording to fit.");
    const chosen = [...known.keys()].filter((name) => free.has(name) && !(steps() && STAGE.includes(name)));
    if (!chosen.length) throw new Error("Tick at least one parameter to fit.");
    const inf = (values) => Object.fromEntries(Object.entries(values).map(([name, value]) => [name, value === Infinity ? "inf" : value]));
    // What may be zero is looked for down to there, on a linear scale: on a logarithmic one, a damping that the
    // recordings do not show creeps towards zero without end. What starts at zero has no scale of its own.
    const bounds = Object.fromEntries(chosen.filter((name) => known.get(name).zero).map((name) => {
      const start = state.friction[name] ?? state.model[name];
      return [name, [0, start > 0 && start < Infinity ? 30 * start : known.get(name).high]];
    }));
    const [, starts, hops] = EFFORT[effort.select.value];
    return {
      set: state.set, model: inf(state.model), law: state.law, friction: inf(state.friction), free: chosen, bounds, starts, hops,
      recordings: named("fit"), others: named("verify"), steps: named("step"), loops: named("loops"), slew_rate: slewRate, ...window_,
    };
  }
  // Enter in a field takes its number over; only the button starts the fit.
  element.addEventListener("keydown", (event) => event.key === "Enter" && event.target.matches("input[type=text]") && event.preventDefault());
  element.addEventListener("submit", (event) => {
    event.preventDefault();
    fault.textContent = "";
    needAccepted(element).then(() => start(request())).catch(say);
  });

  build();
  list.replaceChildren(make("p", { className: "soft", textContent: "Reading the recordings …" }));
  return {
    element,
    listed: recordings().catch(say),
    refresh: refreshed,
    running(on) {
      go.disabled = on;
      stop.disabled = !on;
    },
    /** What a name means, and its symbol as it is in print. */
    labelOf: (name) => (known.has(name) ? [`${capital(known.get(name).meaning)} `, symbolOf(known.get(name).symbol)] : [name]),
    unitOf: (name) => known.get(name)?.unit ?? "",
  };
}

function restored(choices, last) {
  const read = (values) => Object.fromEntries(Object.entries(values).map(([name, value]) => [name, value === "inf" ? Infinity : value]));
  const base = begin(choices, last.set);
  return { ...base, law: last.law, model: { ...base.model, ...read(last.model) }, friction: read(last.friction) };
}
