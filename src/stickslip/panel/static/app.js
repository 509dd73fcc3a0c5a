// Boot, pages by the location's hash, requests, the stream, notices, emergency stop, theme.

import { makeInterlock } from "./interlock.js";
import { formatQuantity } from "./quantity.js";
import { openStream } from "./stream.js";

const PAGES = { bench: "./bench.js", identify: "./identify.js", explore: "./explore.js", design: "./design.js", move: "./move.js", history: "./history.js", studies: "./studies.js" };
const byId = (id) => document.getElementById(id);

/** A request to the server: GET without a body, else POST. JSON or, for binary answers, an ArrayBuffer. */
async function request(path, body) {
  const headers = { "X-Client": app.client };
  const options = { headers, credentials: "same-origin" };
  if (body !== undefined) {
    options.method = "POST";
    if (body instanceof Blob || body instanceof ArrayBuffer) {
      headers["Content-Type"] = "application/octet-stream";
      options.body = body;
    } else {
      headers["Content-Type"] = "application/json";
      options.body = JSON.stringify(body);
    }
  }
  let answer;
  try {
    answer = await fetch(path, options);
  } catch {
    throw new Error("The server does not answer.");
  }
  const type = answer.headers.get("Content-Type") || "";
  if (!answer.ok) {
    const said = type.includes("json") ? await answer.json() : { error: await answer.text() };
    throw Object.assign(new Error(said.error || answer.statusText), { status: answer.status, field: said.field });
  }
  return type.includes("json") ? answer.json() : answer.arrayBuffer();
}

/** A line at the bottom for some seconds, where it hides no stop; kinds: "", "warning", "error". */
function notify(text, kind = "") {
  const line = document.createElement("div");
  line.className = `notice ${kind}`;
  line.textContent = text;
  const close = document.createElement("button");
  close.type = "button";
  close.textContent = "✕";
  close.setAttribute("aria-label", "Close this notice");
  close.onclick = () => line.remove();
  line.append(close);
  const notices = byId("notices");
  notices.append(line);
  while (notices.children.length > 4) notices.firstChild.remove();
  setTimeout(() => line.remove(), kind === "error" ? 15000 : 6000);
}

/** Something that only this browser tab has: it keeps control of the rig over a reconnection. */
function identity() {
  let found = sessionStorage.getItem("client");
  if (!found) {
    found = [...crypto.getRandomValues(new Uint8Array(12))].map((b) => b.toString(16).padStart(2, "0")).join("");
    sessionStorage.setItem("client", found);
  }
  return found;
}

export const app = { request, notify, client: identity(), control: { holder: "", mine: false, asking: "" } };
app.stream = openStream(app.client);
app.you = ""; // what other pages know this one by; `client` is its secret
app.role = "maintain"; // watch, operate or maintain: what the token of this page allows
app.stream.on("hello", (message) => { app.you = message.you; app.role = message.role; });

// During a run the page in control shows that it is there; a rig with a heartbeat stops without it.
let going = false;
app.stream.on("run", (message) => { going = ["preparing", "running"].includes(message.phase); });
setInterval(() => { if (going && app.control.mine) app.stream.send({ kind: "beat" }); }, 50);

