// What the analysis' charts are drawn with: elements, scales, ticks, axes and dots, in SVG and without a library.
//
// A chart is one <svg>; its colours are classes of analysis.css, so that light, dark and print need no redrawing.

const SVG = "http://www.w3.org/2000/svg";

export function make(name, attributes = {}, ...children) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) {
    if (value !== null && value !== undefined) {
      element.setAttribute(key, value);
    }
  }
  element.append(...children);
  return element;
}

export const text = (x, y, words, attributes = {}) => make("text", { x: round(x), y: round(y), ...attributes }, words);

export const round = (value) => Math.round(value * 10) / 10;

/** A chart's root; `label` is what a screen reader says of it. */
export function root(width, height, label) {
  return make("svg", { viewBox: `0 0 ${width} ${height}`, width, height, role: "group", "aria-label": label });
}

/** From data to pixels and back. `log` only where both ends are above zero. */
export function scale([low, high], [start, end], log = false) {
  const [a, b] = log ? [Math.log(low), Math.log(high)] : [low, high];
  const span = b - a || 1;
  const at = (value) => start + (((log ? Math.log(value) : value) - a) / span) * (end - start);
  const value = (pixel) => {
    const found = a + ((pixel - start) / (end - start)) * span;
    return log ? Math.exp(found) : found;
  };
  return Object.assign(at, { value, low, high, start, end, log });
}

/** Round numbers inside [low, high], about `count` of them. */
export function ticks(low, high, count = 5, log = false) {
  if (log) {
    const found = [];
    for (let decade = Math.floor(Math.log10(low)); decade <= Math.log10(high); decade += 1) {
      for (const digit of [1, 2, 5]) {
        const value = digit * 10 ** decade;
        if (value >= low * (1 - 1e-9) && value <= high * (1 + 1e-9)) {
          found.push(value);
        }
      }
    }
    if (found.length >= 2) {
      return found;
    }
  }
  const raw = (high - low) / Math.max(1, count) || 1;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = power * ([1, 2, 5].find((digit) => digit * power >= raw * 0.75) ?? 10);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k += 1) {
    found.push(Number((k * step).toPrecision(12)));
  }
  return found;
}

/** A number as a person reads it: four digits, thin spaces in thousands, powers of ten beyond a million. */
export function tell(value, digits = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) {
    return "–";
  }
  if (value !== 0 && (Math.abs(value) >= 1e5 || Math.abs(value) < 1e-3)) {
    const [front, power] = value.toExponential(digits - 1).split("e");
    return `${Number(front)}·10${[...String(Number(power))].map((c) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(c)]).join("")}`;
  }
  return String(Number(value.toPrecision(Math.max(digits, Math.floor(Math.log10(Math.abs(value) || 1)) + 1)))).replace("-", "−");
}

export const withUnit = (value, unit, digits = 3) =>
  tell(value, digits) + (unit && value !== null && value !== undefined ? (unit === "°" ? unit : `\u202f${unit}`) : "");

/** "repose angle, °": an axis' title. Ratios have no unit and say so. */
export const titleOf = (column) => `${column.text},\u00a0${column.unit || "–"}`;

/** The same as the head of a column in a file: plain spaces. */
export const headingOf = (column) => (column.unit ? `${column.text}, ${column.unit}` : column.text);

