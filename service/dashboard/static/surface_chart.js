// A cut through the response surface over two parameters: the surrogate's mean, and beside it how sure it is.

import { axis, dots, extent, headingOf, line, make, onDrag, pointer, root, round, scale, tell, text, ticks, titleOf, withUnit } from "./svg.js";
import { Z_90 } from "./curve_panels.js";
import { colourOf, VIRIDIS } from "./palette.js";
import { hideTip, showTip } from "./tooltip.js";

const LEFT = 58;
const TOP = 26;
const BOTTOM = 56;
const BAR = 62; // colour scale with its numbers
const GAP = 26;
const SIDE_BY_SIDE = 520;
const LEAST = 120;
const SEAM = 0.6; // cells overlap by as much, or rounding leaves hairs between them
// A plain dark-to-light scale.
const SURE = ["#f7fbff", "#deebf7", "#c6dbef", "#9ecae1", "#6baed6", "#4292c6", "#2171b5", "#08519c", "#08306b"];

/** Pieces of the line where values (rows along x, columns along y) cross a level: marching squares. */
export function contour(xs, ys, values, level) {
  const pieces = [];
  for (let i = 0; i + 1 < xs.length; i += 1) {
    for (let j = 0; j + 1 < ys.length; j += 1) {
      const corners = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]];
      const crossed = [];
      for (let k = 0; k < 4; k += 1) {
        const [[a, b], [c, d]] = [corners[k], corners[(k + 1) % 4]];
        const [from, to] = [values[a][b] - level, values[c][d] - level];
        if (from < 0 !== to < 0) {
          const share = from / (from - to);
          crossed.push([xs[a] + share * (xs[c] - xs[a]), ys[b] + share * (ys[d] - ys[b])]);
        }
      }
      for (let k = 0; k + 1 < crossed.length; k += 2) {
        pieces.push([crossed[k], crossed[k + 1]]);
      }
    }
  }
  return pieces;
}

/** Edges half-way between the places of a grid. */
function edges(places) {
  const middles = places.slice(1).map((place, k) => (place + places[k]) / 2);
  return [places[0], ...middles, places.at(-1)];
}

export class SurfaceChart {
  constructor(box, selection, chosenPair) {
    this.box = box;
    this.selection = selection;
    this.chosenPair = chosenPair;
  }

  get cut() {
    return this.selection.data.report?.pairs[this.chosenPair()];
  }

  get isEmpty() {
    return !this.cut;
  }

  draw() {
    const { cut, selection } = this;
    const wide = this.box.clientWidth;
    const across = wide >= SIDE_BY_SIDE ? 2 : 1;
    const cell = Math.max(LEAST, Math.min(340, wide / across - LEFT - BAR - (across - 1) * (GAP / 2)));
    // Beside each other the maps are narrow: they may be taller than wide.
    this.tall = across === 2 ? Math.max(cell, 410) : cell;
    const high = TOP + this.tall + BOTTOM;
    this.svg = root(Math.max(wide, LEFT + LEAST + BAR), across === 2 ? high : 2 * high, this.box.getAttribute("aria-label"));
    [this.first, this.second] = cut.names.map((name) => selection.columns.get(name));
    const half = cut.sds.map((row) => row.map((sd) => Z_90 * sd));
    const unit = selection.primary.unit;
    const places = across === 2 ? [[LEFT, TOP], [LEFT + cell + BAR + GAP + 30, TOP]] : [[LEFT, TOP], [LEFT, high + TOP]];
    this.panels = [
      this.drawPanel(cut.means, VIRIDIS, `mean ${selection.primary.text}, ${unit || "–"}`, places[0], cell),
      this.drawPanel(half, SURE, `90 % half-width, ${unit || "–"}`, places[1], cell),
    ];
    this.drawLevels(this.panels[0]);
    this.box.replaceChildren(this.svg);
    this.select();
  }

  drawPanel(values, stops, title, [left, top], cell) {
    const { cut, selection, tall } = this;
    const x = scale(extent(cut.axes[0]), [left, left + cell]);
    const y = scale(extent(cut.axes[1]), [top + tall, top]);
    const [low, high] = extent(values.flat()) ?? [0, 1];
    const [across, up] = [edges(cut.axes[0]).map(x), edges(cut.axes[1]).map(y)];
    const cells = make("g", { "aria-hidden": "true", "shape-rendering": "crispEdges" });
    values.forEach((row, i) =>
      row.forEach((value, j) => {
        const fill = colourOf(stops, (value - low) / (high - low || 1));
        cells.append(make("rect", { x: round(across[i]), y: round(up[j + 1]), width: round(across[i + 1] - across[i] + SEAM), height: round(up[j] - up[j + 1] + SEAM), fill }));
      }),
    );
    const panel = { x, y, left, top, cell, values };
    panel.brush = make("rect", { class: "brush on-map" });
    panel.dots = make("g", { "aria-hidden": "true" });
    panel.ring = make("g", { "aria-hidden": "true" });
    const optimum = cut.names.map((name) => selection.data.report.optimum[name]);
    const [ox, oy] = [round(x(optimum[0])), round(y(optimum[1]))];
    panel.marks = make("g", { "aria-hidden": "true" });
    this.svg.append(
      cells, panel.marks, panel.dots, panel.brush,
      make("path", { class: "optimum halo-line", d: `M${ox - 7} ${oy}h14M${ox} ${oy - 7}v14` }),
      make("path", { class: "optimum", d: `M${ox - 7} ${oy}h14M${ox} ${oy - 7}v14` }),
      panel.ring,
      text(left, top - 10, title, { class: "panel-title" }),
      axis(x, "bottom", top + tall + 2, { count: 4, title: titleOf(this.first) }),
      axis(y, "left", left - 2, { count: 4, title: titleOf(this.second), offset: 42 }),
      this.drawBar(stops, [low, high], left + cell + 12, top, tall),
    );
    const place = (column, at) => selection.values(column.name).map((value) => (value == null ? null : at(value)));
    Object.assign(panel, { xs: place(this.first, x), ys: place(this.second, y) });
    this.listen(panel);
    return panel;
  }

