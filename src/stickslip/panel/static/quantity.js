// Numbers with units: reading "65 V", "65" or "0.065 kV", writing 6.5e-5 m as "65 µm", and the field for both.

const PREFIXES = { p: -12, n: -9, u: -6, "µ": -6, "μ": -6, m: -3, c: -2, d: -1, k: 3, M: 6, G: 9 };
const SHOWN = { "-12": "p", "-9": "n", "-6": "µ", "-3": "m", 0: "", 3: "k", 6: "M", 9: "G" };
const PREFIXED = /^(?:m|s|V|A|N|Hz|W|J|C|F|rad)(?:[ /]|$)/;
const EXAMPLE = { V: "65 V", m: "20 µm", s: "50 ms", Hz: "100 Hz", N: "0.5 N", F: "1.8 µF", kg: "5 g", rad: "1 mrad", "N m": "5 mN m", "kg m^2": "20 g cm^2", "V/s": "300 kV/s" }; // as they are met here
const NUMBER = /^\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*$/;

/** Power of ten by which one factor of a unit ("um") is another ("m"); null if it is not of its kind. */
function power(text, unit) {
  if (text === unit) return 0;
  if (unit === "kg") return text === "g" ? -3 : text.endsWith("g") && text[0] in PREFIXES && text.length === 2 ? PREFIXES[text[0]] - 3 : null;
  if (text.endsWith(unit) && text.length === unit.length + 1 && text[0] in PREFIXES) return PREFIXES[text[0]];
  return null;
}

/** The number in SI that a text stands for; throws an Error that says what is wrong. null: ask the server. */
export function parseQuantity(text, unit) {
  if (/^\s*(?:∞|inf)/i.test(text)) return Infinity;
  const found = NUMBER.exec(text);
  if (!found) throw new Error(unit ? `a number in ${unit}, such as ${EXAMPLE[unit] ?? `1 ${unit}`}` : "a number");
  const [, number, rest] = found;
  if (/^,\d/.test(rest)) throw new Error("write a decimal point");
  if (!rest || rest === unit) return Number(number);
  const given = rest.split("/");
  const wanted = unit.split("/");
  if (unit && given.length === wanted.length) {
    const powers = given.map((part, i) => power(part.trim(), wanted[i]));
    if (!powers.includes(null)) return Number(`${number}`) * 10 ** powers.reduce((sum, p, i) => sum + (i ? -p : p), 0);
  }
  return null;
}

/** The number, whoever has to be asked for it. */
export async function readQuantity(text, unit, app) {
  const value = parseQuantity(text, unit);
  if (value !== null) return tidy(value);
  return (await app.request("/quantity", { text, unit })).value;
}

const tidy = (value) => Number(value.toPrecision(15));

/** The power of ten, a multiple of three, with which a number is best shown. */
export function prefixPower(value, unit) {
  if (!value || !Number.isFinite(value) || !PREFIXED.test(unit)) return 0;
  const exponent = Number(Math.abs(value).toExponential(5).split("e")[1]);
  return Math.min(Math.max(3 * Math.floor(exponent / 3), -12), unit === "rad/s" ? 0 : 9); // 3303 rad/s
}

export const prefixed = (exponent, unit) => `${SHOWN[exponent]}${unit}`;

/** "320 nm" for 3.2e-7 m. */
export function formatQuantity(value, unit, digits = 4) {
  if (value === Infinity) return `∞ ${unit}`.trim();
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (Math.abs(value) < 1e-16 && PREFIXED.test(unit)) return `0 ${unit}`; // what arithmetic leaves of nothing
  const exponent = prefixPower(Number(value.toPrecision(digits)), unit);
  const number = Number((value / 10 ** exponent).toPrecision(digits));
  return `${number} ${prefixed(exponent, unit)}`.trim();
}

/** "130.9957 nm/V … 131.0053 nm/V": with so many digits that two tell the ends apart. */
export function formatInterval(low, high, unit) {
  if (high === null) return `above ${formatQuantity(low, unit)}`; // JSON knows no infinity
  const apart = Math.log10(Math.max(Math.abs(low), Math.abs(high)) / (high - low));
  const digits = Number.isFinite(apart) ? Math.min(Math.max(Math.floor(apart) + 3, 4), 12) : 4;
  return `${formatQuantity(low, unit, digits)} … ${formatQuantity(high, unit, digits)}`;
}

