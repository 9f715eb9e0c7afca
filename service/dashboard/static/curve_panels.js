// A response along each parameter: the surrogate's mean with its 90 % band, and the designs behind it.

import { axis, dots, extent, headingOf, line, make, onDrag, pointer, root, round, scale, text, titleOf, withUnit } from "./svg.js";
import { hideTip, showTip } from "./tooltip.js";

const LEFT = 56;
const TOP = 24;
const PANEL = 190;
const BOTTOM = 56;
const GAP = 22;
const LEAST_WIDTH = 150;
// Half-width of a normal 90 % interval in standard deviations.
export const Z_90 = 1.6448536269514722;
const VERDICTS = ["unfeasible", "feasible"];

export class CurvePanels {
  /** `source.curves()`: {response, curves: [{name, values, means, sds, told}]} or null. */
  constructor(box, selection, source) {
    this.box = box;
    this.selection = selection;
    this.source = source;
  }

  get isEmpty() {
    return !this.source.curves()?.curves.length;
  }

  draw() {
    const { response, curves } = this.source.curves();
    const wide = Math.max(this.box.clientWidth, LEFT + LEAST_WIDTH + GAP);
    const each = Math.max(1, Math.min(curves.length, Math.floor((wide - LEFT) / (LEAST_WIDTH + GAP))));
    const cell = (wide - LEFT - 8) / each - GAP;
    const lines = Math.ceil(curves.length / each);
    this.response = response;
    this.svg = root(wide, lines * (TOP + PANEL + BOTTOM), this.box.getAttribute("aria-label"));
    const domain = this.heights(response, curves);
    this.panels = curves.map((curve, k) => {
      const [left, top] = [LEFT + (k % each) * (cell + GAP), Math.floor(k / each) * (TOP + PANEL + BOTTOM) + TOP];
      return this.drawPanel(curve, { left, top, cell, y: scale(domain, [top + PANEL, top], this.selection.isLog(response.name)), isFirst: k % each === 0 });
    });
    this.box.replaceChildren(this.svg);
    this.select();
  }

  /** One height for all panels, so that they can be compared: everything drawn, the window with it. */
  heights(response, curves) {
    const drawn = curves.flatMap(({ means, sds }) => means.flatMap((mean, i) => [mean - Z_90 * sds[i], mean + Z_90 * sds[i]]));
    const positive = this.selection.isLog(response.name) ? (value) => value > 0 : () => true;
    const [low, high] = extent([...drawn, ...this.selection.values(response.name), ...(response.window ?? [])].filter(positive)) ?? [0, 1];
    const room = 0.04 * (high - low) || 1;
    return this.selection.isLog(response.name) ? [low, high] : [low - room, high + room];
  }

  drawPanel(curve, { left, top, cell, y, isFirst }) {
    const { selection, response } = this;
    const column = selection.columns.get(curve.name);
    const x = scale(selection.domain(curve.name), [left, left + cell], selection.isLog(curve.name));
    const frame = make("rect", { class: "panel", x: round(left), y: top, width: round(cell), height: PANEL });
    this.svg.append(frame);
    if (response.window) {
      const [low, high] = response.window.map(y);
      this.svg.append(make("rect", { class: "window", x: round(left), width: round(cell), y: round(high), height: round(low - high) }));
      this.svg.append(make("path", { class: "target", d: `M${round(left)} ${round(y(response.target))}H${round(left + cell)}` }));
    }
    const brush = make("rect", { class: "brush", y: top, height: PANEL });
    const under = make("g", { "aria-hidden": "true" });
    const clip = (value) => Math.max(top, Math.min(top + PANEL, value));
    const points = (k) => curve.values.map((value, i) => [x(value), clip(y(Math.max(curve.means[i] + k * Z_90 * curve.sds[i], y.log ? y.low : -Infinity)))]);
    const ring = make("g", { "aria-hidden": "true" });
    this.svg.append(
      brush, under,
      make("path", { class: "band", d: `${line([...points(1), ...points(-1).reverse()])}Z` }),
      make("path", { class: "curve", d: line(points(0)) }),
      ring,
      text(left, top - 8, curve.told, { class: "panel-title" }),
      axis(x, "bottom", top + PANEL + 2, { count: 4, title: titleOf(column) }),
    );
    if (isFirst) {
      this.svg.append(axis(y, "left", left - 3, { count: 5, title: titleOf(response), offset: 40 }));
    }
    const place = (name, at) => selection.values(name).map((value) => (value == null ? null : at(value)));
    const panel = { curve, column, x, y, brush, under, ring, left, top, cell, xs: place(curve.name, x), ys: place(response.name, y) };
    this.listen(panel);
    return panel;
  }

