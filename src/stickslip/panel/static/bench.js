// The Bench page: run experiments, see them live, keep and compare the recordings.

import { makeArrangement } from "./arrangement.js";
import { makeCapture } from "./capture.js";
import { h, openDialog } from "./dom.js";
import { variableField } from "./instruments.js";
import { makeLiveData } from "./livedata.js";
import { makeLog, makeVariables } from "./tables.js";
import { makeRecordings } from "./recordings.js";
import { makeRig } from "./rigs.js";
import { formatQuantity, needAccepted } from "./quantity.js";
import { makeSequence } from "./sequence.js";
import { makeStatistics } from "./statistics.js";

const HEARTBEAT = "200 ms"; // as a box ticks it; a file may say another

const PHASES = { idle: "Ready", preparing: "Preparing", running: "Running", stopping: "Stopping: ramp to 0 V", done: "Done", stopped: "Stopped", failed: "Failed" };

export async function mount(element, app) {
  const bench = {
    app,
    experiment: { name: "", content: { runs: [] }, panel: [], channels: [], variables: [] },
    run: { phase: "idle", position: 0 },
    live: makeLiveData(app),
    shown: { live: true, recordings: [] },
    chosen: new URLSearchParams(location.hash.split("?")[1] ?? "").get("run"), // the run that Start starts
    /** Change one place of the experiment; the server refuses what cannot be recorded. */
    set: (path, value) => app.request("/bench/set", { path, value }),
    act(path, body = {}) {
      return app.request(path, body).catch((error) => app.notify(error.message, "error"));
    },
    /** Whatever starts runs asks first: throws where a field of the page is refused. */
    needAccepted: () => needAccepted(element),
    show(shown) {
      bench.shown = { ...bench.shown, ...shown };
      arrangement.update();
      recordings.update();
    },
  };

  // --- running
  const select = h("select", { id: "run-choice", onchange: () => { bench.chosen = select.value; capture.build(); } });
  const start = h("button", { type: "button", id: "start", class: "primary", onclick: () => begin("/bench/start", { runs: [bench.chosen] }) }, "Start");
  const halt = h("button", { type: "button", id: "halt", title: "Ramp to 0 V and end the run", onclick: () => bench.act("/bench/stop") }, "Stop");
  const home = h("button", { type: "button", id: "home", title: "Walk back to where home is", onclick: () => begin("/bench/home") }, "Home");
  const here = h("button", { type: "button", class: "small quiet", title: "Call the present position home", onclick: () => bench.act("/bench/home_here") }, "Set home here");
  const phase = h("strong", { id: "phase" });
  const doing = h("span", { class: "soft number", id: "doing" });
  const bar = h("progress", { max: 1, value: 0, "aria-label": "Progress of the run" });
  const inputs = h("div", { class: "inputs", id: "inputs" });
  // Whoever does not hold control may do no more than stop.
  const rig = makeRig(bench);
  const beat = h("input", { type: "checkbox", id: "heartbeat", onchange: () => bench.set(["limits", "heartbeat"], beat.checked ? HEARTBEAT : null).catch((error) => { beat.checked = !beat.checked; app.notify(error.message, "error"); }) });
  const heartbeat = h("label", { class: "choice", title: "For rigs that somebody must watch: closing this page, another tab in front of it or a lost network end the run with a ramp to 0 V" }, beat, h("span", {}));
  const whole = (...inside) => h("fieldset", { class: "bare" }, ...inside);
  const watching = h("p", { class: "watching", hidden: true }, "Another page is in control: ask it at the top. Stop works from here too.");
  const choice = whole(h("div", { class: "field" }, h("label", { htmlFor: "run-choice" }, "Run"), select), rig.element);
  const values = whole(heartbeat, h("h2", {}, "Inputs"), inputs);
  const controls = h("div", { class: "bare" }, watching, choice, h("div", { class: "row" }, start, halt, home), values);
  const words = h("input", { "aria-label": "A note on this run", placeholder: "Note on this run", maxLength: 2000 });
  const note = h("form", { class: "note", onsubmit: async () => {
    if (!words.value.trim()) return;
    const kept = await bench.act("/bench/note", { text: words.value });
    if (!kept) return;
    words.value = "";
    app.notify(kept.kept ? "Noted, with the recording." : "Noted in the log: there is no run of this panel yet.");
  } }, words, h("button", { class: "small" }, "Note"));
  const capture = makeCapture(bench);
  const recordings = makeRecordings(bench);
  const variables = makeVariables(bench);
  const log = makeLog(app);
  const sequence = makeSequence(bench);
  const statistics = makeStatistics(bench);
  const tabs = makeTabs([["Recordings", recordings.element], ["Capture", capture.element], ["Sequence", sequence.element], ["Statistics", statistics.element], ["Variables", variables.element], ["Log", log.element]]);
  const side = h("section", { class: "side", "aria-label": "Run" },
    h("div", { class: "card" }, controls, h("div", { class: "status", role: "status" }, h("div", { class: "row" }, phase, h("span", { class: "grow" }), here), bar, doing, note)),
    h("div", { class: "card tabs" }, tabs));

  // --- experiment file and instruments
  const name = h("h1", { id: "experiment" });
  const undo = h("button", { type: "button", class: "small", title: "Take the last change back (Ctrl+Z)", onclick: () => bench.act("/bench/undo") }, "Undo");
  const redo = h("button", { type: "button", class: "small", title: "Make it again (Ctrl+Shift+Z)", onclick: () => bench.act("/bench/undo", { again: true }) }, "Redo");
  function keys(event) {
    if (!(event.ctrlKey || event.metaKey) || event.target.matches?.("textarea, dialog *")) return;
    const key = event.key.toLowerCase();
    if (key !== "z" && key !== "y") return;
    event.preventDefault();
    bench.act("/bench/undo", { again: key === "y" || event.shiftKey });
  }
  window.addEventListener("keydown", keys);
  const arrangement = makeArrangement(bench);
  const tools = h("div", { class: "row tools" }, name, h("span", { class: "grow" }), undo, redo,
    h("button", { type: "button", class: "small", onclick: loadDialog }, "Load…"),
    h("button", { type: "button", class: "small", onclick: saveDialog }, "Save…"),
    ...arrangement.buttons);
  element.append(h("div", { class: "bench" }, side, h("section", { class: "desk", "aria-label": "Instruments" }, tools, arrangement.element)));

  async function begin(path, body) {
    try {
      await bench.needAccepted();
    } catch (error) {
      return app.notify(error.message, "error");
    }
    bench.show({ live: true });
    return bench.act(path, body);
  }

  function loadDialog() {
    return openDialog("Load an experiment", (close) => {
      const list = h("div", { class: "choices" }, "…");
      app.request("/bench/experiments").then((names) => list.replaceChildren(...(names.length ? names.map((one) =>
        h("button", { type: "button", onclick: () => { close(); bench.act("/bench/load", { name: one }); } }, one)) : ["There are no experiment files in the folder yet."])));
      return h("div", {}, list, h("div", { class: "row end" }, h("button", { type: "button", onclick: close }, "Cancel")));
    });
  }
  function saveDialog() {
    return openDialog("Save the experiment", (close) => {
      const field = h("input", { id: "save-name", value: bench.experiment.name || "experiment.yaml", spellcheck: false });
      const save = async () => {
        const wanted = /\.yaml$/.test(field.value) ? field.value : `${field.value}.yaml`;
        if (await bench.act("/bench/save", { name: wanted })) close();
      };
      return h("form", { onsubmit: save },
        h("div", { class: "field" }, h("label", { htmlFor: "save-name" }, "Name, with inputs, capture settings and instruments"), field),
        h("div", { class: "row end" }, h("button", { type: "button", onclick: close }, "Cancel"), h("button", { class: "primary" }, "Save")));
    });
  }

  // --- what the server tells
  let fields = [];
  let shape = "";
  function showExperiment() {
    const { experiment } = bench;
    name.textContent = `${experiment.content.title}${experiment.name ? ` · ${experiment.name}` : ""}`;
    const runs = experiment.content.runs.map((one) => one.name);
    if (!runs.includes(bench.chosen)) bench.chosen = runs[0] ?? null;
    if (select.options.length !== runs.length || runs.some((one, i) => select.options[i].value !== one)) {
      select.replaceChildren(...runs.map((one) => h("option", { value: one, title: experiment.content.runs.find((r) => r.name === one).notes }, one)));
    }
    select.value = bench.chosen;
    beat.checked = experiment.content.limits?.heartbeat !== undefined;
    heartbeat.lastChild.textContent = `Stop if this page is silent for ${String(experiment.content.limits?.heartbeat ?? HEARTBEAT).replace(" ", "\u00a0")}`;
    const own = experiment.variables.filter((one) => one.kind === "experiment");
    const now = JSON.stringify(own.map(({ name: called, unit }) => [called, unit]));
    if (now !== shape) {
      shape = now;
      fields = own.map((one) => [one.name, variableField(bench, one)]);
      inputs.replaceChildren(...fields.map(([, field]) => field.element));
    }
    for (const [called, field] of fields) field.set(own.find((one) => one.name === called).value);
    rig.show();
    capture.build();
    variables.build();
    sequence.build();
    arrangement.build();
    showControl();
  }
  function showRun() {
    const { run: now } = bench;
    const busy = ["preparing", "running", "stopping"].includes(now.phase);
    phase.textContent = PHASES[now.phase] ?? now.phase;
    phase.dataset.phase = now.phase;
    if (now.number !== undefined) phase.dataset.number = now.number; // until the server has said it, there is none
    bar.value = busy ? now.done : now.phase === "done" ? 1 : 0;
    const left = now.remaining !== null && busy ? ` · ${formatQuantity(now.remaining, "s", 2)} left` : "";
    doing.textContent = busy ? `${Math.round(100 * now.done)} %${left} · ${now.doing || now.title}` : now.title;
    halt.disabled = !busy;
    showControl();
    arrangement.values();
  }
  function showControl() {
    const other = Boolean(app.control.holder) && !app.control.mine;
    const busy = !halt.disabled;
    watching.hidden = !other;
    for (const one of [choice, values, ...tools.querySelectorAll("button")]) one.disabled = other;
    // Until the server has said what there is to run, nothing can be started.
    start.disabled = home.disabled = here.disabled = busy || other || !bench.experiment.content.runs.length;
    undo.disabled = other || !bench.experiment.undo;
    redo.disabled = other || !bench.experiment.redo;
  }
  const offs = [
    app.stream.on("experiment", (message) => { bench.experiment = message; showExperiment(); }),
    app.stream.on("run", (message) => { bench.run = message; showRun(); }),
    app.stream.on("recordings", () => recordings.build()),
    app.stream.on("connection", ({ state }) => state === "connected" && recordings.build()),
  ];
  window.addEventListener("controlchange", showControl);
  showControl();
  showRun();
  recordings.build();
  app.stream.send({ kind: "greet" }); // a page that was mounted later has missed the greeting
  return () => {
    offs.forEach((off) => off());
    window.removeEventListener("controlchange", showControl);
    window.removeEventListener("keydown", keys);
    bench.live.destroy();
    arrangement.destroy();
    log.destroy();
    sequence.destroy();
    statistics.destroy();
  };
}

/** Tabs as the WAI-ARIA practices have them: arrow keys move between them. */
function makeTabs(pages) {
  const list = h("div", { role: "tablist", class: "tablist" });
  const heads = pages.map(([title, page], i) => {
    page.id = `tab-${title.toLowerCase()}`;
    page.setAttribute("role", "tabpanel");
    page.setAttribute("aria-label", title);
    return h("button", { type: "button", role: "tab", "aria-controls": page.id, onclick: () => choose(i), onkeydown: (event) => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (step) { choose((i + step + pages.length) % pages.length); heads[(i + step + pages.length) % pages.length].focus(); }
    } }, title);
  });
  function choose(index) {
    heads.forEach((head, i) => { head.setAttribute("aria-selected", String(i === index)); head.tabIndex = i === index ? 0 : -1; });
    pages.forEach(([, page], i) => (page.hidden = i !== index));
  }
  list.append(...heads);
  choose(0);
  return h("div", { class: "tabbox" }, list, ...pages.map(([, page]) => page));
}
