// Every two of some columns against each other: a triangle of panels, on the diagonal how often each value occurs,
// opposite each panel how the two go together. The scatter matrix of designs and the posterior's corner plot.

import { axis, dots, extent, make, onDrag, pointer, root, round, scale, tell, text, titleOf, wrapped } from "./svg.js";
import { hideTip, showTip } from "./tooltip.js";

const LEFT = 64;
const BOTTOM = 58;
const GAP = 7;
const LEAST_CELL = 92;
const MOST_CELL = 150;
const REACH = 9;
export const BINS = 12;

/** Counts of values in equal parts of the axis (by pixels, so that a logarithmic one has even bars too). */
export function histogram(values, at, indices) {
  const counts = new Array(BINS).fill(0);
  for (const i of indices) {
    if (values[i] !== null && values[i] !== undefined) {
      const k = Math.floor(((at(values[i]) - at.start) / (at.end - at.start)) * BINS);
      counts[Math.max(0, Math.min(BINS - 1, k))] += 1;
    }
  }
  return counts;
}

/** Pearson's r of two columns; null with fewer than three pairs or without any spread. */
export function correlation(xs, ys, indices) {
  const pairs = indices.filter((i) => Number.isFinite(xs[i]) && Number.isFinite(ys[i]));
  if (pairs.length < 3) {
    return null;
  }
  const mean = (values) => pairs.reduce((sum, i) => sum + values[i], 0) / pairs.length;
  const [mx, my] = [mean(xs), mean(ys)];
  const sum = (f) => pairs.reduce((total, i) => total + f(i), 0);
  const [sxy, sxx, syy] = [sum((i) => (xs[i] - mx) * (ys[i] - my)), sum((i) => (xs[i] - mx) ** 2), sum((i) => (ys[i] - my) ** 2)];
  return sxx > 0 && syy > 0 ? sxy / Math.sqrt(sxx * syy) : null;
}

export class PairGrid {
  /** `source` says what the columns, points and groups are; see scatter_matrix.js and corner_chart.js. */
  constructor(box, selection, source) {
    this.box = box;
    this.selection = selection;
    this.source = source;
  }

  get isEmpty() {
    return this.source.count() === 0;
  }

  draw() {
    const columns = this.source.columns();
    const n = columns.length;
    const cell = Math.max(LEAST_CELL, Math.min(MOST_CELL, (this.box.clientWidth - LEFT - 10) / n - GAP));
    const [width, height] = [LEFT + n * (cell + GAP) + 10, 8 + n * (cell + GAP) + BOTTOM];
    this.svg = root(round(width), round(height), this.box.getAttribute("aria-label"));
    this.panels = [];
    this.diagonals = [];
    this.corners = [];
    this.columns = columns.map((column, k) => {
      const [domain, log] = [this.selection.domain(column.name), this.selection.isLog(column.name)];
      const [left, top] = [LEFT + k * (cell + GAP), 8 + k * (cell + GAP)];
      return { column, left, top, x: scale(domain, [left, left + cell], log), y: scale(domain, [top + cell, top], log), values: this.source.values(column.name) };
    });
    this.cell = cell;
    this.columns.forEach((row, j) => this.drawRow(row, j));
    this.ring = make("g", { class: "rings", "aria-hidden": "true" });
    this.svg.append(this.ring);
    this.box.replaceChildren(this.svg);
    this.select();
  }

  drawRow(row, j) {
    const isLast = j === this.columns.length - 1;
    for (let k = 0; k < j; k += 1) {
      this.drawPanel(this.columns[k], row);
      this.corners.push({ a: this.columns[k], b: row, label: this.svg.appendChild(text(row.left + this.cell / 2, this.columns[k].top + this.cell / 2 + 5, "", { class: "together", "text-anchor": "middle" })) });
    }
    this.drawDiagonal(row);
    const count = this.cell > 90 ? 3 : 2;
    if (j > 0) {
      const y = axis(row.y, "left", LEFT - 3, { count });
      const place = row.top + this.cell / 2;
      y.append(wrapped(11, place, titleOf(row.column), this.cell + 24, { class: "axis-title", "text-anchor": "middle", transform: `rotate(-90 11 ${round(place)})` }, 12));
      this.svg.append(y);
    }
    const under = this.columns.at(-1).top + this.cell + 3;
    this.svg.append(axis(row.x, "bottom", under, { count, title: titleOf(row.column) }));
    if (!isLast && j === 0) {
      this.svg.append(wrapped(11, row.top + this.cell / 2, "how often", this.cell, { class: "axis-title", "text-anchor": "middle", transform: `rotate(-90 11 ${round(row.top + this.cell / 2)})` }, 12));
    }
  }

  drawPanel(column, row) {
    const frame = make("rect", { class: "panel", x: round(column.left), y: round(row.top), width: round(this.cell), height: round(this.cell) });
    const panel = { column, row, frame, xs: column.values.map((v) => (v == null ? null : column.x(v))), ys: row.values.map((v) => (v == null ? null : row.y(v))) };
    panel.brush = make("rect", { class: "brush" });
    panel.dots = make("g", { "aria-hidden": "true" });
    this.svg.append(frame, ...this.windows(column, row), panel.brush, panel.dots);
    const area = make("rect", { class: "brush-area", x: round(column.left), y: round(row.top), width: round(this.cell), height: round(this.cell) });
    this.svg.append(area);
    onDrag(this.svg, area, {
      move: (from, to) => this.limit(column, row, from, to),
      tap: () => this.selection.limit([column.column.name, null], [row.column.name, null]),
    });
    area.addEventListener("pointermove", (event) => this.onMove(event, panel));
    area.addEventListener("pointerleave", () => this.onLeave());
    this.panels.push(panel);
  }

