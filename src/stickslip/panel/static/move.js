// The Move page: go to a position and hold it, jog by steps, scan; where it is and should be, live; gains, and what
// they will do. The loop runs in the rig's process: this page only says what is wanted.

import { h } from "./dom.js";
import { styled } from "./elements.js";
import { latestWins } from "./latest.js";
import { makeLiveData } from "./livedata.js";
import { makePlot } from "./plot.js";
import { formatQuantity, makeQuantity, needAccepted } from "./quantity.js";
import { capital, makeChoice, makeSlider } from "./sliders.js";
import { unpack } from "./stream.js";

const SPANS = [["1", "1 s"], ["5", "5 s"], ["30", "30 s"], ["120", "all"]];
const AGAIN = 150; // ms between pictures
const JOGS = 50; // ms between two words of a button that is held
const NAMES = ["end_effector_position", "target_position", "drive_voltage"];
// What was typed stays while other pages are looked at.
const kept = { unit: "", count: 3, hertz: 10, cycles: 10, input: "", settings: {}, gains: {}, span: "5" };
const USUAL = { m: { to: 20e-6, range: 2e-6 }, rad: { to: 2e-3, range: 0.2e-3 } }; // by the unit of positions

export async function mount(element, app) {
  await Promise.all([styled("./explore.css"), styled("./move.css")]);
  let state = { on: false }, run = { phase: "idle", title: "" }, choices = null;
  const live = makeLiveData(app);
  const fault = h("p", { class: "fault", role: "alert", id: "move-fault" });
  const say = (error) => { fault.textContent = error.message; };
  const settings = () => ({ input: kept.input, ...kept.settings, ...kept.gains });
  /** `of`: the fields that say what is done; those of how it is done can be wrong only before it begins. */
  async function act(does, of) {
    fault.textContent = "";
    try {
      if (of) await needAccepted(of, setup, sliders);
      await app.request("/api/move/act", { what: does(), settings: settings() });
    } catch (error) {
      say(error);
    }
  }

  // --- what to do
  const field = (name, label, unit, check = () => {}, into = kept) => makeQuantity({ label, unit, value: into[name], app, change: (value) => { check(value); into[name] = value; } }).element;
  function whole(value) {
    if (!Number.isInteger(value) || value < 1) throw new Error("a whole number of steps, from 1 on; Back and Forward say which way");
  }
  const button = (text, title, does, kind = "") => h("button", { type: "button", class: kind, title, onclick: does }, text);
  const doing = (text, title, does, kind) => button(text, title, (event) => act(does, event.currentTarget.closest(".move-line")), kind);
  const lets = []; // what ends with the page
  /** A button that makes steps while it is held. The loop itself ends them 200 ms after the last word of this page. */
  function holding(text, title, way) {
    let held = false;
    const made = h("button", { type: "button", class: "hold", title: `${title}; they end at once where this page is not heard any more` }, text);
    const end = () => {
      if (!held) return;
      held = false;
      app.request("/api/move/act", { what: { do: "halt" }, settings: settings() }).catch(() => {}); // it ends by itself, too
    };
    async function begin() {
      if (held || made.disabled) return;
      held = true;
      fault.textContent = "";
      try {
        await needAccepted(setup, sliders);
        while (held && !document.hidden) {
          await app.request("/api/move/act", { what: { do: "jog", way }, settings: settings() });
          await new Promise((done) => setTimeout(done, JOGS));
        }
      } catch (error) {
        say(error);
      }
      end();
    }
    const keys = (act) => (event) => { if ([" ", "Enter"].includes(event.key)) { event.preventDefault(); act(); } };
    made.addEventListener("pointerdown", begin);
    made.addEventListener("keydown", keys(begin));
    made.addEventListener("contextmenu", (event) => event.preventDefault());
    for (const name of ["pointerup", "pointercancel", "keyup", "blur"]) window.addEventListener(name, end);
    lets.push(() => { end(); for (const name of ["pointerup", "pointercancel", "keyup", "blur"]) window.removeEventListener(name, end); });
    return made;
  }
  const go = doing("Go", "Steps as far as they are needed, then the piezo alone; and hold", () => ({ do: "go", to: kept.to }), "primary");
  const back = doing("◂ Back", "So many full steps backward, then hold there", () => ({ do: "steps", count: -kept.count }));
  const forth = doing("Forward ▸", "So many full steps forward, then hold there", () => ({ do: "steps", count: kept.count }));
  const held = [holding("◂ Hold", "Steps backward while it is held", -1), holding("Hold ▸", "Steps forward while it is held", 1)];
  const scan = doing("Scan", "About where it holds, by the piezo alone", () => ({ do: "scan", range: kept.range, frequency: kept.hertz, cycles: kept.cycles }));
  const release = button("Release", "The output goes to 0 V; the recording is kept", () => act(() => ({ do: "release" })));
  const deeds = h("fieldset", { class: "bare" });
  // They stay as they are while a session begins: a button that is disabled would not hear that it is let go.
  const jogs = h("fieldset", { class: "bare move-jog" }, h("legend", {}, "Jog while held"), ...held);
  const sensor = makeChoice("Sensor", [], "", (name) => { kept.input = name; });
  const setup = h("fieldset", { class: "bare inputs" }, sensor.element);
  const watching = h("p", { class: "watching", hidden: true }, "Another page is in control: request control at the top. Emergency stop works from here too.");
  const believed = h("dl", { id: "believed" });
  const panel = h("section", { class: "card", "aria-label": "What to do" }, h("div", { class: "bare" }, watching, deeds, jogs, fault,
    h("h2", {}, "Settings"), setup, h("p", { class: "soft small-text", id: "move-how" }),
    h("details", { class: "small-text" }, h("summary", {}, "Plausibility of the sensor"), h("p", { class: "soft" }, "The move stops beyond any of these limits, which follow from the model."), believed)));

  // --- where it is
  const shown = {};
  const older = h("span", { class: "when", hidden: true, title: "Nothing is measured while the output ramps to 0 V, which moves the piezo" }, " before the ramp");
  const counted = "All steps since the start, including the one or two that centre the piezo";
  const numbers = h("dl", { class: "explore-numbers" }, ...["Position", "Target", "Error", "Steps made"].map((name) =>
    h("div", { title: name === "Steps made" ? counted : "" }, h("dt", {}, h("span", {}, name), name === "Position" ? older : null), (shown[name] = h("dd", {}, "–")))));
  const words = h("strong", { id: "move-phase", role: "status" });
  const span = makeChoice("Shown", SPANS, kept.span, (value) => { kept.span = value; draw(); });
  const canvas = h("div", { class: "move-canvas" });
  const now = h("section", { class: "card move-now", "aria-label": "Where it is" }, h("div", { class: "row" }, words, h("span", { class: "grow" }), span.element), numbers, canvas);

  // --- gains
  const responses = h("div", { class: "move-response" });
  const told = h("p", { class: "small-text", id: "margins", role: "status" });
  const sliders = h("fieldset", { class: "bare" });
  const tuned = button("As tuned", "The gains that keep their margins", () => { kept.gains = {}; gains(); }, "small");
  const loop = h("section", { class: "card move-gains", "aria-label": "Gains" }, h("div", { class: "row" }, h("h2", {}, "Gains"), h("span", { class: "grow" }), tuned),
    h("div", { class: "move-loop" }, h("div", {}, sliders, told), responses));
  element.append(h("h1", { class: "visually-hidden" }, "Move"), h("div", { class: "move" }, panel, h("div", { class: "move-right" }, now, loop)));

  let plot = null;
  /** Fields and plot of positions in m, or in rad of what turns. */
  function positionsIn(unit) {
    if (plot && unit === kept.unit) return;
    if (unit !== kept.unit) Object.assign(kept, { unit, settings: {} }, USUAL[unit]);
    deeds.replaceChildren(
      h("div", { class: "move-line" }, field("to", "Position from home", unit), go),
      h("div", { class: "move-line" }, field("count", "Steps", "", whole), back, forth),
      h("div", { class: "move-line" }, field("range", "Scan range", unit), field("hertz", "Frequency", "Hz"), field("cycles", "Cycles", ""), scan), release);
    plot?.destroy();
    plot = makePlot(canvas, { label: "Position and drive", empty: "Go somewhere: the position is drawn here.", series: [
      { label: "end-effector", unit, color: "--series-1" }, { label: "target", unit, color: "--series-2" },
      { label: "band", unit, color: "--series-3", dash: [4, 4] }, { label: "band", unit, color: "--series-3", dash: [4, 4] },
      { label: "drive", unit: "V", color: "--series-6" }] });
  }
  positionsIn(kept.unit || "m");
  const answer = makePlot(responses, { label: "Predicted response", tools: "save", series: [
    { label: "predicted", unit: "", color: "--series-1" }, { label: "lowest", unit: "", color: "--series-4", dash: [4, 4] }, { label: "highest", unit: "", color: "--series-4", dash: [4, 4] }] });

  const asks = latestWins({
    ask: () => app.request("/api/move/response", settings()),
    take(found) {
      const { header, arrays } = unpack(found);
      answer.setData(arrays);
      told.textContent = header.refused ? `Refused: ${header.refused}` : `Response to a step of the target, without feedforward; dashed: with the stage's frequency 5 % off. Margins: ${header.margins}.`;
      told.classList.toggle("fault", Boolean(header.refused));
      loop.dataset.answers = String(Number(loop.dataset.answers ?? 0) + 1);
    },
    refuse: say,
  });
  const FIELDS = [["bandwidth", "bandwidth of the integral", "Hz", "log"], ["proportional", "proportional gain", "", "linear"], ["corner", "corner of the low-pass", "Hz", "log"]];
  let made = new Map();
  function gains() {
    made = new Map(FIELDS.map(([name, meaning, unit, scale]) => {
      const { low, high, tuned: own } = choices[name];
      const change = (value) => { kept.gains[name] = value; made.get(name).set(value); asks.want(1); };
      return [name, makeSlider({ meaning, unit, low, high, scale }, kept.gains[name] ?? own, { app, drag: change, settle() {}, type: change })];
    }));
    sliders.replaceChildren(...[...made.values()].map((one) => one.element));
    asks.want(1);
  }

  // --- live
  let timer = 0, busy = false;
  async function draw() {
    const { header, filled, x } = live.data;
    if (busy || !header || !filled) return;
    busy = true;
    try {
      const last = x[filled - 1], view = plot.view ?? [Math.max(last - Number(kept.span), 0), last];
      const [time, at, wanted, volts] = await live.window(NAMES, view, 2 * plot.pixels);
      const band = (sign) => wanted.map((one) => one + sign * (kept.settings.tolerance ?? 0));
      plot.setData([time, at, wanted, band(-1), band(1), volts]);
      canvas.dataset.points = String(time.length);
    } catch {
      // another run has begun meanwhile: its own picture comes
    } finally {
      busy = false;
    }
  }
  const offs = [
    live.listen(() => { if (live.data.header?.title === "Move") timer ||= setTimeout(() => { timer = 0; draw(); }, AGAIN); }),
    app.stream.on("move", (message) => { state = message; show(); }),
    app.stream.on("run", (message) => { run = message; show(); }),
    app.stream.on("experiment", load),
  ];
  function show() {
    const going = ["preparing", "running", "stopping"].includes(run.phase), other = Boolean(app.control.holder) && !app.control.mine;
    const { on } = state, begins = going && run.title === "Move" && !on, ends = begins && run.phase !== "preparing";
    const put = (name, value, unit) => { shown[name].textContent = formatQuantity(value, unit, 6); };
    put("Position", on ? state.position : run.position, kept.unit);
    older.hidden = on || !run.before_ramp;
    put("Target", on ? state.target : undefined, kept.unit);
    put("Error", on ? state.target - state.position : undefined, kept.unit);
    shown["Steps made"].textContent = state.steps === undefined ? "–" : `${state.steps}${state.lost ? `, ${state.lost} lost` : ""}`;
    words.textContent = on ? state.words + (state.settled ? ": there" : "") : ends ? "Keeping the recording" : begins ? "Preparing" : going ? `${run.title} is running` : "At rest: the output is at 0 V";
    words.dataset.phase = on ? state.phase : "off";
    words.dataset.settled = String(Boolean(on && state.settled));
    watching.hidden = !other;
    deeds.disabled = other || !choices || begins || (going && !on);
    jogs.disabled = other || !choices || (going && !on && !begins);
    setup.disabled = sliders.disabled = tuned.disabled = other || going;
    scan.disabled = release.disabled = !on;
  }
  let loaded = "";
  async function load(message) {
    const { content } = message, key = JSON.stringify([content?.rig, content?.actuator, content?.limits, content?.channels]);
    if (key === loaded) return;
    loaded = key;
    const how = panel.querySelector("#move-how");
    how.textContent = "Tuning on the model …";
    try {
      choices = await app.request("/api/move/choices");
    } catch (error) {
      choices = null;
      loaded = ""; // tried again when the stream next says what the experiment is, as after a lost connection
      how.textContent = "";
      say(error);
      show();
      return;
    }
    fault.textContent = "";
    positionsIn(choices.unit);
    if (!choices.inputs.includes(kept.input)) kept.input = choices.inputs[0];
    for (const { name, starts } of choices.settings) kept.settings[name] ??= starts;
    sensor.select.replaceChildren(...choices.inputs.map((one) => new Option(one, one)));
    sensor.set(kept.input);
    setup.replaceChildren(sensor.element, ...choices.settings.map(({ name, unit, meaning }) => field(name, capital(meaning), unit, undefined, kept.settings)));
    how.textContent = `${choices.actuator}: the piezo's stroke is ${formatQuantity(choices.stroke, choices.unit, 3)}. The loop holds the position until you press Release, at most ${choices.at_most} s; sensor and gains stay fixed meanwhile.`;
    believed.replaceChildren(...choices.plausibility.flatMap(({ value, meaning }) => [h("dt", {}, meaning), h("dd", {}, value)]));
    gains();
    show();
  }
  window.addEventListener("controlchange", show);
  show();
  app.stream.send({ kind: "greet" });
  return () => {
    [...offs, ...lets].forEach((off) => off());
    window.removeEventListener("controlchange", show);
    clearTimeout(timer);
    asks.end();
    live.destroy();
    plot.destroy();
    answer.destroy();
  };
}
