// Parallel coordinates: a line a design, an axis a number, limits on as many axes as one likes, by pointer or keys.

import { line, make, onDrag, pointer, root, round, scale, tell, text, ticks, titleOf, withUnit, wrapped } from "./svg.js";
import { hideTip, showTip } from "./tooltip.js";

const TOP = 62;
const HEIGHT = 380;
const NONE = 22; // below the axis: where the lines of designs without a value go
const LEAST_SPACE = 92;
const SIDE = 62;
const REACH = 9;
const HANDLE = 7;
const STEPS = 50; // an arrow key moves a limit by this part of its axis
const VERDICTS = ["unfeasible", "feasible", "error"];

export class ParallelChart {
  constructor(box, selection, tell_) {
    this.box = box;
    this.selection = selection;
    this.tellOf = tell_;
    this.held = null;
  }

  get isEmpty() {
    return this.selection.count === 0;
  }

  draw() {
    const { selection } = this;
    const columns = selection.shownColumns;
    const width = Math.max(this.box.clientWidth, 2 * SIDE + (columns.length - 1) * LEAST_SPACE);
    const bottom = HEIGHT - NONE - 24;
    this.svg = root(width, HEIGHT, this.box.getAttribute("aria-label"));
    this.axes = columns.map((column, k) => ({
      column,
      x: columns.length === 1 ? width / 2 : SIDE + (k * (width - 2 * SIDE)) / (columns.length - 1),
      at: scale(selection.domain(column.name), [bottom, TOP], selection.isLog(column.name)),
    }));
    this.space = columns.length > 1 ? (width - 2 * SIDE) / (columns.length - 1) : width;
    this.places = this.findPlaces(bottom + NONE);
    this.lines = make("g", { "aria-hidden": "true" });
    this.hoverLine = make("path", { class: "hover-line", d: "" });
    this.svg.append(this.lines, this.hoverLine);
    this.drawNone(width, bottom);
    for (const one of this.axes) {
      this.drawAxis(one);
    }
    this.svg.addEventListener("pointermove", (event) => this.onMove(event));
    this.svg.addEventListener("pointerleave", () => this.onLeave());
    this.box.replaceChildren(this.svg);
    this.select();
    this.focusHeld();
  }

  /** y of each design on each axis. */
  findPlaces(none) {
    return this.axes.map(({ column, at }) => {
      const values = this.selection.values(column.name);
      return this.selection.data.designs.number.map((_, i) => (values[i] == null ? none : at(values[i])));
    });
  }

  drawNone(width, bottom) {
    const misses = this.axes.some(({ column }) => this.selection.data.designs.number.some((_, i) => this.selection.values(column.name)[i] == null));
    if (misses) {
      this.svg.append(
        make("path", { class: "none-line", d: `M${SIDE - 12} ${bottom + NONE}H${width - SIDE + 12}` }),
        text(4, bottom + NONE + 4, "none", { class: "axis" }),
      );
    }
  }

  drawAxis(one) {
    const { column, x, at } = one;
    const group = make("g", { class: "axis" });
    if (column.window) {
      group.append(make("rect", { class: "window", x: round(x - 4), width: 8, y: round(at(column.window[1])), height: round(at(column.window[0]) - at(column.window[1])) }));
      group.append(make("path", { class: "target", d: `M${round(x - 9)} ${round(at(column.target))}h18` }));
    }
    group.append(make("path", { class: "axis-line", d: `M${round(x)} ${at.start}V${at.end}` }));
    for (const value of ticks(at.low, at.high, 5, at.log)) {
      group.append(make("path", { class: "axis-line", d: `M${round(x)} ${round(at(value))}h-4` }), text(x - 7, at(value) + 4, tell(value), { "text-anchor": "end", class: "halo" }));
    }
    group.append(wrapped(x, 14, titleOf(column), Math.min(this.space, 2 * SIDE) - 6, { class: "axis-title", "text-anchor": "middle" }, 13));
    one.brush = make("rect", { class: "brush", x: round(x - 10), width: 20 });
    const area = make("rect", { class: "brush-area", x: round(x - 13), y: at.end - 6, width: 26, height: at.start - at.end + 12 });
    this.svg.append(group, one.brush, area);
    this.brushWith(one, area);
    one.handles = [0, 1].map((end) => this.drawHandle(one, end));
    if (this.selection.canBeLog(column.name)) {
      this.svg.append(this.drawKind(one));
    }
  }

  drawKind({ column, x, at }) {
    const isLog = this.selection.isLog(column.name);
    const button = make(
      "g", { class: "axis-kind", role: "button", tabindex: 0, "aria-pressed": isLog, "aria-label": `logarithmic axis of ${column.text}`, "data-log": column.name },
      make("rect", { x: round(x - 15), y: at.start + NONE + 5, width: 30, height: 17, rx: 8 }),
      text(x, at.start + NONE + 17, isLog ? "log" : "lin", { "text-anchor": "middle" }),
    );
    const toggle = () => {
      this.held = `[data-log="${CSS.escape(column.name)}"]`;
      this.selection.toggleLog(column.name);
    };
    button.addEventListener("click", toggle);
    button.addEventListener("keydown", (event) => {
      if (event.key === "Enter" || event.key === " ") {
        event.preventDefault();
        toggle();
      }
    });
    return button;
  }

  /** A new drawing is made of new elements: the one that had the focus gets it back. */
  focusHeld() {
    if (this.held !== null) {
      this.svg.querySelector(this.held)?.focus({ preventScroll: true });
      this.held = null;
    }
  }

