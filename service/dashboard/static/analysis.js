// A study's analysis: makes the charts, links them through one selection, and keeps them up to date.

import { posteriorPairs } from "./corner_chart.js";
import { CurvePanels, effectCurves, sliceCurves } from "./curve_panels.js";
import { DesignList } from "./design_list.js";
import { saveCsv, savePng } from "./downloads.js";
import { PairGrid } from "./pair_grid.js";
import { ParallelChart } from "./parallel.js";
import { designPairs } from "./scatter_matrix.js";
import { Selection } from "./selection.js";
import { SurfaceChart } from "./surface_chart.js";
import { withUnit } from "./svg.js";

const VERDICTS = ["feasible", "unfeasible", "error"];
const find = (id) => document.getElementById(id);
const boxOf = (name) => document.querySelector(`[data-plot="${name}"]`);
const NO_REPORT = "Drawn from the study's report, which is written when the study ends, or when asked for under “What is identified”.";
const EMPTY = {
  parallel: "The lines begin with the first finished simulation.",
  matrix: "The points begin with the first finished simulation.",
  effects: NO_REPORT,
  slices: NO_REPORT,
  surface: NO_REPORT,
  corner: NO_REPORT,
};
const OLD_REPORT = {
  corner: "The stored report is of an older kind, without draws of the posterior. A new one can be asked for under “What is identified”.",
  surface: "This study searches one parameter: its slice is below.",
};

const selection = new Selection(JSON.parse(find("analysis").textContent));
const list = new DesignList(find("chosen"), selection, () => find("all-rows").checked);
const chosenResponse = () => find("response").value || selection.primary.name;
const chosenPair = () => Math.max(0, find("pair").selectedIndex);

const charts = {
  parallel: new ParallelChart(boxOf("parallel"), selection, tellDesign),
  matrix: new PairGrid(boxOf("matrix"), selection, designPairs(selection, tellDesign)),
  surface: new SurfaceChart(boxOf("surface"), selection, chosenPair),
  effects: new CurvePanels(boxOf("effects"), selection, effectCurves(selection, chosenResponse)),
  slices: new CurvePanels(boxOf("slices"), selection, sliceCurves(selection)),
  corner: new PairGrid(boxOf("corner"), selection, posteriorPairs(selection)),
};
const drawn = new Set();

function tellDesign(i) {
  const { designs, verdicts } = selection.data;
  const numbers = selection.shownColumns.map((column) => {
    const sd = column.name === "angle_deg" && designs.angle_sd[i] !== null ? ` ± ${withUnit(designs.angle_sd[i], "°", 2)}` : "";
    return `${column.text} ${withUnit(selection.values(column.name)[i], column.unit, 4)}${sd}`;
  });
  return [`simulation ${designs.number[i]} · ${verdicts[designs.verdict[i]]} · ${designs.origin[i]}`, ...numbers];
}

function say(name, words) {
  const state = Object.assign(document.createElement("p"), { className: "chart-state", textContent: words });
  boxOf(name).replaceChildren(state);
  drawn.delete(name);
}

function draw(name) {
  const chart = charts[name];
  const buttons = document.querySelectorAll(`[data-png="${name}"], [data-csv="${name}"]`);
  try {
    if (chart.isEmpty) {
      say(name, selection.data.report ? (OLD_REPORT[name] ?? EMPTY[name]) : EMPTY[name]);
    } else {
      chart.draw();
      drawn.add(name);
    }
  } catch (error) {
    say(name, "The chart could not be drawn; the numbers are in the table below.");
    reportError(error);
  }
  // What scrolls must be reached by keys; what fits needs no stop on the way.
  const box = boxOf(name);
  box[box.scrollWidth > box.clientWidth ? "setAttribute" : "removeAttribute"]("tabindex", "0");
  buttons.forEach((button) => {
    button.disabled = !drawn.has(name);
  });
}

function drawAll() {
  Object.keys(charts).forEach(draw);
  list.draw();
  tellSelection();
}

/** Once a frame at most, however often a drag tells of itself. */
function onceAFrame(act) {
  let waiting = false;
  return () => {
    if (!waiting) {
      waiting = true;
      requestAnimationFrame(() => {
        waiting = false;
        act();
      });
    }
  };
}

function tellSelection() {
  const { count, chosenCount } = selection;
  find("selected-count").textContent = count === 0 ? "No finished design yet" : `${chosenCount} of ${count} designs`;
  find("clear").disabled = selection.isAll;
  find("download-selected").disabled = chosenCount === 0;
  find("no-chosen").hidden = chosenCount > 0;
  find("no-chosen").textContent = count === 0 ? "The designs appear here when they end." : "No design is inside all limits.";
  find("limits").replaceChildren(
    ...[...selection.limits].map(([name, [low, high]]) => {
      const column = selection.columns.get(name);
      const words = `${column.text} ${withUnit(low, "")} to ${withUnit(high, column.unit)}`;
      const button = Object.assign(document.createElement("button"), { type: "button", textContent: `${words} ×` });
      button.setAttribute("aria-label", `take the limit away: ${words}`);
      button.addEventListener("click", () => selection.limit([name, null]));
      const item = document.createElement("li");
      item.append(button);
      return item;
    }),
  );
  for (const box of find("verdicts").querySelectorAll("input")) {
    box.checked = !selection.hidden.has(box.value);
  }
}

