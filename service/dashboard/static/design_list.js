// The designs as a table: those selected, or all with those marked; sorted by any column.

import { extent, headingOf, tell, titleOf } from "./svg.js";

const DIGITS = 4;

/** As many decimals as give the largest of a column four digits, and no more than any of its values has. */
function decimalsOf(values) {
  const [low, high] = extent(values) ?? [0, 0];
  const most = DIGITS - 1 - Math.floor(Math.log10(Math.max(Math.abs(low), Math.abs(high)) || 1));
  const needed = values.map((value) => (Number.isFinite(value) ? (String(Number(value.toPrecision(DIGITS))).split(".")[1] ?? "").length : 0));
  return Math.max(0, Math.min(most, 12, Math.max(0, ...needed)));
}

export class DesignList {
  constructor(table, selection, isWhole) {
    this.table = table;
    this.selection = selection;
    this.isWhole = isWhole;
    this.order = { key: "number", up: true };
    table.tBodies[0].addEventListener("pointerover", (event) => this.point(event));
    table.tBodies[0].addEventListener("focusin", (event) => this.point(event));
    table.tBodies[0].addEventListener("pointerleave", () => selection.hover(null));
  }

  point(event) {
    const row = event.target.closest?.("tr");
    if (row) {
      this.selection.hover(Number(row.dataset.index));
    }
  }

  get keys() {
    return ["number", "verdict", "origin", ...this.selection.shownColumns.map((column) => column.name)];
  }

  titles() {
    const own = { number: "No.", verdict: "Verdict", origin: "Origin" };
    return this.keys.map((key) => own[key] ?? titleOf(this.selection.columns.get(key)).replace(/,\u00a0–$/, ""));
  }

  valueOf(i, key) {
    const { designs } = this.selection.data;
    return key in designs ? designs[key][i] : (this.selection.values(key)[i] ?? null);
  }

  draw() {
    this.drawHead();
    const indices = this.selection.data.designs.number.map((_, i) => i);
    const { key, up } = this.order;
    indices.sort((a, b) => {
      const [p, q] = [this.valueOf(a, key), this.valueOf(b, key)];
      // What is missing stands last, whichever way.
      if (p === null || q === null) {
        return (p === null) - (q === null);
      }
      return (p < q ? -1 : p > q ? 1 : a - b) * (up ? 1 : -1);
    });
    this.decimals = new Map(this.selection.shownColumns.map(({ name }) => [name, decimalsOf(this.selection.values(name))]));
    this.rows = new Map();
    this.table.tBodies[0].replaceChildren(...indices.map((i) => this.drawRow(i)));
    this.select();
  }

  drawHead() {
    const row = document.createElement("tr");
    this.titles().forEach((title, k) => {
      const key = this.keys[k];
      const cell = Object.assign(document.createElement("th"), { scope: "col" });
      const button = Object.assign(document.createElement("button"), { type: "button", className: "sort", textContent: title });
      const isOwn = this.order.key === key;
      cell.setAttribute("aria-sort", isOwn ? (this.order.up ? "ascending" : "descending") : "none");
      cell.classList.toggle("num", !["verdict", "origin"].includes(key));
      button.addEventListener("click", () => {
        this.order = { key, up: isOwn ? !this.order.up : true };
        this.draw();
        this.table.tHead.rows[0].cells[k].querySelector("button").focus();
      });
      cell.append(button);
      row.append(cell);
    });
    this.table.tHead.replaceChildren(row);
  }

  drawRow(i) {
    const { designs, verdicts } = this.selection.data;
    const row = document.createElement("tr");
    row.dataset.index = i;
    for (const key of this.keys) {
      const cell = document.createElement(key === "number" ? "th" : "td");
      if (key === "number") {
        cell.scope = "row";
        cell.className = "num";
        const link = Object.assign(document.createElement("a"), { href: `/designs/${designs.id[i]}`, textContent: designs.number[i] });
        link.setAttribute("aria-label", `simulation ${designs.number[i]} in detail`);
        cell.append(link);
      } else if (key === "verdict") {
        const tone = { feasible: "good", unfeasible: "doubt", error: "bad" }[designs.verdict[i]];
        cell.append(Object.assign(document.createElement("span"), { className: `tag ${tone}`, textContent: verdicts[designs.verdict[i]] }));
      } else if (key === "origin") {
        cell.textContent = designs.origin[i];
      } else {
        cell.className = "num nums";
        cell.textContent = this.told(i, key);
      }
      row.append(cell);
    }
    this.rows.set(i, row);
    return row;
  }

  told(i, key) {
    const column = this.selection.columns.get(key);
    const known = this.valueOf(i, key);
    const value = known === null ? "–" : known.toFixed(this.decimals.get(key)).replace("-", "−") + (column.unit === "°" ? "°" : "");
    const sd = key === "angle_deg" ? this.selection.data.designs.angle_sd[i] : null;
    return sd === null ? value : `${value} ± ${tell(sd, 2)}${column.unit}`;
  }

  select() {
    const whole = this.isWhole();
    for (const [i, row] of this.rows) {
      row.hidden = !whole && !this.selection.chosen[i];
      row.classList.toggle("unchosen", !this.selection.chosen[i]);
    }
    this.hover();
  }

  hover() {
    this.pointed?.classList.remove("pointed");
    this.pointed = this.rows.get(this.selection.hovered);
    this.pointed?.classList.add("pointed");
  }

  /** `indices`: which designs; every number that is known of them, whether or not its column is shown. */
  csv(indices) {
    const { designs, columns } = this.selection.data;
    const header = ["number", "verdict", "origin", "selected", ...columns.map(headingOf), "standard error of the angle, °", "predicted angle, °", "standard deviation of the prediction, °"];
    const rows = indices.map((i) => [
      designs.number[i], designs.verdict[i], designs.origin[i], this.selection.chosen[i] ? 1 : 0,
      ...columns.map((column) => this.valueOf(i, column.name)),
      designs.angle_sd[i], designs.predicted[i], designs.predicted_sd[i],
    ]);
    return { header, rows };
  }
}
