// Elements in one line.

/** h("button", { type: "button", class: "small", onclick: act, "aria-label": "…" }, "text", child) */
export function h(tag, properties = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith("on")) made.addEventListener(name.slice(2), name === "onsubmit" ? oneAtATime(value) : value);
    else if (name === "class") made.className = value;
    else if (name in made && !name.startsWith("aria")) made[name] = value;
    else made.setAttribute(name, value === true ? "" : value);
  }
  made.append(...children.filter((child) => child !== null && child !== undefined));
  return made;
}

/** Enter pressed twice must not do a thing twice: what comes before the first is done is left. */
function oneAtATime(submit) {
  let busy = false;
  return async (event) => {
    event.preventDefault();
    if (busy) return;
    busy = true;
    try {
      await submit(event);
    } finally {
      busy = false;
    }
  };
}

/** A window in front of the page; `build(close)` gives its content. */
export function openDialog(title, build) {
  const dialog = h("dialog", { "aria-label": title });
  const close = () => dialog.close();
  dialog.append(h("h2", {}, title), build(close));
  dialog.addEventListener("close", () => dialog.remove());
  document.body.append(dialog);
  dialog.showModal();
  return dialog;
}
