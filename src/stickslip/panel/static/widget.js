// The panel's plot in a notebook: what anywidget calls to show a PlotWidget.

import { makePlot } from "./plot.js";
import { unpack } from "./stream.js";

function render({ model, el }) {
  // The notebook's own theme, as far as it can be told: by the colour of its text.
  const [red, green, blue] = getComputedStyle(el).color.match(/[\d.]+/g).map(Number);
  el.dataset.theme = red + green + blue > 384 ? "dark" : "light";
  el.classList.add("stickslip-plot");
  el.style.height = `${model.get("height")}px`;
  const { header, arrays } = unpack(bytesOf(model.get("frame")));
  const time = header.start ? { label: `time since ${Number(header.start.toPrecision(6))} s`, unit: "s" } : { label: "time", unit: "s" };
  const plot = makePlot(el, { series: model.get("series"), time, label: "Recording" });
  plot.setData(arrays);
  return () => plot.destroy();
}

/** An ArrayBuffer of its own, aligned. */
function bytesOf(view) {
  return view.buffer.slice(view.byteOffset ?? 0, (view.byteOffset ?? 0) + view.byteLength);
}

export default { render };
