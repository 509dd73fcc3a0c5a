// What a plot shows, as SVG, PNG or CSV.

const WIDTH = 960, HEAD = 26, LEFT = 76, RIGHT = 18, LEAST = 150;

const escaped = (text) => String(text).replace(/[&<>"]/g, (one) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" })[one]);
const short = (number) => Number(number.toFixed(2));

/** Columns of series `one`: [x, y] where each has its own, else the shared x. */
const columnsOf = ({ xy, x, data }, one) => (xy ? [data[one.index]?.[0] ?? [], data[one.index]?.[1] ?? []] : [x, data[one.index] ?? []]);

/** `shown`: { strips, x, data, xy, time, css } of a plot. */
export function svgOf(shown) {
  const { strips, time, css } = shown;
  const heights = strips.map((strip) => Math.max(strip.plot.over.clientHeight, LEAST));
  const parts = [];
  let top = 8;
  strips.forEach((strip, i) => {
    const { x: xScale, y: yScale } = strip.plot.scales;
    const wide = WIDTH - LEFT - RIGHT, high = heights[i], y0 = top + HEAD;
    const place = (scale) => (scale.distr === 3 ? (value) => Math.log(value / scale.min) / Math.log(scale.max / scale.min) : (value) => (value - scale.min) / (scale.max - scale.min));
    const along = place(xScale), up = place(yScale);
    const px = (value) => short(LEFT + wide * along(value)), py = (value) => short(y0 + high * (1 - up(value)));
    const [xAxis, yAxis] = strip.plot.axes;
    const last = i === strips.length - 1;
    let legend = LEFT;
    for (const one of strip.members) {
      parts.push(`<line x1="${legend}" x2="${legend + 22}" y1="${top + 12}" y2="${top + 12}" stroke="${css(one.color)}" stroke-width="3" stroke-dasharray="${one.dash.join(" ")}"/><text x="${legend + 28}" y="${top + 16}">${escaped(one.label)}</text>`);
      legend += 44 + 7.2 * one.label.length;
    }
    parts.push(`<clipPath id="strip-${i}"><rect x="${LEFT}" y="${y0}" width="${wide}" height="${high}"/></clipPath>`);
    const inside = (scale) => (value) => value !== null && value >= scale.min && value <= scale.max;
    const labels = (axis) => (axis._splits ?? []).map((value, k) => [value, axis._values?.[k] ?? ""]);
    for (const [value] of labels(xAxis).filter(([one]) => inside(xScale)(one))) parts.push(`<line class="grid" x1="${px(value)}" x2="${px(value)}" y1="${y0}" y2="${y0 + high}"/>`);
    for (const [value, text] of labels(yAxis).filter(([one]) => inside(yScale)(one))) parts.push(`<line class="grid" x1="${LEFT}" x2="${LEFT + wide}" y1="${py(value)}" y2="${py(value)}"/><text class="axis" x="${LEFT - 8}" y="${py(value) + 4}" text-anchor="end">${escaped(text)}</text>`);
    if (last) for (const [value, text] of labels(xAxis).filter(([one]) => inside(xScale)(one))) parts.push(`<text class="axis" x="${px(value)}" y="${y0 + high + 18}" text-anchor="middle">${escaped(text)}</text>`);
    const title = (axis) => (typeof axis.label === "function" ? axis.label(strip.plot) : axis.label) ?? "";
    parts.push(`<text class="axis" transform="translate(18 ${y0 + high / 2}) rotate(-90)" text-anchor="middle">${escaped(title(yAxis))}</text>`);
    if (last) parts.push(`<text class="axis" x="${LEFT + wide / 2}" y="${y0 + high + 38}" text-anchor="middle">${escaped(title(xAxis))}</text>`);
    for (const one of strip.members) {
      const [xs, ys] = columnsOf(shown, one);
      let path = "", pen = false;
      for (let k = 0; k < xs.length; k++) {
        const y = ys[k];
        if (y === null || y === undefined) continue; // of another curve's time: the line goes on
        if (!Number.isFinite(y)) { pen = false; continue; }
        path += `${pen ? "L" : "M"}${px(xs[k])} ${py(y)}`;
        pen = true;
      }
      parts.push(`<path clip-path="url(#strip-${i})" d="${path}" fill="none" stroke="${css(one.color)}" stroke-width="${one.width ?? 2}" stroke-dasharray="${one.dash.join(" ")}" stroke-linejoin="round"/>`);
    }
    top = y0 + high + (last ? 46 : 8);
  });
  const style = `text{font:13px system-ui,sans-serif;fill:${css("--text")}}.axis{font-size:12px;fill:${css("--axis")}}.grid{stroke:${css("--grid")}}`;
  return `<svg xmlns="http://www.w3.org/2000/svg" width="${WIDTH}" height="${top}" viewBox="0 0 ${WIDTH} ${top}"><title>${escaped(time.label)}</title><style>${style}</style><rect width="100%" height="100%" fill="${css("--panel")}"/>${parts.join("")}</svg>`;
}

