// What is selected of a study's designs, and who wants to know. One rule for all charts: a design is selected when
// each of its numbers lies inside the limits that are set, and its verdict is ticked. The address keeps the limits,
// so that a selection can be kept as a bookmark and sent to a colleague.

import { extent } from "./svg.js";

const FIRST_COLUMNS = 5;

export class Selection extends EventTarget {
  constructor(data) {
    super();
    this.limits = new Map();
    this.logarithmic = new Set();
    this.hidden = new Set(); // verdicts that are not shown
    this.hovered = null;
    this.setData(data);
    this.shown = this.firstColumns();
    this.readAddress();
  }

  setData(data) {
    this.data = data;
    this.columns = new Map(data.columns.map((column) => [column.name, column]));
    this.count = data.designs.number.length;
    this.hovered = null;
    this.choose();
  }

  /** The searched parameters and the study's own responses; with many, those that move the response most. */
  firstColumns() {
    const of = (kind) => this.data.columns.filter((column) => column.kind === kind).map((column) => column.name);
    const responses = of("response");
    const moved = this.data.report?.effects[responses[0]] ?? [];
    const share = new Map(moved.map((effect) => [effect.name, effect.total_share]));
    const parameters = of("parameter");
    const most = [...parameters].sort((a, b) => (share.get(b) ?? 0) - (share.get(a) ?? 0)).slice(0, FIRST_COLUMNS);
    return [...parameters.filter((name) => most.includes(name)), ...responses];
  }

  get shownColumns() {
    return this.data.columns.filter((column) => this.shown.includes(column.name));
  }

  get primary() {
    return this.data.columns.find((column) => column.kind === "response");
  }

  values(name) {
    return this.data.designs.values[name] ?? [];
  }

  /** The axis of a column: a parameter's range, a response's values with its window, and a little room. */
  domain(name) {
    const column = this.columns.get(name);
    const seen = extent([...this.values(name), ...(column.range ?? []), ...(column.window ?? [])]) ?? [0, 1];
    const room = seen[1] > seen[0] ? 0.04 * (seen[1] - seen[0]) : Math.abs(seen[0]) * 0.05 || 1;
    if (column.range) {
      return seen[1] > seen[0] ? seen : [seen[0] - room, seen[1] + room];
    }
    if (this.isLog(name)) {
      return [seen[0] / 1.04, seen[1] * 1.04];
    }
    return [seen[0] - room, seen[1] + room];
  }

  canBeLog(name) {
    const column = this.columns.get(name);
    const seen = extent([...this.values(name), ...(column.range ?? []), ...(column.window ?? [])]);
    return seen !== null && seen[0] > 0 && seen[1] > seen[0];
  }

  isLog(name) {
    return this.logarithmic.has(name) && this.canBeLog(name);
  }

  toggleLog(name) {
    if (!this.logarithmic.delete(name)) {
      this.logarithmic.add(name);
    }
    this.tell("axes");
  }

  /** `limits`: [[name, [low, high] or null], ...]; the whole axis is no limit. */
  limit(...limits) {
    for (const [name, range] of limits) {
      this.keep(name, range);
    }
    this.choose();
    this.tell("selection");
  }

  keep(name, range) {
    const [low, high] = range === null ? [] : [Math.min(...range), Math.max(...range)];
    const all = this.domain(name);
    if (range === null || (low <= all[0] && high >= all[1])) {
      this.limits.delete(name);
    } else {
      const inside = (value) => Math.max(all[0], Math.min(all[1], value));
      this.limits.set(name, [inside(low), inside(high)]);
    }
  }

  toggleVerdict(verdict, isShown) {
    this.hidden[isShown ? "delete" : "add"](verdict);
    this.choose();
    this.tell("selection");
  }

  clear() {
    this.limits.clear();
    this.hidden.clear();
    this.choose();
    this.tell("selection");
  }

  get isAll() {
    return this.limits.size === 0 && this.hidden.size === 0;
  }

  choose() {
    const { designs } = this.data;
    const checks = [...this.limits]
      .filter(([name]) => this.columns.has(name))
      .map(([name, [low, high]]) => [this.values(name), low, high]);
    this.chosen = designs.verdict.map(
      (verdict, i) =>
        !this.hidden.has(verdict) &&
        checks.every(([values, low, high]) => values[i] !== null && values[i] !== undefined && values[i] >= low && values[i] <= high),
    );
    this.chosenCount = this.chosen.reduce((sum, one) => sum + Number(one), 0);
  }

  /** Indices of designs of a verdict that are selected, or not. */
  indices(verdict, isChosen) {
    const found = [];
    this.data.designs.verdict.forEach((own, i) => {
      if (own === verdict && this.chosen[i] === isChosen) {
        found.push(i);
      }
    });
    return found;
  }

  hover(index) {
    if (index !== this.hovered) {
      this.hovered = index;
      this.tell("hover");
    }
  }

  tell(what) {
    if (what === "selection" || what === "axes") {
      this.writeAddress();
    }
    this.dispatchEvent(new Event(what));
  }

  writeAddress() {
    const kept = new URLSearchParams();
    for (const [name, range] of this.limits) {
      kept.set(name, range.map((value) => Number(value.toPrecision(5))).join(".."));
    }
    if (this.hidden.size > 0) {
      kept.set("without", [...this.hidden].join(","));
    }
    if (this.logarithmic.size > 0) {
      kept.set("log", [...this.logarithmic].join(","));
    }
    const hash = kept.size > 0 ? `#${kept}` : "";
    history.replaceState(null, "", window.location.pathname + window.location.search + hash);
  }

  readAddress() {
    const kept = new URLSearchParams(window.location.hash.slice(1));
    for (const [name, told] of kept) {
      const range = told.split("..").map(Number);
      if (this.columns.has(name) && range.length === 2 && range.every(Number.isFinite)) {
        this.keep(name, range);
      }
    }
    const listed = (key) => (kept.get(key) ?? "").split(",");
    this.hidden = new Set(listed("without").filter((verdict) => verdict in this.data.verdicts));
    this.logarithmic = new Set(listed("log").filter((name) => this.columns.has(name)));
    this.choose();
  }
}
