// What the page knows of the run: samples so far (least and greatest of each bucket), latest values, windows.

import { unpack } from "./stream.js";

export function makeLiveData(app) {
  const listeners = new Set();
  // `zero` is where the recording's clock begins, on that of the drive: the trigger less what is kept before it.
  const data = { header: null, x: new Float64Array(0), columns: [], filled: 0, latest: [], zero: 0 };
  const tell = (what) => listeners.forEach((act) => act(what));
  function clock(zero) {
    const { header, columns } = data;
    const per = header.bucket === 1 ? 1 : 2, step = header.interval * header.bucket, begin = header.begin - zero;
    data.zero = zero;
    data.x = Float64Array.from({ length: columns[0]?.length ?? 0 }, (_, i) =>
      begin + (per === 1 ? i * step : Math.floor(i / 2) * step + (i % 2 ? step - header.interval : 0)));
  }
  const offs = [
    app.stream.on("trace", (header) => {
      const per = header.bucket === 1 ? 1 : 2;
      const count = Math.floor(header.samples / header.bucket);
      data.header = header;
      data.columns = header.columns.map(() => new Float32Array(per * count));
      data.filled = 0;
      data.latest = [];
      clock(header.zero);
      tell("trace");
    }),
    app.stream.on("clock", ({ trace, zero }) => {
      if (trace !== data.header?.trace) return;
      clock(zero);
      tell("clock");
    }),
    app.stream.on("block", (header, arrays) => {
      if (header.trace !== data.header?.trace) return;
      const per = data.header.bucket === 1 ? 1 : 2;
      arrays.forEach((values, i) => data.columns[i].set(values, per * header.bucket));
      data.filled = per * header.bucket + (arrays[0]?.length ?? 0);
      data.latest = header.latest;
      tell("block");
    }),
    app.stream.on("latest", ({ trace, values }) => {
      if (trace !== data.header?.trace) return;
      data.latest = values;
      tell("latest");
    }),
  ];
  return {
    data,
    listen(act) { listeners.add(act); return () => listeners.delete(act); },
    /** [x, column of each name] as far as it goes. */
    whole(names) {
      return [data.x.subarray(0, data.filled), ...names.map((name) => {
        const i = data.header?.columns.findIndex((one) => one.name === name) ?? -1;
        return i < 0 ? [] : data.columns[i].subarray(0, data.filled);
      })];
    },
    latest(name) {
      const i = data.header?.columns.findIndex((one) => one.name === name) ?? -1;
      return i < 0 ? undefined : data.latest[i];
    },
    extent() {
      const { header, zero } = data;
      return header && [header.begin - zero, header.begin - zero + header.samples * header.interval];
    },
    /** Full resolution, or as much as there are points: [x, column of each name] in a window. */
    async window(names, [begin, end], points) {
      const { header, zero } = data;
      const { header: got, arrays } = unpack(await app.request("/bench/window", { trace: header.trace, begin: begin + zero, end: end + zero, points }));
      const x = Float64Array.from(arrays[0], (t) => got.from - zero + t);
      return [x, ...names.map((name) => arrays[1 + header.columns.findIndex((one) => one.name === name)] ?? [])];
    },
    destroy() { offs.forEach((off) => off()); },
  };
}

/** A recording of the folder, or a window of it. */
export async function showRecording(app, name, view, points) {
  const [begin, end] = view ?? [null, null];
  const { header, arrays } = unpack(await app.request("/recordings/show", { name, begin, end, points }));
  return { header, x: Float64Array.from(arrays[0], (t) => header.from + t), columns: arrays.slice(1) };
}

/** "walk 11-21 17:39:09" for a recording of the bench; others by their folder and name. */
export const shortName = (name) => {
  const parts = name.replace(/\.nc$/, "").split("/").filter((part) => part !== "unfinished");
  const stamp = /^\d{4}-(\d\d-\d\d)_(\d\d)(\d\d)(\d\d)/.exec(parts.at(-2) ?? "");
  return stamp ? `${parts.at(-1)} ${stamp[1]} ${stamp[2]}:${stamp[3]}:${stamp[4]}` : parts.slice(-2).join("/");
};
/** The same; other files by their whole name. */
export const calledShortly = (name) => (/\d{4}-\d\d-\d\d_\d{6}/.test(name) ? shortName(name) : name);
