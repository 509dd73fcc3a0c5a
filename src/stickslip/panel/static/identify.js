// The page is still to come.

export function mount(element, app) {
  const title = document.createElement("h1");
  title.textContent = "Identify";
  element.append(title);
  return () => {};
}