let unmount = () => {};
let shown = "";
async function route() {
  const name = location.hash.slice(1).split("?")[0];
  const page = PAGES[name] ? name : "bench";
  if (page === shown) return;
  shown = page;
  unmount();
  unmount = () => {};
  for (const link of document.querySelectorAll("nav a")) {
    if (link.hash === `#${page}`) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  document.title = `${page[0].toUpperCase()}${page.slice(1)} · stickslip`;
  // Each page has a room of its own: one that is left while it still waits for its data fills none of the next one's.
  const room = document.createElement("div");
  room.className = "room";
  const loading = document.createElement("p");
  loading.className = "soft loading";
  loading.textContent = "Loading…";
  byId("page").replaceChildren(loading, room);
  let left;
  try {
    const module = await import(PAGES[page]);
    if (shown !== page) return;
    left = await module.mount(room, app);
  } finally {
    loading.remove();
  }
  if (shown === page) unmount = left || unmount;
  else left?.();
}

/** As `route`; a page that could not be fetched comes when the server is back. */
function open() {
  return route().catch((error) => {
    shown = "";
    notify(app.stream.connected ? error.message : "The server does not answer.", "error");
  });
}

function emergencyStop() {
  app.stream.send({ kind: "emergency_stop" });
  // The stream is the quickest way; where it is down, a request may still get through.
  if (!app.stream.connected) request("/bench/stop", {}).catch((error) => notify(error.message, "error"));
}

let sounding = 0, sound = null;
/** What people must do now, in red and with a tone each second, until there is evidence that it is over. */
function alarm(text) {
  const bar = byId("alarm");
  if (bar.textContent !== text) bar.textContent = text;
  bar.hidden = !text;
  if (!text) {
    clearInterval(sounding);
    sounding = 0;
  } else if (!sounding) {
    const beep = () => {
      sound ??= new AudioContext();
      const tone = sound.createOscillator();
      tone.frequency.value = 880;
      tone.connect(sound.destination);
      tone.start();
      tone.stop(sound.currentTime + 0.4);
      bar.dataset.tones = String(Number(bar.dataset.tones ?? 0) + 1);
    };
    beep();
    sounding = setInterval(beep, 1000);
  }
}

function theme(choice) {
  const root = document.documentElement;
  if (choice) root.dataset.theme = choice;
  else delete root.dataset.theme;
  window.dispatchEvent(new Event("themechange"));
}

function boot() {
  theme(localStorage.getItem("theme"));
  byId("theme").onclick = () => {
    const dark = document.documentElement.dataset.theme
      ? document.documentElement.dataset.theme === "dark"
      : matchMedia("(prefers-color-scheme: dark)").matches;
    localStorage.setItem("theme", dark ? "light" : "dark");
    theme(dark ? "light" : "dark");
  };
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => window.dispatchEvent(new Event("themechange")));
  byId("stop").onclick = emergencyStop;
  // Before everything else that listens for Esc, and whatever has the focus; but an open dialog is closed first.
  window.addEventListener("keydown", (event) => event.key === "Escape" && !document.querySelector("dialog[open]") && emergencyStop(), { capture: true });

  const lamp = byId("connection");
  app.stream.on("connection", ({ state, missed }) => {
    lamp.textContent = state;
    lamp.dataset.state = state;
    document.body.classList.toggle("offline", state !== "connected");
    if (state === "connected" && !shown) open();
    if (missed) notify(`Connected again after ${missed.toFixed(missed < 10 ? 1 : 0)} s; what was missed is shown.`);
  });
  let stopped = "";
  app.stream.on("run", ({ stop }) => {
    const state = stop?.state ?? "";
    alarm(stop?.alarm ?? "");
    if (state !== stopped && !stop?.alarm && ["ramped", "measured"].includes(state))
      notify(`Stopped: the output has been ramped to 0 V${state === "measured" ? `, the amplifier's monitor reads ${formatQuantity(stop.measured, "V", 3)}` : ""}.`, "warning");
    stopped = state;
  });
  app.stream.on("notice", ({ text, level }) => notify(text, level));
  makeInterlock(app, byId("interlock"), byId("latched"));
  const control = byId("control");
  app.stream.on("control", (state) => {
    const watches = app.role === "watch"; // as if somebody else held it
    app.control = { ...state, holder: state.holder || (watches ? "nobody" : ""), mine: !watches && Boolean(app.you) && state.holder === app.you };
    const asked = app.control.mine && state.asking;
    control.disabled = watches;
    control.textContent = watches ? "Watching" : asked ? "Hand over control" : app.control.mine ? "In control" : state.holder ? "Ask for control" : "Take control";
    control.title = app.control.mine && !asked ? "Only one page controls the rig: this one; press to let go of it" : "Only one page controls the rig; every page sees it";
    control.dataset.state = asked ? "asked" : app.control.mine ? "mine" : state.holder ? "other" : "free";
    if (asked && state.asking !== app.you) notify("Another page asks for control.", "warning");
    document.body.classList.toggle("watching", Boolean(app.control.holder) && !app.control.mine);
    window.dispatchEvent(new Event("controlchange"));
  });
  control.onclick = () => app.stream.send({ kind: app.control.mine ? "hand_over" : "ask_control" });
  window.addEventListener("hashchange", open);
  open();
}

boot();