let count = 0;
const settles = new WeakMap(); // the input of a field -> what settles it

/**
 * For whatever acts on the fields within these places: waits until each has its answer, and throws where one is
 * refused, which is brought into view. What was done with it would be done with a number that nobody sees.
 */
export async function needAccepted(...places) {
  for (const input of places.flatMap((place) => [...place.querySelectorAll("input:enabled")])) {
    const refused = await settles.get(input)?.();
    if (!refused) continue;
    const tab = input.closest("[role=tabpanel][hidden]"), details = input.closest("details");
    if (tab) document.querySelector(`[aria-controls="${tab.id}"]`).click();
    if (details) details.open = true;
    input.focus();
    throw new Error(`${input.labels[0].textContent.replace(/^./, (first) => first.toUpperCase())}: ${refused}`);
  }
}

/**
 * A labelled field for a quantity. `change(value, text)` is called with SI and what was typed, and may refuse by
 * throwing or rejecting: the field then says why. The server checks again whatever it is told. `empty`: what an empty
 * field stands for, shown in it; its value is null then.
 */
export function makeQuantity({ label, unit = "", value, app, change, hint = "", empty = "" }) {
  const element = document.createElement("div");
  element.className = "field";
  const id = `quantity-${++count}`;
  const name = document.createElement("label");
  name.htmlFor = id;
  name.textContent = label;
  const input = document.createElement("input");
  Object.assign(input, { id, type: "text", autocomplete: "off", spellcheck: false, title: hint, placeholder: empty });
  const fault = document.createElement("span");
  Object.assign(fault, { id: `${id}-fault`, className: "fault" });
  fault.setAttribute("role", "alert");
  input.setAttribute("aria-describedby", fault.id);
  element.append(name, input, fault);

  let current = value;
  const holds = () => (current === null || current === undefined ? "" : formatQuantity(current, unit, 9));
  const show = () => (input.value = holds());
  const say = (text) => {
    fault.textContent = text;
    input.setAttribute("aria-invalid", text ? "true" : "false");
  };
  let asked = 0, told = 0, sent = null, answer = null;
  function commit() {
    const text = input.value.trim();
    if (text === sent) return answer; // Enter is told twice: as a key and as a change
    return (answer = take(text));
  }
  async function take(text) {
    const mine = ++asked, heard = told;
    sent = null;
    if (text === "" && (current === null || current === undefined)) return say("");
    sent = text;
    try {
      const read = text === "" && empty ? null : await readQuantity(text, unit, app);
      if (read !== current) await change(read, text);
      if (mine !== asked) return;
      if (told === heard) current = read; // else the page has said since what holds, which may be an undo
      say("");
      show();
    } catch (error) {
      if (mine === asked) say(error.message.replace(/^value = /, ""));
    } finally {
      if (mine === asked) sent = null;
    }
  }
  settles.set(input, async () => {
    if (input.value !== holds()) await commit();
    return fault.textContent;
  });
  function takeBack() {
    asked++;
    sent = null;
    say("");
    show();
  }
  input.addEventListener("change", commit);
  input.addEventListener("keydown", (event) => {
    if (event.key === "Enter") commit();
    // Undo takes back what was typed; with nothing typed it is the page's, which undoes what holds.
    if (!(event.ctrlKey || event.metaKey) || !["z", "y"].includes(event.key.toLowerCase())) return;
    event.preventDefault();
    if (input.value === holds()) return;
    event.stopPropagation();
    takeBack();
  });
  // A browser's own undo, from its menu, brings back a text that does not hold.
  input.addEventListener("input", (event) => {
    if (/^history/.test(event.inputType)) show();
  });
  show();
  return {
    element,
    input,
    /** Show another value, unless somebody is typing one. */
    set(next) {
      if (next === current) return;
      const typing = input.value !== holds() && (document.activeElement === input || input.getAttribute("aria-invalid") === "true");
      current = next;
      told++;
      if (!typing) show();
    },
    get: () => current,
    /** What was typed and does not hold is given up. */
    takeBack: () => input.value !== holds() && takeBack(),
    disable: (off) => (input.disabled = off),
  };
}