  drawBar(stops, [low, high], x, top, height) {
    const bar = make("g", { "aria-hidden": "true" });
    const parts = 40;
    for (let k = 0; k < parts; k += 1) {
      bar.append(make("rect", { x: round(x), width: 12, y: round(top + height - ((k + 1) * height) / parts), height: round(height / parts + 0.6), fill: colourOf(stops, (k + 0.5) / parts) }));
    }
    const at = scale([low, high], [top + height, top]);
    for (const value of high > low ? ticks(low, high, 5) : [low]) {
      bar.append(text(x + 16, at(value) + 4, tell(value), { class: "axis" }));
    }
    return bar;
  }

  /** Isolines of the mean; the edges of the accepted window are heavy. */
  drawLevels({ x, y, marks, values }) {
    const { axes } = this.cut;
    const [low, high] = extent(values.flat()) ?? [0, 1];
    const draw = (level, kind) => {
      const d = contour(axes[0], axes[1], values, level).map(([a, b]) => line([[x(a[0]), y(a[1])], [x(b[0]), y(b[1])]])).join("");
      return make("path", { class: kind, d });
    };
    marks.append(...ticks(low, high, 6).map((level) => draw(level, "level")));
    for (const level of this.selection.primary.window ?? []) {
      marks.append(draw(level, "level-window under"), draw(level, "level-window"));
    }
  }

  listen(panel) {
    const area = make("rect", { class: "brush-area", x: round(panel.left), y: panel.top, width: round(panel.cell), height: round(this.tall) });
    this.svg.append(area);
    const inside = (value, at) => at.value(Math.max(Math.min(at.start, at.end), Math.min(Math.max(at.start, at.end), value)));
    onDrag(this.svg, area, {
      move: (from, to) =>
        this.selection.limit(
          [this.first.name, [inside(from[0], panel.x), inside(to[0], panel.x)]],
          [this.second.name, [inside(from[1], panel.y), inside(to[1], panel.y)]],
        ),
      tap: () => this.selection.limit([this.first.name, null], [this.second.name, null]),
    });
    area.addEventListener("pointermove", (event) => showTip(event, this.valuesAt(panel, pointer(this.svg, event))));
    area.addEventListener("pointerleave", hideTip);
  }

  valuesAt(panel, [px, py]) {
    const { cut, selection } = this;
    const nearest = (axis_, value) => axis_.reduce((best, place, k) => (Math.abs(place - value) < Math.abs(axis_[best] - value) ? k : best), 0);
    const [i, j] = [nearest(cut.axes[0], panel.x.value(px)), nearest(cut.axes[1], panel.y.value(py))];
    const unit = selection.primary.unit;
    return [
      `${this.first.text} ${withUnit(cut.axes[0][i], this.first.unit)}`,
      `${this.second.text} ${withUnit(cut.axes[1][j], this.second.unit)}`,
      `${selection.primary.text} ${withUnit(cut.means[i][j], unit, 4)} ± ${withUnit(Z_90 * cut.sds[i][j], unit, 2)} (90 %)`,
    ];
  }

  select() {
    const { selection } = this;
    const split = [false, true].map((isChosen) => selection.chosen.flatMap((one, i) => (one === isChosen ? [i] : [])));
    for (const panel of this.panels) {
      const drawn = split.map((indices) => dots(panel.xs, panel.ys, indices));
      panel.dots.replaceChildren(
        make("path", { class: "dots on-map off", d: drawn[0] }),
        make("path", { class: "dots on-map edge", d: drawn[1] }),
        make("path", { class: "dots on-map on", d: drawn[1] }),
      );
      this.placeBrush(panel);
    }
    this.hover();
  }

  placeBrush({ brush, x, y, left, top, cell }) {
    const [a, b] = [this.first, this.second].map((column) => this.selection.limits.get(column.name));
    const clip = (value, from, size) => Math.max(from, Math.min(from + size, value));
    const [x0, x1] = a ? a.map((value) => clip(x(value), left, cell)) : [left, left + cell];
    const [y1, y0] = b ? b.map((value) => clip(y(value), top, this.tall)) : [top + this.tall, top];
    const at = { x: round(x0), y: round(y0), width: round(Math.max(0, x1 - x0)), height: round(Math.max(0, y1 - y0)), visibility: a || b ? "visible" : "hidden" };
    for (const [name, value] of Object.entries(at)) {
      brush.setAttribute(name, value);
    }
  }

  hover() {
    const i = this.selection.hovered;
    for (const { ring, xs, ys } of this.panels) {
      ring.replaceChildren(...(i !== null && xs[i] != null && ys[i] != null ? [make("circle", { class: "ring on-map", cx: round(xs[i]), cy: round(ys[i]), r: 7 })] : []));
    }
  }

  rows() {
    const { cut, selection } = this;
    const unit = selection.primary.unit || "–";
    return {
      header: [headingOf(this.first), headingOf(this.second), `mean of ${headingOf(selection.primary)}`, `standard deviation of the model, ${unit}`],
      rows: cut.axes[0].flatMap((a, i) => cut.axes[1].map((b, j) => [a, b, cut.means[i][j], cut.sds[i][j]])),
    };
  }
}
