// A picked grain in words.

import { kindsOf } from "./scene_colours.js";
import { withUnit } from "./svg.js";

/** Pairs of a description list: what is stored of a grain of `frame`. */
export function describeGrain(grain, frame, materials) {
  const kind = kindsOf(frame, materials).find(({ row }) => row === (grain.material ?? frame.materials[grain.row]));
  const arrival = frame.columns.get("arrival");
  const level = arrival?.levels[grain.row];
  const places = { 0: "on the belt", 1: "in flight", 2: "in the hopper", 3: "lost" };
  const rows = [
    ["grain", grain.number ?? `${grain.row} (row of the file; this run does not number its grains)`],
    ["material", kind?.name],
    ["diameter", withUnit(grain.diameter_mm, "mm", 4)],
    ["position x, y, z", `${["x_m", "y_m", "z_m"].map((name) => grain[name].toFixed(4).replace("-", "−")).join(", ")}\u202fm`],
    ["speed", grain.speed_m_s === undefined ? "not stored" : withUnit(grain.speed_m_s, "m/s")],
    ["place", places[grain.place]],
    ["arrived", arrival && level < 255 ? `${withUnit(arrival.range[0] + (level / 254) * (arrival.range[1] - arrival.range[0]), "s", 4)} or up to a frame before` : undefined],
  ];
  return rows.filter(([, value]) => value !== undefined).map(([name, value]) => {
    const pair = document.createElement("div");
    pair.append(Object.assign(document.createElement("dt"), { textContent: name }), Object.assign(document.createElement("dd"), { textContent: value, className: "nums" }));
    return pair;
  });
}
