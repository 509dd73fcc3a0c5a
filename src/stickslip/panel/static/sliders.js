// Sliders: a range, linear or logarithmic, beside a field for the exact number with its unit.

import { formatQuantity, makeQuantity } from "./quantity.js";

const STEPS = 1000;
const END = 25; // steps at an end of a logarithmic slider that stand for zero or infinity

/** Between a slider's place (0 to STEPS) and its value. */
export function scaleOf({ low, high, scale, zero, infinite }) {
  if (scale !== "log") {
    return {
      value: (place) => rounded(low + ((high - low) * place) / STEPS, (high - low) / STEPS),
      place: (value) => ((Math.min(Math.max(value, low), high) - low) / (high - low)) * STEPS,
    };
  }
  const first = zero ? END : 0, last = infinite ? STEPS - END : STEPS;
  return {
    value(place) {
      if (zero && place < first / 2) return 0;
      if (infinite && place > (last + STEPS) / 2) return Infinity;
      const part = Math.min(Math.max((place - first) / (last - first), 0), 1);
      return Number((low * (high / low) ** part).toPrecision(4));
    },
    place(value) {
      if (zero && value <= 0) return 0;
      if (value === Infinity) return STEPS;
      const part = Math.log(Math.max(value, 1e-300) / low) / Math.log(high / low);
      return first + Math.min(Math.max(part, 0), 1) * (last - first);
    },
  };
}
const rounded = (value, step) => Number(value.toFixed(Math.min(Math.max(2 - Math.floor(Math.log10(step)), 0), 12)));

export const capital = (text) => text[0].toUpperCase() + text.slice(1);

/** A symbol such as "ω_n" or "σ₀", set as it is in print. */
export function symbolOf(text) {
  const [base, below] = text.replace(/[₀-₉]/g, (digit) => `_${digit.charCodeAt(0) - 0x2080}`).split("_");
  const made = document.createElement("var");
  made.append(base);
  if (below) made.append(Object.assign(document.createElement("sub"), { textContent: below }));
  return made;
}

/**
 * A slider for a described field. `drag(value)` is called while it moves, `settle()` when it rests, `type(value)` for a
 * typed number; that may reject: the field says why.
 */
export function makeSlider(field, value, { app, drag, settle, type }) {
  const name = capital(field.meaning);
  const label = field.symbol ? `${name} ${field.symbol}` : name;
  const box = makeQuantity({ label, unit: field.unit, value, app, change: type, hint: `${name}: type a number, with a unit if you like` });
  box.element.classList.add("slider");
  if (field.symbol) box.element.querySelector("label").replaceChildren(`${name} `, symbolOf(field.symbol));
  const scale = scaleOf(field);
  const range = document.createElement("input");
  Object.assign(range, { type: "range", min: 0, max: STEPS, step: 1 });
  range.setAttribute("aria-label", name);
  box.element.insertBefore(range, box.element.querySelector(".fault"));
  const show = (now) => {
    range.value = String(scale.place(now));
    range.setAttribute("aria-valuetext", formatQuantity(now, field.unit));
  };
  range.addEventListener("input", () => {
    const now = scale.value(Number(range.value));
    box.takeBack(); // what was typed and refused holds no longer
    range.setAttribute("aria-valuetext", formatQuantity(now, field.unit));
    drag(now);
  });
  range.addEventListener("change", settle);
  let current = value;
  show(value);
  const fault = box.element.querySelector(".fault");
  return {
    element: box.element,
    range,
    set(now) {
      // Most values stay while one slider moves. A range may have been moved to where its value was refused.
      if (now !== current || Math.abs(Number(range.value) - scale.place(now)) > 1) show(now);
      current = now;
      box.set(now);
    },
    /** What is wrong with the value; "" when nothing is. */
    say(text) {
      fault.textContent = text;
      box.input.setAttribute("aria-invalid", text ? "true" : "false");
    },
  };
}

/** A box to tick, with the manners of a slider. */
export function makeSwitch(field, value, { drag, settle }) {
  const element = document.createElement("label");
  element.className = "switch";
  const box = document.createElement("input");
  box.type = "checkbox";
  box.checked = value;
  const name = document.createElement("span");
  name.textContent = capital(field.meaning);
  const fault = document.createElement("span");
  fault.className = "fault";
  element.append(box, name, fault);
  box.addEventListener("change", () => {
    drag(box.checked);
    settle();
  });
  return { element, range: box, set: (now) => (box.checked = now), say: (text) => (fault.textContent = text) };
}

/** A labelled choice. */
export function makeChoice(label, names, value, choose) {
  const element = document.createElement("label");
  element.className = "field picker";
  const text = document.createElement("span");
  text.textContent = label;
  const select = document.createElement("select");
  for (const [name, shown] of names) select.append(new Option(shown, name));
  select.value = value;
  select.addEventListener("change", () => choose(select.value));
  element.append(text, select);
  return { element, select, set: (now) => (select.value = now) };
}
