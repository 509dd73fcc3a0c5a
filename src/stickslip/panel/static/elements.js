// Small makers of elements, for pages.

/** An element with properties and children. */
export function make(tag, properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}

/** A button; its `title` says more than its text. */
export function button(text, title, act, className = "small") {
  const made = make("button", { type: "button", textContent: text, title, className });
  if (title && text.length < 2) made.setAttribute("aria-label", title);
  made.addEventListener("click", act);
  return made;
}

/** A dialog with a heading, gone when it is closed. */
export function showDialog(heading, ...content) {
  const head = make("h2", { textContent: heading, id: "dialog-heading" });
  const dialog = make("dialog", { className: "card" }, head, ...content);
  dialog.setAttribute("aria-labelledby", head.id);
  dialog.append(button("Close", "", () => dialog.close()));
  dialog.addEventListener("close", () => dialog.remove());
  document.body.append(dialog);
  dialog.showModal();
  return dialog;
}

/** Wait until a page's own style sheet is there. */
export function styled(name) {
  const href = new URL(name, import.meta.url).href;
  if ([...document.styleSheets].some((sheet) => sheet.href === href)) return Promise.resolve();
  const link = make("link", { rel: "stylesheet", href });
  document.head.append(link);
  return new Promise((done) => { link.onload = link.onerror = done; });
}