function option(kind, name, value, words, isChecked, act) {
  const label = document.createElement("label");
  const box = Object.assign(document.createElement("input"), { type: kind, name, value, checked: isChecked });
  box.addEventListener("change", () => act(box.checked));
  label.append(box, " ", words);
  return label;
}

function offerChoices() {
  const { data } = selection;
  const counts = Object.fromEntries(VERDICTS.map((key) => [key, data.designs.verdict.filter((own) => own === key).length]));
  find("verdicts").querySelectorAll("label").forEach((label) => label.remove());
  for (const key of VERDICTS) {
    const label = option("checkbox", "verdict", key, `${data.verdicts[key]} ${counts[key]}`, !selection.hidden.has(key), (isShown) => selection.toggleVerdict(key, isShown));
    label.className = `verdict v-${key}`;
    find("verdicts").append(label);
  }
  find("columns").querySelectorAll("label").forEach((label) => label.remove());
  for (const column of data.columns) {
    find("columns").append(option("checkbox", "column", column.name, column.text, selection.shown.includes(column.name), (isShown) => showColumn(column.name, isShown)));
  }
  offer(find("pair"), (data.report?.pairs ?? []).map((cut, k) => [String(k), cut.names.map((name) => selection.columns.get(name)?.text ?? name).join(" × ")]));
  offer(find("response"), Object.keys(data.report?.effects ?? {}).filter((name) => selection.columns.has(name)).map((name) => [name, selection.columns.get(name).text]));
  find("response").parentElement.hidden = find("response").options.length < 2;
  find("pair").parentElement.hidden = find("pair").options.length < 2;
}

function offer(select, entries) {
  const before = select.value;
  select.replaceChildren(...entries.map(([value, words]) => new Option(words, value)));
  if (entries.some(([value]) => value === before)) {
    select.value = before;
  }
}

function showColumn(name, isShown) {
  const order = selection.data.columns.map((column) => column.name);
  const kept = new Set(selection.shown);
  kept[isShown ? "add" : "delete"](name);
  selection.shown = order.filter((one) => kept.has(one));
  ["parallel", "matrix"].forEach(draw);
  list.draw();
}

function note(name, words) {
  document.querySelector(`[data-note="${name}"]`).textContent = words;
}

function tellNotes() {
  const { report } = selection.data;
  note("parallel", "Drag along an axis to set its limits, drag them to move them, click to take them away; or focus a handle and use the arrow keys. The green bar is the accepted window.");
  note("matrix", "Drag a box to set both limits. r is Pearson's correlation of the selected designs.");
  if (report) {
    note("surface", "The others at the optimum (+). Thin lines join equal angles, heavy ones bound the accepted window; points are designs, seen along the parameters that are not shown.".replace("angles", `values of ${selection.primary.text}`));
    note("effects", "Share of the variance: the total Sobol index, with its 90 % error from sampling and from leaving designs out. Points are designs.");
    note("slices", "Band: 90 % of the surrogate's own uncertainty, without the scatter between seeds. Points are designs, which lie off the slice.");
    note("corner", "ρ is the posterior's correlation; with limits set, that of the sets inside them. The bar over each histogram is the 90 % interval.");
  }
}

function follow() {
  const redraw = onceAFrame(() => {
    drawn.forEach((name) => charts[name].select());
    list.select();
    tellSelection();
  });
  const point = onceAFrame(() => {
    drawn.forEach((name) => charts[name].hover());
    list.hover();
  });
  selection.addEventListener("selection", redraw);
  selection.addEventListener("hover", point);
  selection.addEventListener("axes", drawAll);
  find("clear").addEventListener("click", () => selection.clear());
  find("all-rows").addEventListener("change", () => list.select());
  find("pair").addEventListener("change", () => draw("surface"));
  find("response").addEventListener("change", () => draw("effects"));
  find("download-selected").addEventListener("click", () => {
    const { header, rows } = list.csv([...selection.chosen.keys()].filter((i) => selection.chosen[i]));
    saveCsv(`study-${selection.data.study}-selected`, header, rows);
  });
}

function listenToDownloads() {
  document.addEventListener("click", (event) => {
    const { png, csv } = event.target.closest?.("button[data-png], button[data-csv]")?.dataset ?? {};
    if (png) {
      savePng(boxOf(png).querySelector("svg"), `study-${selection.data.study}-${png}`);
    } else if (csv) {
      const { header, rows } = charts[csv].rows() ?? list.csv([...selection.chosen.keys()]);
      saveCsv(`study-${selection.data.study}-${csv}`, header, rows);
    }
  });
}

/** Charts are drawn for a width: another one is another drawing. */
function watchWidths() {
  const widths = new Map();
  const watcher = new ResizeObserver((entries) => {
    for (const { target, contentRect } of entries) {
      const name = target.dataset.plot;
      if (widths.has(name) && Math.abs(widths.get(name) - contentRect.width) > 1) {
        draw(name);
      }
      widths.set(name, contentRect.width);
    }
  });
  Object.keys(charts).forEach((name) => watcher.observe(boxOf(name)));
}

document.addEventListener("talus:charts", (event) => {
  if (event.detail.analysis) {
    selection.setData(event.detail.analysis);
    offerChoices();
    tellNotes();
    drawAll();
  }
});

function start() {
  offerChoices();
  tellNotes();
  follow();
  listenToDownloads();
  drawAll();
  watchWidths();
}

// A module may run before the style sheets are there, and a chart's width is theirs.
if (document.readyState === "complete") {
  start();
} else {
  window.addEventListener("load", start, { once: true });
}
