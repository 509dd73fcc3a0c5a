// What the Explore page shows as plain data: the state of all sliders, its history, and the link that holds it.

const SECTIONS = { model: "m", friction: "f", waveform: "w" };

/** Infinity as the server reads it; JSON has none. */
export const wire = (state) => ({
  ...state,
  ...Object.fromEntries(Object.keys(SECTIONS).map((section) => [section, written(state[section])])),
  duration: state.duration,
});
const written = (values) => Object.fromEntries(Object.entries(values).map(([name, value]) => [name, value === Infinity ? "inf" : value]));
const read = (values) => Object.fromEntries(Object.entries(values).map(([name, value]) => [name, value === "inf" ? Infinity : value]));

/** The state with which the page begins, or another parameter set does; one that was thrown away is the usual one. */
export function begin(choices, asked = "kang2007", drive = null) {
  const set = asked in choices.sets ? asked : "kang2007";
  const found = choices.sets[set];
  return {
    set,
    model: read(found.model),
    law: found.law,
    friction: read(found.friction[found.law]),
    shape: drive?.shape ?? "Sawtooth",
    waveform: drive?.waveform ?? read(choices.start.Sawtooth),
    duration: drive?.duration ?? 1,
  };
}

/** Whether a set slides or turns: its fields of "model" and of "laws", and "units" of position, speed and force. */
export const kindOf = (choices, set) => choices.by_unit[choices.sets[set].unit];

/** The actuator's fields of a set: hysteresis that is not made of plays has sliders of its own. */
export function modelFields(choices, set) {
  const { piezo: own } = choices.sets[set], { model } = kindOf(choices, set);
  return own.length ? [...model.filter((one) => one.name !== "hysteresis"), ...own] : model;
}

/** The state with one value changed, and those that follow it; see TIED on the server. */
export function changed(choices, state, section, name, value) {
  if (section === "duration") return { ...state, duration: value };
  const values = { ...state[section], [name]: value };
  if (section === "friction") {
    for (const [follower, powers] of Object.entries(choices.tied)) {
      const whole = follower in values && Object.keys(powers).every((one) => one in values);
      const factor = (value / state.friction[name]) ** (powers[name] ?? 0);
      if (whole && name in powers && Number.isFinite(factor)) values[follower] = tidy(state.friction[follower] * factor);
    }
  }
  return { ...state, [section]: values };
}
const tidy = (value) => Number(value.toPrecision(12));

/** Another law for the same contact: what both laws have is kept. */
export function withLaw(choices, state, law) {
  let next = { ...state, law, friction: read(choices.sets[state.set].friction[law]) };
  for (const name of ["sigma_0", "coulomb_force", "sigma_1", "sigma_2", "stribeck_velocity"]) {
    if (name in next.friction && name in state.friction) next = changed(choices, next, "friction", name, state.friction[name]);
  }
  return next;
}

/** Another waveform: amplitude and frequency are kept. */
export function withShape(choices, state, shape) {
  const waveform = read(choices.start[shape]);
  for (const name of ["amplitude", "frequency"]) {
    if (name in waveform && name in state.waveform) waveform[name] = state.waveform[name];
  }
  return { ...state, shape, waveform };
}

/** Everything in the part of an address behind "#explore?". */
export function toLink(state, pins) {
  const query = new URLSearchParams({ set: state.set, law: state.law, shape: state.shape, T: String(state.duration) });
  for (const [section, letter] of Object.entries(SECTIONS)) {
    for (const [name, value] of Object.entries(written(state[section]))) query.set(`${letter}.${name}`, String(value));
  }
  for (const pin of pins) query.append("pin", `${pin.label}\n${toLink(pin.state, [])}`);
  return query.toString();
}

/** { state, pins: [{ label, state }] } of a link; null where it holds none. What it leaves out is as at the beginning. */
export function fromLink(choices, text) {
  const query = new URLSearchParams(text);
  if (![...query.keys()].length) return null;
  const start = begin(choices, query.get("set") ?? undefined);
  const law = query.get("law") in kindOf(choices, start.set).laws ? query.get("law") : start.law;
  const shape = query.get("shape") in choices.shapes ? query.get("shape") : "Sawtooth";
  let state = withShape(choices, start, shape);
  state = { ...state, law, friction: read(choices.sets[start.set].friction[law]), duration: value(query.get("T"), 1) };
  for (const [section, letter] of Object.entries(SECTIONS)) {
    for (const name of Object.keys(state[section])) {
      state[section] = { ...state[section], [name]: value(query.get(`${letter}.${name}`), state[section][name]) };
    }
  }
  const pins = query.getAll("pin").slice(0, 3).map((pin) => {
    const cut = pin.indexOf("\n");
    return { label: pin.slice(0, cut), state: fromLink(choices, pin.slice(cut + 1))?.state };
  });
  return { state, pins: pins.filter((pin) => pin.state) };
}
function value(text, otherwise) {
  if (text === null) return otherwise;
  if (text === "true" || text === "false") return text === "true";
  if (text === "inf") return Infinity;
  return text.trim() !== "" && Number.isFinite(Number(text)) ? Number(text) : otherwise;
}

/** Undo and redo over whole states. */
export function makeHistory(first) {
  const states = [first];
  let at = 0;
  return {
    add(state) {
      if (JSON.stringify(wire(state)) === JSON.stringify(wire(states[at]))) return;
      states.splice(at + 1, Infinity, state);
      if (states.length > 300) states.shift();
      at = states.length - 1;
    },
    undo: () => (at > 0 ? states[--at] : null),
    redo: () => (at < states.length - 1 ? states[++at] : null),
    get canUndo() { return at > 0; },
    get canRedo() { return at < states.length - 1; },
  };
}

/** The friction loop of a motion. */
export const loopOf = (found) => (found ? [found.sliding_displacement.subarray(...found.loop), found.friction_force.subarray(...found.loop)] : [[], []]);

/** Only the points that exist. */
export function finite(x, y) {
  const kept = [...x.keys()].filter((i) => Number.isFinite(y[i]));
  return [kept.map((i) => x[i]), kept.map((i) => y[i])];
}

/** Values at other times, by straight lines; nothing beyond the ends. */
export function resampled(from, values, to) {
  const found = new Float32Array(to.length);
  let i = 0;
  for (let k = 0; k < to.length; k++) {
    const t = to[k];
    while (i + 2 < from.length && from[i + 1] < t) i++;
    const part = (t - from[i]) / (from[i + 1] - from[i] || 1);
    found[k] = t > from[from.length - 1] ? NaN : values[i] + part * (values[i + 1] - values[i]);
  }
  return found;
}
