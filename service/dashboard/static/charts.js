// Draws every [data-chart] of the page, and draws it again when its data or the colours change.

import { angleFigure } from "./angle_chart.js";
import { accountFigure, beltFigure, burdenFigure } from "./charge_charts.js";
import { allowFiles, listenToFiles } from "./chart_files.js";
import { profileFigure, sectorFigure } from "./pile_charts.js";
import { colours, onThemeChange } from "./theme.js";

const FIGURES = {
  angle: angleFigure, profile: profileFigure, sectors: sectorFigure, burden: burdenFigure, account: accountFigure, belt: beltFigure,
};
const CHARGED = "The chart appears when the charge has come to rest.";
const EMPTY = {
  angle: "The chart begins with the first finished simulation.",
  profile: "The profile appears with the first measured pile.",
  sectors: "The sectors appear with the measured pile.",
  burden: CHARGED,
  account: CHARGED,
  belt: CHARGED,
};
// A list of our own: plotly's standard buttons include one that would send the chart to a host of theirs.
const CONFIG = {
  responsive: true,
  displaylogo: false,
  displayModeBar: "hover",
  modeBarButtons: [["toImage", "zoom2d", "pan2d", "resetScale2d"]],
  toImageButtonOptions: { format: "png", scale: 2 },
  plotlyServerURL: "",
  showSendToCloud: false,
};

const NARROW_PX = 480;
// A chart on paper, in CSS pixels: as wide as a card on A4. content.css gives its box this height.
const PRINTED = { width: 640, height: 320, autosize: false };

let latest = {};
let plotly = null;

function loadPlotly() {
  plotly ??= new Promise((resolve, reject) => {
    const script = document.createElement("script");
    script.src = document.body.dataset.plotly;
    script.onload = () => resolve(window.Plotly);
    script.onerror = () => reject(new Error("plotly.min.js did not load"));
    document.head.append(script);
  });
  return plotly;
}

function say(box, text) {
  const line = document.createElement("p");
  line.className = "chart-state";
  line.textContent = text;
  box.replaceChildren(line);
  delete box.dataset.drawn;
  allowFiles(box, false);
}

function isEmpty(name, data) {
  return data == null || (name === "angle" && data.points.length === 0);
}

async function draw(box) {
  const name = box.dataset.chart;
  const data = latest[name];
  if (isEmpty(name, data)) {
    say(box, EMPTY[name]);
    return;
  }
  try {
    const Plotly = await loadPlotly();
    const { data: traces, layout } = FIGURES[name](data, { ...colours(), narrow: box.clientWidth < NARROW_PX });
    if (!box.dataset.drawn) {
      box.replaceChildren();
    }
    const options = { ...CONFIG, toImageButtonOptions: { ...CONFIG.toImageButtonOptions, filename: `talus-${name}` } };
    // uirevision keeps the reader's zoom and hidden traces when points are added.
    await Plotly.react(box, traces, { ...layout, uirevision: name }, options);
    if (!box.dataset.drawn) {
      box.dataset.drawn = "yes";
      allowFiles(box, true);
      box.on("plotly_click", (event) => showRow(event.points[0].customdata));
    }
  } catch (error) {
    say(box, "The chart could not be drawn; the numbers are in the table.");
    throw error;
  }
}

function showRow(number) {
  const row = document.getElementById(`design-${number}`);
  if (row) {
    row.scrollIntoView({ block: "center", behavior: "smooth" });
    row.classList.remove("fresh");
    requestAnimationFrame(() => row.classList.add("fresh"));
  }
}

export function drawCharts(charts = latest) {
  latest = charts;
  return Promise.all([...document.querySelectorAll("[data-chart]")].map(draw));
}

// The page's width changes on paper, and plotly measures it too early: a chart would reach into the next one.
function fit(layout) {
  for (const box of document.querySelectorAll("[data-chart][data-drawn]")) {
    window.Plotly.relayout(box, layout);
  }
}

export function startCharts() {
  listenToFiles((name) => latest[name]);
  const source = document.getElementById("charts");
  if (source) {
    onThemeChange(() => drawCharts());
    window.addEventListener("beforeprint", () => fit(PRINTED));
    window.addEventListener("afterprint", () => fit({ width: undefined, height: undefined, autosize: true }));
    drawCharts(JSON.parse(source.textContent));
  }
}