  listen(panel) {
    const area = make("rect", { class: "brush-area", x: round(panel.left), y: panel.top, width: round(panel.cell), height: PANEL });
    this.svg.append(area);
    const inside = (value) => panel.x.value(Math.max(panel.left, Math.min(panel.left + panel.cell, value)));
    onDrag(this.svg, area, {
      move: ([from], [to]) => this.selection.limit([panel.curve.name, [inside(from), inside(to)]]),
      tap: () => this.selection.limit([panel.curve.name, null]),
    });
    area.addEventListener("pointermove", (event) => showTip(event, this.valuesAt(panel, panel.x.value(pointer(this.svg, event)[0]))));
    area.addEventListener("pointerleave", hideTip);
  }

  valuesAt({ curve, column }, value) {
    const { values, means, sds } = curve;
    let k = values.findIndex((known) => known >= value);
    k = k === -1 ? values.length - 1 : k > 0 && value - values[k - 1] < values[k] - value ? k - 1 : k;
    const unit = this.response.unit;
    return [
      `${column.text} ${withUnit(values[k], column.unit)}`,
      `${this.response.text} ${withUnit(means[k], unit, 4)} ± ${withUnit(Z_90 * sds[k], unit, 2)} (90 %)`,
      curve.told,
    ];
  }

  select() {
    for (const panel of this.panels) {
      const draw = (verdict, isChosen) =>
        make("path", { class: `dots small v-${verdict} ${isChosen ? "on" : "off"}`, d: dots(panel.xs, panel.ys, this.selection.indices(verdict, isChosen)) });
      panel.under.replaceChildren(...VERDICTS.map((v) => draw(v, false)), ...VERDICTS.map((v) => draw(v, true)));
      const range = this.selection.limits.get(panel.curve.name);
      const [low, high] = range ? range.map(panel.x) : [0, 0];
      panel.brush.setAttribute("visibility", range ? "visible" : "hidden");
      panel.brush.setAttribute("x", round(low));
      panel.brush.setAttribute("width", round(high - low));
    }
    this.hover();
  }

  hover() {
    const i = this.selection.hovered;
    for (const { ring, xs, ys } of this.panels) {
      const isSeen = i !== null && xs[i] !== null && ys[i] !== null;
      ring.replaceChildren(...(isSeen ? [make("circle", { class: "ring", cx: round(xs[i]), cy: round(ys[i]), r: 6 })] : []));
    }
  }

  rows() {
    const { response, curves } = this.source.curves();
    return {
      header: ["parameter", "value", `mean of ${headingOf(response)}`, `standard deviation of the model, ${response.unit || "–"}`],
      rows: curves.flatMap(({ name, values, means, sds }) => values.map((value, i) => [name, value, means[i], sds[i]])),
    };
  }
}

/** Main effects of one response. */
export function effectCurves(selection, chosenResponse) {
  const share = (effect) => {
    if (effect.total_share === null) {
      return "";
    }
    const errors = [effect.total_share_error, effect.total_share_emulator_error].filter(Number.isFinite);
    const error = errors.length ? ` ± ${(100 * Math.hypot(...errors)).toFixed(0)}` : "";
    return `${(100 * effect.total_share).toFixed(0)}${error} % of the variance`;
  };
  return {
    curves: () => {
      const found = selection.data.report?.effects[chosenResponse()];
      const curves = (found ?? []).filter((effect) => selection.columns.has(effect.name)).map((effect) => ({ ...effect, told: share(effect) }));
      return { response: selection.columns.get(chosenResponse()), curves };
    },
  };
}

/** Slices of the primary response through the optimum. */
export function sliceCurves(selection) {
  return {
    curves: () => {
      const report = selection.data.report;
      const curves = (report?.along ?? []).filter((cut) => selection.columns.has(cut.names[0])).map((cut) => {
        const [name] = cut.names;
        const column = selection.columns.get(name);
        return { name, values: cut.axes[0], means: cut.means, sds: cut.sds, told: `optimum at ${withUnit(report.optimum[name], column.unit)}` };
      });
      return { response: selection.primary, curves };
    },
  };
}
