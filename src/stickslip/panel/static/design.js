// The Design page: the map of the step under sliders for load and voltage, the fastest drive within them, the front of
// what speed costs, a sawtooth and the new drive beside each other, and where they go: to the bench, into a plan.

import { h } from "./dom.js";
import { styled } from "./elements.js";
import { makeFront, makeMap } from "./design_pictures.js";
import { begin, kindOf, wire } from "./explore_state.js";
import { latestWins } from "./latest.js";
import { makePlot } from "./plot.js";
import { formatQuantity, makeQuantity, needAccepted } from "./quantity.js";
import { capital, makeChoice, makeSlider } from "./sliders.js";
import { unpack } from "./stream.js";

const ON_MAP = ["load", "voltage"];
const AGAINST = [["current", "peak current"], ["ripple", "ripple of the motion"]];
// What was set and found stays while other pages are looked at.
const kept = { set: "kang2007", unit: "", values: {}, found: null, front: null, designed: null };

const named = (answer) => {
  const { header, arrays } = unpack(answer);
  return { ...header, ...Object.fromEntries(header.names.map((name, i) => [name, arrays[i]])) };
};

export async function mount(element, app) {
  await styled("./explore.css");
  await styled("./design.css");
  const [choices, fields] = await Promise.all([app.request("/api/explore/choices"), app.request("/api/design/fields")]);
  if (!(kept.set in choices.sets)) kept.set = "kang2007";
  const units = () => kindOf(choices, kept.set).units;
  const asked = () => {
    const { set, model, law, friction } = wire(begin(choices, kept.set));
    return { set, model, law, friction, load: kept.values.load };
  };
  const search = () => {
    const { voltage, spread, knots } = kept.values;
    return { ...asked(), voltage, spread, knots: knots ?? undefined, output: Object.fromEntries(fields[kept.unit].filter((field) => field.output).map(({ name }) => [name, kept.values[name]])) };
  };

  // --- frame
  const fault = h("p", { class: "fault", role: "alert" });
  const said = h("p", { class: "design-said", role: "status" });
  const bar = h("progress", { max: 1, value: 0, hidden: true, "aria-label": "Search" });
  const go = h("button", { type: "button", class: "primary", onclick: () => run("Searching for the fastest drive", "/api/design/search", search, found) }, "Find the fastest drive");
  const stop = h("button", { type: "button", disabled: true, title: "The best until then stays", onclick: () => app.request("/api/design/stop", {}).catch(say) }, "Stop");
  const against = makeChoice("Speed against", AGAINST, "current", () => {});
  const goFront = h("button", { type: "button", onclick: () => run("Searching for the front", "/api/design/front", () => ({ ...search(), against: against.select.value }), fronted) }, "Find the front");
  let shownFields = new Map();
  async function typed(name, value) {
    if (value !== null) await app.request("/api/design/check", { ...asked(), name, value });
    changed(name, value);
  }
  const fieldOf = (field) => "low" in field
    ? makeSlider(field, kept.values[field.name], { app, drag: (value) => changed(field.name, value), settle() {}, type: (value) => typed(field.name, value) })
    : makeQuantity({ label: capital(field.meaning), unit: field.unit, value: kept.values[field.name], app, change: (value) => typed(field.name, value),
      empty: field.starts === null ? "no limit" : String(field.starts) });
  const sets = Object.entries(choices.sets).map(([name, one]) => [name, `${name}: ${one.title}`]);
  const chosen = makeChoice("Parameter set", sets, kept.set, (set) => { kept.set = set; settle(); forget(); maps.want(1); });
  const panel = h("section", { class: "card explore-sliders", "aria-label": "What is given" });
  /** What is given, and the motions, in the units of the set; what was given in others is forgotten. */
  function settle() {
    const { unit } = choices.sets[kept.set];
    if (panel.firstChild && unit === kept.unit) return;
    if (unit !== kept.unit) Object.assign(kept, { unit, values: Object.fromEntries(fields[unit].map(({ name, starts }) => [name, starts])) });
    shownFields = new Map(fields[unit].map((field) => [field.name, fieldOf(field)]));
    const elements = (slid) => fields[unit].filter((field) => "low" in field === slid).map((field) => shownFields.get(field.name).element);
    panel.replaceChildren(chosen.element, ...elements(true),
      h("details", {}, h("summary", {}, "Knots, generator, amplifier"), h("div", { class: "design-typed" }, ...elements(false))),
      h("div", { class: "row" }, go, stop), h("div", { class: "design-choose" }, against.element, goFront), bar, said, fault);
    for (const one of Object.values(sides)) one.begin();
  }
  const numbers = h("dl", { class: "explore-numbers" });
  const shown = {};
  for (const name of ["Voltage", "Frequency", "Net step", "Speed"]) {
    shown[name] = h("dd", {}, "–");
    numbers.append(h("div", {}, h("dt", {}, name), shown[name]));
  }
  const card = (name, heading, ...content) => h("section", { class: `card design-${name}`, "aria-label": heading }, h("h2", {}, heading), ...content);
  const place = (name) => h("div", { class: `design-canvas ${name}` });
  const mapPlace = place("map"), frontPlace = place("front");
  const key = h("p", { class: "soft small-text design-key" }, h("span", { class: "ramp" }), "0 to ", h("output", {}), h("span", { class: "ramp back" }), "backwards", h("span", { class: "hatch" }), "no steady step");
  const empty = h("p", { class: "soft" }, "Press “Find the front”, then select a drive.");
  const results = card("results", "Speed in each condition", h("p", { class: "soft" }, "Press “Find the fastest drive”: it is compared with the best sawtooth in each condition."));
  const telling = card("tells", "Information in a recording", h("p", { class: "soft" }, "Press “Information in this recording” below a drive: it shows how narrow the 95 % intervals of a fit to 0.4 s of that drive would be, and beside them those of a sawtooth of 65 V, 5 Hz."));
  const sides = { old: side("old", "Sawtooth at the cursor"), fresh: side("fresh", "New drive") };
  element.append(h("h1", { class: "visually-hidden" }, "Design"), h("div", { class: "explore design" }, panel,
    h("div", { class: "design-right" },
      card("map", "Step over voltage and frequency", numbers, mapPlace, key), card("front", "Front", empty, frontPlace),
      sides.old.element, sides.fresh.element, results, telling)));

  settle(); // plots have the fonts of the page that they stand on

  function side(name, heading) {
    let plot = null;
    const title = h("h2", {}, heading), speed = h("p", { class: "soft small-text", role: "status" });
    const canvas = place(name);
    const of = { drive: null };
    const act = (text, does) => h("button", { type: "button", class: "small", disabled: true, onclick: () => does(of).catch(say) }, text);
    const acts = [act("Send to the bench", send), act("Information in this recording", tell)];
    const empty = name === "fresh" ? "Find the fastest drive, or select a drive of the front." : "";
    const motions = latestWins({
      ask: (drive) => app.request("/api/design/motion", { ...asked(), drive }),
      take(answer) {
        const moved = named(answer);
        plot.setData([moved.time, moved.drive_voltage, moved.end_effector_position]);
        speed.textContent = `${formatQuantity(moved.speed, units().speed)}, ${formatQuantity(1 / period(of.drive), "Hz")}`;
        root().dataset[name] = String(moved.speed);
      },
      refuse: (error) => { speed.textContent = error.message; },
    });
    return {
      element: h("section", { class: `card design-${name}`, "aria-label": heading }, title, speed, canvas, h("div", { class: "row" }, ...acts)),
      begin() {
        plot?.destroy();
        plot = makePlot(canvas, { label: heading, tools: "save", empty, series: [
          { label: "drive", unit: "V", color: "--series-6" }, { label: "end-effector", unit: units().position, color: "--series-1" }] });
      },
      show(drive, text) {
        of.drive = drive;
        title.textContent = text;
        for (const one of acts) one.disabled = false;
        motions.want(drive);
      },
      again: () => of.drive && motions.want(of.drive),
      end() {
        motions.end();
        plot.destroy();
      },
    };
  }
  const root = () => element.querySelector(".design");
  const period = ({ fields }) => fields.period ?? 1 / fields.frequency;
  const say = (error) => { fault.textContent = error.message; };

  // --- map
  let best = false; // whether the old drive is the best sawtooth
  const map = makeMap(mapPlace, { moved(volts, hertz, step, pointed) {
    const tell = { Voltage: [volts, "V"], Frequency: [hertz, "Hz"], "Net step": [step, units().position], Speed: [step * hertz, units().speed] };
    for (const [name, [value, unit]] of Object.entries(tell)) shown[name].textContent = formatQuantity(value, unit);
    best &&= !pointed;
    if (best) sides.old.again();
    else sides.old.show({ shape: "Sawtooth", fields: { amplitude: volts, frequency: hertz } }, "Sawtooth at the cursor");
  } });
  const front = makeFront(frontPlace, { chosen: (i) => design(kept.front.drives[i], `Drive ${i + 1} of the front`) });
  const maps = latestWins({
    ask: () => app.request("/api/design/map", { ...asked(), voltage: kept.values.voltage }),
    take(answer) {
      const found = named(answer);
      fault.textContent = found.in_time[0] ? "" : "The rest of the map is left out: this actuator takes too long for it.";
      map.setData(found);
      key.querySelector("output").textContent = formatQuantity(Math.max(...found.net_step.map((one) => (Number.isFinite(one) ? Math.abs(one) : 0))), units().position);
      root().dataset.maps = String(Number(root().dataset.maps ?? 0) + 1);
    },
    refuse: say,
  });
  function changed(name, value) {
    kept.values[name] = value;
    shownFields.get(name).set(value);
    if (!ON_MAP.includes(name)) return;
    maps.want(1);
    if (name === "load") sides.fresh.again();
  }

  // --- searches
  async function run(text, path, body, take) {
    fault.textContent = "";
    said.textContent = `${text} …`;
    go.disabled = goFront.disabled = true;
    stop.disabled = bar.hidden = false;
    bar.value = 0;
    try {
      await needAccepted(panel);
      take(await app.request(path, body()));
    } catch (error) {
      said.textContent = "";
      say(error);
    }
    go.disabled = goFront.disabled = false;
    stop.disabled = bar.hidden = true;
  }
  const off = app.stream.on("design", ({ share }) => { bar.value = share; });
  function design(drive, text) {
    kept.designed = { drive, text };
    sides.fresh.show(drive, text);
  }
  function found(answer) {
    kept.found = answer;
    const [value, saw] = [answer.value, answer.sawtooth_value].map((one) => formatQuantity(one, units().speed));
    const where = answer.conditions.length > 1 ? ` in the worst of ${answer.conditions.length} conditions` : "";
    said.textContent = `${value}${where}; the best sawtooth ${saw}. ${answer.fell_back ? "None was found that is worse than it nowhere: this is the sawtooth." : ""}${answer.interrupted ? "Stopped: the best until then." : ""}`;
    design(answer.drive, "Fastest drive");
    best = true;
    sides.old.show(answer.sawtooth, "Best sawtooth");
    tabled(results, ["condition", "drive", "best sawtooth"], answer.conditions.map((one) => [one.name, formatQuantity(one.value, units().speed), formatQuantity(one.sawtooth, units().speed)]));
  }
  function fronted(answer) {
    kept.front = answer;
    empty.textContent = `${answer.speed.length} drives; none is better than another in both. Select one.`;
    said.textContent = answer.interrupted ? "Stopped: the front until then." : "";
    frontPlace.hidden = false;
    front.setData(answer);
    root().dataset.front = String(answer.speed.length);
  }
  function tabled(into, heads, rows) {
    const cells = (row) => row.map((text, i) => (i ? h("td", { class: "number" }, text) : h("th", { scope: "row" }, text)));
    into.tabIndex = 0; // it scrolls where it is narrow
    into.replaceChildren(into.firstChild, h("table", {}, h("thead", {}, h("tr", {}, ...heads.map((one, i) => h("th", { scope: "col", class: i ? "number" : "" }, one)))), h("tbody", {}, ...rows.map((row) => h("tr", {}, ...cells(row))))));
  }
  function forget() {
    Object.assign(kept, { found: null, front: null });
    best = false;
    frontPlace.hidden = true;
    sides.fresh.again();
  }

  // --- where a drive goes
  async function send({ drive }) {
    fault.textContent = "";
    const { run: name } = await app.request("/api/design/send", drive);
    said.replaceChildren("The drive is on the bench, as the run “designed”: ", h("a", { href: `#bench?run=${name}` }, "to the bench"));
  }
  async function tell({ drive }) {
    fault.textContent = "";
    await needAccepted(panel);
    said.textContent = "Computing the intervals of a fit …";
    try {
      const { parameters } = await app.request("/api/design/tells", { ...asked(), drive, noise: kept.values.noise });
      const share = (one) => (one === null ? "not identified" : `± ${Number((100 * one).toPrecision(2))} %`);
      tabled(telling, ["parameter", "value", "this recording", "65 V, 5 Hz"], parameters.map((one) => [one.name, formatQuantity(one.value, one.unit), share(one.half_width), share(one.default_half_width)]));
    } finally {
      said.textContent = "";
    }
  }

  maps.want(1);
  frontPlace.hidden = !kept.front;
  if (kept.front) fronted(kept.front);
  if (kept.found) found(kept.found);
  else if (kept.designed) sides.fresh.show(kept.designed.drive, kept.designed.text);
  return () => {
    off();
    maps.end();
    for (const one of [map, front]) one.destroy();
    for (const one of Object.values(sides)) one.end();
  };
}
