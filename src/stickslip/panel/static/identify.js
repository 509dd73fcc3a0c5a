// The Identify page: choose recordings and what is free, watch the fit, read what it found and how sure that is.

import { button, make, styled } from "./elements.js";
import { begin, toLink, withLaw } from "./explore_state.js";
import { fitForm } from "./identify_form.js";
import { calledShortly } from "./livedata.js";
import { pathCard } from "./path.js";
import { makePlot } from "./plot.js";
import { formatInterval, formatQuantity } from "./quantity.js";
import { unpack } from "./stream.js";

const KINDS = ["stage", "recordings", "step", "verified"];

export async function mount(element, app) {
  await Promise.all([styled("./explore.css"), styled("./identify.css")]);
  const [choices, found] = await Promise.all([app.request("/api/explore/choices"), app.request("/api/identify/state")]);
  let state = found;
  let traces = {}; // kind -> arrays
  let shown = 0; // which recording is drawn
  let news = 0; // how often the stream said how the fit stands

  const asked = new URLSearchParams(location.hash.split("?")[1]).get("recording");
  const form = await fitForm(app, choices, state.request, asked, start, cancel);
  const status = make("p", { className: "identify-status" });
  status.setAttribute("role", "status");
  const bar = make("progress", { max: 1 });
  bar.setAttribute("aria-label", "The fit is running");
  const fault = make("p", { className: "fault" });
  fault.setAttribute("role", "alert");
  const which = make("select", {});
  which.setAttribute("aria-label", "Recording that is shown");
  which.addEventListener("change", () => {
    shown = which.selectedIndex;
    draw();
  });
  const canvas = make("div", { className: "identify-canvas empty" });
  const live = make("dl", { className: "explore-numbers identify-live" });
  const next = make("div", {});
  let further = null; // the way on, from the fit of this folder
  let on = "";
  const results = make("div", { className: "identify-results" });
  const first = make("section", { className: "card identify-first", hidden: true }, make("h2", { textContent: "What comes here" }),
    make("ol", {},
      make("li", {}, "Record a walk, and a step with the end-effector clamped if you can, on the ", make("a", { href: "#bench", textContent: "Bench page" }), ", or bring your own file on the ", make("a", { href: "#history", textContent: "History page" }), "."),
      make("li", { textContent: "Tick them at the left: steps, walks to fit, walks to predict. Of the bench's own recordings the newest are ticked already." }),
      make("li", { textContent: "Press Start fit: measured and model move together here while it runs. Then come the estimates with their intervals, how well the walks that were not fitted are predicted, and a report." })));
  const head = make("div", { className: "identify-head" }, make("h2", { textContent: "Fit" }), which, make("span", { className: "grow" }), status, bar);
  const right = make("div", { className: "identify-right" },
    make("section", { className: "card identify-picture" }, head, fault, live, canvas), first, results, next);
  element.append(make("h1", { className: "visually-hidden", textContent: "Identify" }), make("div", { className: "identify" }, form.element, right));
  let plot = null, unit = ""; // of the position
  /** A plot in the unit of the recordings; until a fit has said it, in that of before. */
  function picture() {
    const now = state.unit ?? (unit || "m");
    if (now === unit) return;
    unit = now;
    plot?.destroy();
    plot = makePlot(canvas, {
      label: "Measured position, the model, and the residuals",
      series: [
        { label: "measured", unit, color: "--series-6", width: 3 },
        { label: "model", unit, color: "--series-1" },
        { label: "residual (model − measured)", unit, strip: "residual", color: "--series-2", width: 1.2 },
      ],
    });
  }
  picture();

  async function start(request) {
    fault.textContent = "";
    await app.request("/api/identify/start", request);
    plot.autoscale();
    if (right.getBoundingClientRect().top > innerHeight / 2) right.scrollIntoView();
  }
  async function cancel() {
    await app.request("/api/identify/cancel", {});
  }

  // --- what there is to draw: the fitted recordings, then the predicted ones, then the steps
  const names = () => [...(state.names ?? []), ...Object.keys(state.verification?.recordings ?? {}), ...(state.names ? state.step_names ?? [] : [])];
  const roleOf = (index) => {
    const fitted = state.names?.length ?? 0, predicted = Object.keys(state.verification?.recordings ?? {}).length;
    return index < fitted ? "" : index < fitted + predicted ? " (predicted)" : " (step)";
  };
  function curves(index) {
    const fitted = state.names?.length ?? 0;
    const others = [...(traces.verified ?? []), ...(traces.stage ?? [])];
    // A page that comes during a fit hears of the model's curves before it has the measured ones.
    const [t, measured] = index < fitted ? (traces.recordings ?? []).slice(2 * index, 2 * index + 2) : others.slice(3 * (index - fitted));
    const model = index < fitted ? traces.step?.[index] : others[3 * (index - fitted) + 2];
    if (!t) return [[], [], [], []];
    const drawn = model?.length === t.length ? model : new Float32Array(t.length).fill(NaN);
    return [t, measured, drawn, drawn.map((value, i) => value - measured[i])];
  }
  function draw() {
    const drawn = curves(shown);
    plot.setData(drawn);
    canvas.classList.toggle("empty", !drawn[0].length);
    canvas.dataset.drawn = String(Number(canvas.dataset.drawn ?? 0) + 1);
  }

  // --- what is said
  function tell() {
    picture();
    const running = state.phase === "running";
    form.running(running);
    bar.hidden = !running;
    fault.textContent = state.error ?? "";
    const seconds = state.elapsed === undefined ? "" : ` after ${state.elapsed.toFixed(1)} s`;
    const step = state.step;
    status.textContent = {
      none: "No fit yet: choose recordings and start.",
      running: `${state.doing}${step?.evaluations ? `, ${step.evaluations} evaluations${step.starts > 1 ? `, start ${step.start} of ${step.starts}` : ""}` : ""} …`,
      cancelled: `Cancelled${seconds}; the last picture stays.`,
      failed: "The fit failed.",
      done: `Done${seconds}.`,
    }[state.phase];
    element.querySelector(".identify").dataset.phase = state.phase;
    live.replaceChildren(...(running || state.phase === "cancelled" ? liveNumbers(step) : []));
    const options = names();
    if (options.join("\n") !== [...which.options].map((one) => one.value).join("\n")) {
      which.replaceChildren(...options.map((name, i) => new Option(calledShortly(name) + roleOf(i), name)));
      which.selectedIndex = Math.min(shown, options.length - 1);
    }
    which.hidden = options.length < 2;
    first.hidden = state.phase !== "none";
    results.replaceChildren(...(state.fit ? resultCards() : []));
    const fit = state.phase === "done" && state.report ? state.report.replace(/\/report\.html$/, "") : "";
    if (fit !== on) {
      on = fit;
      further?.destroy();
      further = fit ? pathCard(app, fit) : null;
      next.replaceChildren(...(further ? [further] : []));
    }
  }
  function liveNumbers(step) {
    if (!step) return [];
    const pairs = step.rmse === undefined ? [] : [["rms residual", formatQuantity(step.rmse, unit)]];
    for (const [name, value] of Object.entries(step.values ?? {})) pairs.push([form.labelOf(name), formatQuantity(value, form.unitOf(name))]);
    return pairs.map(([name, value]) => make("div", {}, make("dt", {}, ...[name].flat()), make("dd", { textContent: value })));
  }
  function table(caption, heads, rows) {
    const cells = (tag, row) => row.map((text, i) => make(i ? tag : "th", { className: i ? "number" : "" }, ...[text].flat()));
    return make("table", {}, make("caption", { textContent: caption }), make("thead", {}, make("tr", {}, ...cells("th", heads))),
      make("tbody", {}, ...rows.map((row) => make("tr", {}, ...cells("td", row)))));
  }
  function resultCards() {
    const { fit } = state;
    const estimates = (found) => Object.entries(found.parameters).filter(([name]) => !/^(lag|(offset|drift)_\d+)$/.test(name)).map(([name, p]) => [form.labelOf(name), formatQuantity(p.value, p.unit, digitsOf(p)),
      formatInterval(...p.interval, p.unit), p.standard_error === null ? "at its bound" : formatQuantity(p.standard_error, p.unit, 2),
      ...(found.systematics?.length ? [p.interval_both ? formatInterval(...p.interval_both, p.unit) : ""] : [])]);
    const heads = (found) => ["parameter", "estimate", "95 % interval", "standard error", ...(found.systematics?.length ? ["with systematic errors"] : [])];
    const sentences = fit.undetermined.length ? fit.undetermined : ["The recordings determine every parameter that was free."];
    const names = new RegExp(`\\b(${Object.keys(fit.parameters).join("|")})\\b`);
    const said = sentences.map((text) => make("li", { className: fit.undetermined.length ? "weak" : "" }, ...text.split(names).flatMap((part, i) => (i % 2 ? form.labelOf(part) : [part]))));
    for (const one of fit.lack_of_fit ?? []) if (one.seen) said.push(make("li", { className: "weak", textContent: `${one.sentence}.` }));
    for (const text of state.verification?.statements ?? []) said.push(make("li", { className: "weak", textContent: `${text}.` }));
    for (const one of fit.systematics ?? []) said.push(make("li", { textContent: `${one.sentence[0].toUpperCase()}${one.sentence.slice(1)}.` }));
    if (!fit.converged) said.push(make("li", { className: "weak", textContent: `The fit did not converge: ${fit.message}.` }));
    const advised = [];
    if (fit.advice) said.push(make("li", { className: "weak", textContent: `${fit.advice.sentence[0].toUpperCase()}${fit.advice.sentence.slice(1)}.` }));
    if (state.advised && state.phase === "done") {
      const again = button("Fit again with this", `Free ${fit.advice.cause}, and fit again`, () => start(state.advised).catch((error) => (fault.textContent = error.message)), "");
      advised.push(make("p", {}, again));
    }
    const notes = (state.notes ?? []).map((text) => make("li", { textContent: text }));
    const remarks = notes.length ? [make("details", { className: "soft" }, make("summary", { textContent: "Notes on the recordings" }), make("ul", { className: "identify-said" }, ...notes))] : [];
    const found = make("section", { className: "card" }, make("h2", { textContent: "Parameters" }),
      table("Estimates with 95 % confidence intervals", heads(fit), estimates(fit)),
      make("ul", { className: "identify-said" }, ...said), ...advised, ...remarks,
      ...(state.stage ? [table("The stage, from the clamped steps", heads(state.stage), estimates(state.stage))] : []),
      ...(state.hysteresis ? [make("p", { textContent: `${state.hysteresis_said[0].toUpperCase()}${state.hysteresis_said.slice(1)}.` }),
        make("details", {}, make("summary", { textContent: "Hysteresis and creep, from the loops" }), table("Plays by ascending threshold, creep per decade", heads(state.hysteresis), estimates(state.hysteresis)))] : []));
    const goodness = (recordings, role) => Object.entries(recordings).map(([name, g]) => [calledShortly(name), role, g.r_squared === null ? "–" : g.r_squared.toFixed(5), formatQuantity(g.rmse, unit), String(g.n_data)]);
    const seen = [...goodness(state.hysteresis?.recordings ?? {}, "loops"), ...goodness(state.stage?.recordings ?? {}, "step"), ...goodness(fit.recordings, "fitted"), ...goodness(state.verification?.recordings ?? {}, "predicted")];
    const links = make("p", { className: "identify-links" });
    if (state.report) {
      const report = make("a", { textContent: "Report", href: `/api/identify/report/${state.report.replace(/\/report\.html$/, "")}`, target: "_blank", rel: "noopener" });
      links.append(report, make("span", { className: "soft", textContent: state.report }));
    }
    links.append(make("a", { textContent: "Explore this model", href: exploreLink() }));
    const good = make("section", { className: "card" }, make("h2", { textContent: "Goodness of fit and verification" }),
      table("r² about each recording's own mean", ["recording", "use", "r²", "rms residual", "samples"], seen), links);
    return [found, good];
  }
  function exploreLink() {
    const { request, model } = state;
    let next = withLaw(choices, begin(choices, request.set), model.law);
    const infinite = (values) => Object.fromEntries(Object.entries(values).map(([name, value]) => [name, value === "inf" ? Infinity : value]));
    next = { ...next, model: { ...next.model, ...infinite(request.model), ...infinite(model.model) }, friction: infinite(model.friction) };
    return `#explore?${toLink(next, [])}`;
  }

  // --- news
  async function fetchAll() {
    // What the stream says meanwhile is newer than the answers.
    const before = news;
    traces = {};
    const now = await app.request("/api/identify/state");
    const kinds = KINDS.filter((kind) => now.frames.includes(kind));
    const frames = await Promise.all(kinds.map((kind) => app.request(`/api/identify/traces/${kind}`)));
    traces = { ...Object.fromEntries(kinds.map((kind, i) => [kind, unpack(frames[i]).arrays])), ...traces };
    if (news === before) state = now;
    tell();
    draw();
  }
  const again = () => fetchAll().catch((error) => app.notify(error.message, "error"));
  const ending = [
    app.stream.on("fit", (message) => {
      // Its curves come after this; the answer to the request that started it may come later than they do.
      if (message.phase === "running" && state.phase !== "running") [traces, shown] = [{}, 0];
      state = message;
      news += 1;
      tell();
    }),
    app.stream.on("fit_traces", (header, arrays) => {
      traces[header.what] = arrays;
      draw();
    }),
    app.stream.on("recordings", form.refresh),
    app.stream.on("connection", ({ state: now }) => now === "connected" && again()),
  ];
  await form.listed;
  await again();
  return () => {
    ending.forEach((end) => end());
    plot.destroy();
    further?.destroy();
  };
}

/** Digits of an estimate: as far as its standard error has two. */
function digitsOf({ value, standard_error: error }) {
  if (!(error > 0) || !value) return 5;
  const place = (number) => Math.floor(Math.log10(Math.abs(number)));
  return Math.min(Math.max(place(value) - place(error) + 2, 2), 6);
}
