// The charts of a page as files: PNG of what is drawn, CSV of the numbers behind it.

import { saveCsv, savePng } from "./downloads.js";

const SCALE = 2;

const TABLES = {
  angle: ({ points, parameters }) => {
    const names = Object.keys(parameters);
    return {
      header: ["simulation", "repose angle, °", "standard error, °", "predicted, °", "standard deviation of the prediction, °", "verdict", "origin", ...Object.values(parameters)],
      rows: points.map((p) => [p.number, p.angle, p.error, p.predicted, p.predicted_sd, p.failure ?? p.verdict, p.origin_word, ...names.map((name) => p.x[name])]),
    };
  },
  profile: ({ r, h, low, high }) => ({
    header: ["distance from the axis, m", "mean height, m", "low end of 90 % of the ring, m", "high end of 90 % of the ring, m"],
    rows: r.map((at, k) => [at, h[k], low[k], high[k]]),
  }),
  sectors: ({ angles }) => ({
    header: ["direction around the axis, °", "slope of the sector, °"],
    rows: angles.map((angle, k) => [((k + 0.5) * 360) / angles.length, angle]),
  }),
  burden: ({ azimuth, height, mass, size }) => ({
    header: ["direction around the axis, °", "height above the seat, m", "mass, kg", "mean diameter of the grains, mm"],
    rows: azimuth.map((at, k) => [at, height[k], mass[k], size[k]]),
  }),
  account: ({ time, fed, on_belt, in_flight, in_hopper, lost }) => ({
    header: ["simulated time, s", "fed, kg", "on the belt, kg", "in flight, kg", "in the hopper, kg", "lost, kg"],
    rows: time.map((at, k) => [at, fed[k], on_belt[k], in_flight[k], in_hopper[k], lost[k]]),
  }),
  belt: ({ height, share, size }) => ({
    header: ["height above the belt, mm", "share of the mass", "mean diameter of the grains, mm"],
    rows: height.map((at, k) => [at, share[k], size[k]]),
  }),
};

const named = (name) => `talus-${window.location.pathname.split("/").filter(Boolean).join("-")}-${name}`;

function saveRose(figure, kind) {
  if (kind === "png") {
    return savePng(figure.querySelector("svg"), named("sectors"));
  }
  const rows = [...figure.querySelectorAll("[data-azimuth]")].map(({ dataset }) => [dataset.azimuth, dataset.mass, dataset.size]);
  return saveCsv(named("sectors"), ["direction around the axis, °", "mass, kg", "mean diameter of the grains, m"], rows);
}

/** `dataOf` gives what the chart of a name is drawn from, null where there is nothing. */
export function listenToFiles(dataOf) {
  document.addEventListener("click", ({ target }) => {
    const button = target.closest?.("[data-save]");
    if (!button) {
      return;
    }
    const { save: kind, of: name } = button.dataset;
    if (name === "rose") {
      saveRose(button.closest("figure"), kind);
      return;
    }
    const box = document.querySelector(`[data-chart="${name}"][data-drawn]`);
    if (box && kind === "png") {
      window.Plotly.downloadImage(box, { format: "png", scale: SCALE, width: box.clientWidth, height: box.clientHeight, filename: named(name) });
    } else if (box) {
      const { header, rows } = TABLES[name](dataOf(name));
      saveCsv(named(name), header, rows);
    }
  });
}

/** There is nothing to save of a chart that is not drawn. */
export function allowFiles(box, isDrawn) {
  for (const button of document.querySelectorAll(`[data-save][data-of="${box.dataset.chart}"]`)) {
    button.disabled = !isDrawn;
  }
}
