// Next steps after a fit: save it as a parameter set, predict a drive, send that to the bench, verify on what was
// recorded, read the report. Each step is a button, and leaves something in the history.

import { h } from "./dom.js";
import { calledShortly, showRecording } from "./livedata.js";
import { makePlot } from "./plot.js";
import { formatQuantity } from "./quantity.js";

const SHAPES = ["Sawtooth", "ReverseSawtooth", "Triangle", "Cycloid", "Sine"];

/** The card for a fit (its folder); `card.destroy()` when it goes. */
export function pathCard(app, fit) {
  const fault = h("p", { class: "fault", role: "alert" });
  const said = h("p", { class: "path-said", role: "status" });
  const steps = h("ol", { class: "path" });
  const canvas = h("div", { class: "path-canvas", hidden: true });
  const card = h("section", { class: "card", "aria-label": "Next steps" }, h("h2", {}, "Next steps"), steps, fault, said, canvas);
  let plot = null;
  let gone = false;
  const called = (name) => {
    const stamp = /^predictions\/\d{4}-(\d\d-\d\d)_(\d\d)(\d\d)(\d\d)/.exec(name);
    return stamp ? `${stamp[1]} ${stamp[2]}:${stamp[3]}:${stamp[4]}` : calledShortly(name).replace(/^parameters\/(.*)\.toml$/, "$1");
  };
  const options = (names) => names.map((name) => h("option", { value: name }, called(name)));
  const field = (label, control) => { control.setAttribute("aria-label", label); return control; };
  const name = field("Name of the parameter set", h("input", { value: `fit ${fit.split("/").at(-1)}`, spellcheck: false }));
  const set = field("Parameter set", h("select"));
  const shape = field("Waveform", h("select", {}, ...SHAPES.map((one) => h("option", {}, one))));
  const amplitude = field("Amplitude", h("input", { value: "60 V", size: 6, spellcheck: false }));
  const frequency = field("Frequency", h("input", { value: "10 Hz", size: 6, spellcheck: false }));
  const periods = field("Periods", h("input", { type: "number", value: "8", min: 1, max: 1000 }));
  const prediction = field("Prediction", h("select", { onchange: () => draw().catch(refuse) }));
  const recording = field("Recording to verify on", h("select"));
  const report = h("div", { class: "row" });
  const acts = {};
  const refuse = (error) => { fault.textContent = error.message; said.textContent = ""; };
  /** One act at a time, with what it says. */
  const act = (text, does) => (acts[text] = h("button", { type: "button", class: "small", onclick: async () => {
    fault.textContent = "";
    said.textContent = `${text} …`;
    for (const one of Object.values(acts)) one.disabled = true;
    try {
      said.textContent = await does();
      await load();
    } catch (error) {
      refuse(error);
    }
    enable();
  } }, text));
  const step = (title, ...content) => h("li", {}, h("h3", {}, title), h("div", { class: "row" }, ...content));
  steps.append(
    step("Keep it", name, act("Save as parameter set", async () => `Saved: ${(await app.request("/path/save", { fit, name: name.value.trim() })).name}.`)),
    step("Predict", set, shape, amplitude, frequency, periods, act("Predict", async () => {
      const made = await app.request("/path/predict", { parameters: set.value, shape: shape.value, amplitude: amplitude.value, frequency: frequency.value, periods: Number(periods.value) });
      await load(made.name);
      const { net_displacement: net, steady_step: one, unit } = made.numbers;
      return `Predicted: ${formatQuantity(net, unit)} in all, ${formatQuantity(one, unit)} a period once it is steady.`;
    })),
    step("Try it", prediction, act("Send this drive to the bench", async () => {
      await app.request("/path/send", { prediction: prediction.value });
      return "It is on the bench, as the run “predicted”: start it there, and come back.";
    }), h("a", { href: "#bench?run=predicted" }, "To the bench")),
    step("Verify", recording, act("Verify", async () => (await app.request("/path/verify", { fit, recordings: [recording.value] })).summary)),
    step("Report", report));

  let known = { sets: [], predictions: [], recordings: [], others: [], verifications: [] };
  function enable() {
    acts["Save as parameter set"].disabled = false;
    acts.Predict.disabled = !known.sets.length;
    acts["Send this drive to the bench"].disabled = !known.predictions.length;
    acts.Verify.disabled = !recording.options.length;
  }
  const fill = (select, made, otherwise) => {
    const before = select.value;
    select.replaceChildren(...(made.length ? made : [h("option", { value: "" }, otherwise)]));
    if ([...select.options].some((one) => one.value === before)) select.value = before;
    select.disabled = !made.length;
  };
  async function load(newest = "") {
    known = await app.request(`/path?${new URLSearchParams({ fit })}`);
    if (gone) return;
    fill(set, options(known.sets), "save the fit first");
    fill(prediction, options(known.predictions), "predict first");
    if (newest) prediction.value = newest;
    const others = known.others.filter((one) => !known.recordings.includes(one));
    fill(recording, [...(known.recordings.length ? [h("optgroup", { label: "of these predictions" }, ...options(known.recordings))] : []),
      ...(others.length ? [h("optgroup", { label: "others that it was not fitted to" }, ...options(others))] : [])], "record something first");
    if (!recording.disabled && !recording.value) recording.selectedIndex = 0;
    const link = (to, text) => h("a", { href: `/api/identify/report/${to}`, target: "_blank", rel: "noopener" }, text);
    report.replaceChildren(link(fit, "of the fit"), ...known.verifications.slice(0, 5).map((one) => link(one, `of the verification, ${one.split("/").at(-1).slice(0, 17)}`)));
    enable();
    await draw();
  }
  let drawn = "";
  async function draw() {
    const chosen = prediction.value;
    if (gone || chosen === drawn || !chosen) return;
    drawn = chosen;
    const { header, x, columns } = await showRecording(app, chosen, null, 2000);
    if (gone) return;
    plot?.destroy();
    canvas.hidden = false;
    plot = makePlot(canvas, { series: header.columns, label: "The prediction" });
    plot.setPresent(header.latest);
    plot.setData([x, ...columns]);
  }
  enable();
  load().catch(refuse);
  const off = app.stream.on("recordings", () => load().catch(refuse));
  card.destroy = () => { gone = true; off(); plot?.destroy(); };
  return card;
}