  drawHandle(one, end) {
    const { column, x, at } = one;
    const handle = make(
      "g", { class: "handle", role: "slider", tabindex: 0, "aria-orientation": "vertical", "aria-label": `${end === 0 ? "lower" : "upper"} limit of ${column.text}` },
      make("path", { d: end === 0 ? `M${round(x - 9)} 0h18l-4 ${HANDLE}h-10z` : `M${round(x - 9)} 0h18l-4 -${HANDLE}h-10z` }),
    );
    handle.addEventListener("keydown", (event) => this.onKey(event, one, end));
    onDrag(this.svg, handle, { move: (_, to) => this.moveEnd(one, end, at.value(Math.max(at.end, Math.min(at.start, to[1])))) });
    this.svg.append(handle);
    return handle;
  }

  range({ column, at }) {
    return this.selection.limits.get(column.name) ?? [at.low, at.high];
  }

  moveEnd(one, end, value) {
    const range = [...this.range(one)];
    range[end] = end === 0 ? Math.min(value, range[1]) : Math.max(value, range[0]);
    this.selection.limit([one.column.name, range]);
  }

  onKey(event, one, end) {
    const { at, column } = one;
    const step = ((at.start - at.end) / STEPS) * (event.shiftKey || event.key.startsWith("Page") ? 5 : 1);
    const moves = { ArrowUp: -step, ArrowRight: -step, PageUp: -step, ArrowDown: step, ArrowLeft: step, PageDown: step };
    if (event.key in moves) {
      const place = at(this.range(one)[end]) + moves[event.key];
      this.moveEnd(one, end, at.value(Math.max(at.end, Math.min(at.start, place))));
    } else if (event.key === "Home" || event.key === "End") {
      this.moveEnd(one, end, event.key === "Home" ? at.low : at.high);
    } else if (event.key === "Escape" || event.key === "Delete") {
      this.selection.limit([column.name, null]);
    } else {
      return;
    }
    event.preventDefault();
  }

  /** A drag on an axis sets its limits, one inside them moves them, a click takes them away. */
  brushWith(one, area) {
    const { at, column } = one;
    const inside = (y) => Math.max(at.end, Math.min(at.start, y));
    let held = null;
    onDrag(this.svg, area, {
      start: ([, y]) => {
        const range = this.selection.limits.get(column.name);
        held = range && y < at(range[0]) - 2 && y > at(range[1]) + 2 ? range.map(at) : null;
      },
      move: ([, from], [, to]) => {
        if (held === null) {
          this.selection.limit([column.name, [at.value(inside(from)), at.value(inside(to))]]);
          return;
        }
        const shift = Math.max(at.end - held[1], Math.min(at.start - held[0], to - from));
        this.selection.limit([column.name, held.map((y) => at.value(y + shift))]);
      },
      tap: () => this.selection.limit([column.name, null]),
    });
  }

  pathOf(i) {
    return line(this.axes.map(({ x }, k) => [x, this.places[k][i]]));
  }

  select() {
    const draw = (verdict, isChosen) =>
      make("path", {
        class: `design-lines v-${verdict} ${isChosen ? "on" : "off"}`,
        d: this.selection.indices(verdict, isChosen).map((i) => this.pathOf(i)).join(""),
      });
    this.lines.replaceChildren(...VERDICTS.map((verdict) => draw(verdict, false)), ...VERDICTS.map((verdict) => draw(verdict, true)));
    for (const one of this.axes) {
      this.placeBrush(one);
    }
    this.hover();
  }

  placeBrush(one) {
    const { at, column } = one;
    const range = this.range(one);
    const isSet = this.selection.limits.has(column.name);
    one.brush.setAttribute("visibility", isSet ? "visible" : "hidden");
    one.brush.setAttribute("y", round(at(range[1])));
    one.brush.setAttribute("height", round(Math.max(1, at(range[0]) - at(range[1]))));
    one.handles.forEach((handle, end) => {
      handle.setAttribute("transform", `translate(0 ${round(at(range[end]))})`);
      handle.setAttribute("aria-valuemin", at.low);
      handle.setAttribute("aria-valuemax", at.high);
      handle.setAttribute("aria-valuenow", Number(range[end].toPrecision(5)));
      handle.setAttribute("aria-valuetext", isSet ? withUnit(range[end], column.unit, 4) : "no limit");
      handle.classList.toggle("set", isSet);
    });
  }

  hover() {
    const i = this.selection.hovered;
    this.hoverLine.setAttribute("d", i === null ? "" : this.pathOf(i));
  }

  nearest([x, y]) {
    const right = this.axes.findIndex((one) => one.x >= x);
    if (right <= 0) {
      return null;
    }
    const [a, b] = [this.axes[right - 1], this.axes[right]];
    const share = (x - a.x) / (b.x - a.x);
    let [best, distance] = [null, REACH];
    this.selection.data.designs.number.forEach((_, i) => {
      const own = Math.abs(this.places[right - 1][i] * (1 - share) + this.places[right][i] * share - y);
      // Of lines as near as each other, one that is selected.
      if (own + (this.selection.chosen[i] ? 0 : 4) < distance) {
        [best, distance] = [i, own];
      }
    });
    return best;
  }

  onMove(event) {
    const found = this.nearest(pointer(this.svg, event));
    this.selection.hover(found);
    if (found === null) {
      hideTip();
    } else {
      showTip(event, this.tellOf(found));
    }
  }

  onLeave() {
    this.selection.hover(null);
    hideTip();
  }

  rows() {
    return null; // as the selection's own table, with a column that says what is selected
  }
}