  /** The accepted window of a response, in every panel that shows it. */
  windows(column, row) {
    const made = [];
    if (row.column.window) {
      const [low, high] = row.column.window.map(row.y);
      made.push(make("rect", { class: "window", x: round(column.left), width: round(this.cell), y: round(high), height: round(low - high) }));
    }
    if (column.column.window) {
      const [low, high] = column.column.window.map(column.x);
      made.push(make("rect", { class: "window", x: round(low), width: round(high - low), y: round(row.top), height: round(this.cell) }));
    }
    return made;
  }

  limit(column, row, from, to) {
    const inside = (value, at) => Math.max(Math.min(at.start, at.end), Math.min(Math.max(at.start, at.end), value));
    const range = (k, at) => [from[k], to[k]].map((value) => at.value(inside(value, at)));
    this.selection.limit([column.column.name, range(0, column.x)], [row.column.name, range(1, row.y)]);
  }

  drawDiagonal(one) {
    const frame = make("rect", { class: "panel", x: round(one.left), y: round(one.top), width: round(this.cell), height: round(this.cell) });
    const bars = make("g", { "aria-hidden": "true" });
    this.svg.append(frame, bars);
    this.diagonals.push({ one, bars });
  }

  select() {
    const groups = this.source.groups();
    for (const panel of this.panels) {
      panel.dots.replaceChildren(...groups.map(([kind, indices]) => make("path", { class: `dots ${kind}`, d: dots(panel.xs, panel.ys, indices) })));
      this.placeBrush(panel);
    }
    const chosen = this.source.chosen();
    for (const { one, bars } of this.diagonals) {
      bars.replaceChildren(...this.bars(one, chosen));
    }
    for (const { a, b, label } of this.corners) {
      const r = this.source.together(a.column, b.column) ?? correlation(a.values, b.values, chosen);
      label.textContent = r === null ? "" : `${this.source.sign} ${r.toFixed(2).replace("-", "−")}`;
      label.setAttribute("font-size", r === null ? 12 : round(11 + 5 * Math.abs(r)));
    }
    this.hover();
  }

  bars(one, chosen) {
    const everything = this.source.everything();
    const all = histogram(one.values, one.x, everything);
    const most = Math.max(1, ...all);
    const width = this.cell / BINS;
    const draw = (counts, kind) =>
      make("path", {
        class: kind,
        d: counts.map((count, k) => (count === 0 ? "" : `M${round(one.left + k * width + 0.5)} ${round(one.top + this.cell)}v${round((-count / most) * (this.cell - 6))}h${round(width - 1)}V${round(one.top + this.cell)}z`)).join(""),
      });
    const made = [draw(all, "bars off"), draw(histogram(one.values, one.x, chosen), "bars on")];
    const interval = this.source.interval(one.column);
    if (interval) {
      const [low, high] = interval.map(one.x);
      made.push(make("path", { class: "interval", d: `M${round(low)} ${one.top + 5}H${round(high)}M${round(low)} ${one.top + 1}v8M${round(high)} ${one.top + 1}v8` }));
    }
    return made;
  }

  placeBrush({ column, row, brush }) {
    const limits = this.selection.limits;
    const [x, y] = [limits.get(column.column.name), limits.get(row.column.name)];
    const [left, right] = x ? x.map(column.x) : [column.left, column.left + this.cell];
    const [bottom, top] = y ? y.map(row.y) : [row.top + this.cell, row.top];
    const at = { x: left, y: top, width: Math.max(0, right - left), height: Math.max(0, bottom - top), visibility: x || y ? "visible" : "hidden" };
    for (const [name, value] of Object.entries(at)) {
      brush.setAttribute(name, typeof value === "number" ? round(value) : value);
    }
  }

  hover() {
    const i = this.source.hovered();
    const ringed = i === null ? [] : this.panels.filter((panel) => panel.xs[i] !== null && panel.ys[i] !== null);
    this.ring.replaceChildren(...ringed.map((panel) => make("circle", { class: "ring", cx: round(panel.xs[i]), cy: round(panel.ys[i]), r: 6 })));
  }

  onMove(event, panel) {
    const [x, y] = pointer(this.svg, event);
    let [best, distance] = [null, REACH];
    for (const i of this.source.everything()) {
      const own = panel.xs[i] === null || panel.ys[i] === null ? Infinity : Math.hypot(panel.xs[i] - x, panel.ys[i] - y);
      if (own < distance) {
        [best, distance] = [i, own];
      }
    }
    this.source.hover(best);
    if (best === null) {
      showTip(event, [`${panel.column.column.text} ${tell(panel.column.x.value(x))}`, `${panel.row.column.text} ${tell(panel.row.y.value(y))}`]);
    } else {
      showTip(event, this.source.tell(best));
    }
  }

  onLeave() {
    this.source.hover(null);
    hideTip();
  }

  rows() {
    return this.source.rows();
  }
}

export const all = (count) => Array.from({ length: count }, (_, i) => i);
export { extent };