/** A line under or beside a panel with ticks; `side` is bottom or left. */
export function axis(at, side, place, options = {}) {
  const group = make("g", { class: "axis", "aria-hidden": "true" });
  const isBottom = side === "bottom";
  group.append(
    isBottom
      ? make("path", { class: "axis-line", d: `M${round(at.start)} ${place}H${round(at.end)}` })
      : make("path", { class: "axis-line", d: `M${place} ${round(at.start)}V${round(at.end)}` }),
  );
  for (const value of options.ticks ?? ticks(at.low, at.high, options.count ?? 5, at.log)) {
    const p = round(at(value));
    group.append(make("path", { class: "axis-line", d: isBottom ? `M${p} ${place}v4` : `M${place} ${p}h-4` }));
    if (options.grid) {
      group.append(make("path", { class: "grid-line", d: isBottom ? `M${p} ${place}V${options.grid}` : `M${place} ${p}H${options.grid}` }));
    }
    if (options.labels !== false) {
      group.append(isBottom ? text(p, place + 15, tell(value), { "text-anchor": "middle" }) : text(place - 6, p + 4, tell(value), { "text-anchor": "end" }));
    }
  }
  if (options.title) {
    group.append(axisTitle(at, isBottom, place, options));
  }
  return group;
}

function axisTitle(at, isBottom, place, options) {
  const middle = round((at.start + at.end) / 2);
  if (isBottom) {
    return wrapped(middle, place + 31, options.title, Math.abs(at.end - at.start) + 14, { class: "axis-title", "text-anchor": "middle" });
  }
  const x = place - (options.offset ?? 38);
  return text(x, middle, options.title, { class: "axis-title", "text-anchor": "middle", transform: `rotate(-90 ${round(x)} ${middle})` });
}

/** Words over as many lines as the width takes. */
export function wrapped(x, y, words, width, attributes = {}, lineHeight = 14) {
  const longest = Math.max(6, Math.floor(width / 6.4));
  const lines = [""];
  for (const word of words.split(/(?<=[ –])/)) {
    if ((lines.at(-1) + word).trim().length > longest && lines.at(-1) !== "") {
      lines.push("");
    }
    lines[lines.length - 1] += word;
  }
  const spans = lines.map((line, k) => make("tspan", { x: round(x), dy: k === 0 ? 0 : lineHeight }, line.trim()));
  return make("text", { x: round(x), y: round(y), ...attributes }, ...spans);
}

/** Many dots as one path: lines of no length with round ends. Five hundred of them cost as much as one circle. */
export function dots(xs, ys, indices) {
  let d = "";
  for (const i of indices) {
    if (xs[i] !== null && ys[i] !== null) {
      d += `M${round(xs[i])} ${round(ys[i])}h0`;
    }
  }
  return d;
}

export function line(points) {
  return points.map(([x, y], k) => `${k === 0 ? "M" : "L"}${round(x)} ${round(y)}`).join("");
}

/** Least and greatest of the finite ones; null where there is none. */
export function extent(values) {
  let [low, high] = [Infinity, -Infinity];
  for (const value of values) {
    if (Number.isFinite(value)) {
      low = Math.min(low, value);
      high = Math.max(high, value);
    }
  }
  return low <= high ? [low, high] : null;
}

/** Where on the chart the pointer is, in its own units. */
export function pointer(svg, event) {
  const box = svg.getBoundingClientRect();
  const [width, height] = [svg.viewBox.baseVal.width, svg.viewBox.baseVal.height];
  return [((event.clientX - box.left) / box.width) * width, ((event.clientY - box.top) / box.height) * height];
}

/** Calls `move(from, to, isOver)` with the pointer's places while it drags over `area`; `tap` when it did not move. */
export function onDrag(svg, area, { start, move, tap }) {
  area.addEventListener("pointerdown", (down) => {
    if (down.button !== 0) {
      return;
    }
    down.preventDefault();
    area.setPointerCapture(down.pointerId);
    const from = pointer(svg, down);
    let moved = false;
    start?.(from);
    const follow = (event) => {
      const to = pointer(svg, event);
      moved ||= Math.hypot(to[0] - from[0], to[1] - from[1]) > 3;
      if (moved) {
        move(from, to);
      }
    };
    const end = () => {
      area.removeEventListener("pointermove", follow);
      if (!moved) {
        tap?.(from);
      }
    };
    area.addEventListener("pointermove", follow);
    area.addEventListener("pointerup", end, { once: true });
    area.addEventListener("pointercancel", end, { once: true });
  });
}