/** In SI, a column for each series, the rows in view. */
export function csvOf(shown) {
  const { xy, x, data, time, drawn, range: [from, to] } = shown;
  const quoted = (text) => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
  const head = (label, unit) => quoted(unit ? `${label} [${unit}]` : label);
  const cell = (value) => (value === null || value === undefined || !Number.isFinite(value) ? "" : String(value));
  if (!xy) {
    const rows = [...x.keys()].filter((k) => x[k] >= from && x[k] <= to).map((k) => [x[k], ...drawn.map((one) => data[one.index]?.[k])].map(cell).join(","));
    return [[head(time.label, time.unit), ...drawn.map((one) => head(one.label, one.unit))].join(","), ...rows].join("\r\n") + "\r\n";
  }
  const columns = drawn.flatMap((one) => columnsOf(shown, one));
  const count = Math.max(0, ...columns.map((one) => one.length));
  const rows = Array.from({ length: count }, (_, k) => columns.map((one) => cell(one[k])).join(","));
  return [drawn.flatMap((one) => [head(`${time.label} of ${one.label}`, time.unit), head(one.label, one.unit)]).join(","), ...rows].join("\r\n") + "\r\n";
}

function save(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

async function png(svg) {
  const image = new Image();
  image.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(svg)}`;
  await image.decode();
  const canvas = document.createElement("canvas");
  Object.assign(canvas, { width: 2 * image.width, height: 2 * image.height });
  canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
  return new Promise((done) => canvas.toBlob(done, "image/png"));
}

/** Three buttons in a bar, shown by a fourth; `shown()` gives what is drawn now. */
export function saveTools(bar, label, shown) {
  const name = label.toLowerCase().replace(/\W+/g, "-").replace(/^-|-$/g, "") || "plot";
  const kinds = {
    PNG: async () => png(svgOf(shown())),
    SVG: async () => new Blob([svgOf(shown())], { type: "image/svg+xml" }),
    CSV: async () => new Blob([csvOf(shown())], { type: "text/csv" }),
  };
  const made = (text, title, act) => Object.assign(document.createElement("button"), { type: "button", className: "small quiet", textContent: text, title, onclick: act });
  const buttons = Object.entries(kinds).map(([kind, make]) => {
    const button = made(kind, `Save what is shown as ${kind}`, async () => save(await make(), `${name}.${kind.toLowerCase()}`));
    button.hidden = true;
    return button;
  });
  const open = made("Save as…", "An image, or the numbers, of what is shown", () => {
    const on = open.getAttribute("aria-expanded") !== "true";
    open.setAttribute("aria-expanded", String(on));
    for (const one of buttons) one.hidden = !on;
  });
  open.setAttribute("aria-expanded", "false");
  bar.append(open, ...buttons);
}
