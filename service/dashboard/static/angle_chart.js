// Repose angle against simulation number, with the accepted window and the target.

import { baseLayout, titled } from "./theme.js";

const LONGEST_EMPTY_BUDGET = 60;

const degrees = (value) => `${value.toFixed(2)}°`;
const within = (value, spread) => (spread == null ? degrees(value) : `${degrees(value)} ± ${degrees(spread)}`);

function told(point, parameters) {
  const lines = [`<b>simulation ${point.number}</b> · ${point.origin_word}`];
  lines.push(point.angle == null ? `no angle: ${point.failure ?? "error"}` : `angle ${within(point.angle, point.error)}`);
  if (point.predicted != null) {
    lines.push(`predicted ${within(point.predicted, point.predicted_sd)}`);
  }
  for (const [name, text] of Object.entries(parameters)) {
    if (point.x[name] != null) {
      lines.push(`${text} ${point.x[name].toFixed(2)}`);
    }
  }
  return lines.join("<br>");
}

function heights(data) {
  const seen = data.points.filter((point) => point.angle != null);
  const spread = (point) => point.error ?? 0;
  const low = Math.min(data.window[0], ...seen.map((point) => point.angle - spread(point)));
  const high = Math.max(data.window[1], ...seen.map((point) => point.angle + spread(point)));
  const space = 0.07 * Math.max(high - low, 1);
  return { low: low - space, high: high + space, space };
}

function points(name, chosen, marker, data, y, extra = {}) {
  return {
    type: "scatter",
    mode: "markers",
    name,
    x: chosen.map((point) => point.number),
    y: chosen.map(y),
    text: chosen.map((point) => told(point, data.parameters)),
    customdata: chosen.map((point) => point.number),
    hovertemplate: "%{text}<extra></extra>",
    marker: { size: 9, ...marker },
    ...extra,
  };
}

function measured(data, theme) {
  const bars = (list, colour) => ({
    error_y: { type: "data", array: list.map((point) => point.error ?? 0), color: colour, thickness: 1.2, width: 0 },
  });
  const kinds = [
    ["in window", "feasible", theme.good, true],
    ["outside", "unfeasible", theme.doubt, false],
  ];
  const traces = [];
  for (const [name, verdict, colour, filled] of kinds) {
    for (const repeat of [false, true]) {
      const list = data.points.filter((p) => p.verdict === verdict && (p.origin === "replicate") === repeat);
      if (list.length === 0) {
        continue;
      }
      const symbol = (repeat ? "diamond" : "circle") + (filled ? "" : "-open");
      const marker = { symbol, color: colour, size: repeat ? 10 : 9, line: { color: colour, width: 1.8 } };
      traces.push(points(repeat ? `${name}, repeat` : name, list, marker, data, (p) => p.angle, bars(list, colour)));
    }
  }
  return traces;
}

export function angleFigure(data, theme) {
  const { low, high, space } = heights(data);
  const failed = data.points.filter((point) => point.angle == null);
  const floor = failed.length > 0 ? low - space : low;
  const traces = measured(data, theme);
  if (failed.length > 0) {
    const marker = { symbol: "x", color: theme.bad };
    traces.push(points("error (no angle)", failed, marker, data, () => low));
  }
  const chosen = data.points.filter((point) => point.chosen && point.angle != null);
  if (chosen.length > 0) {
    const marker = { symbol: "circle-open", size: 19, color: theme.accent, line: { color: theme.accent, width: 2 } };
    const name = data.recommended ? "recommended" : "best so far";
    traces.push(points(name, chosen, marker, data, (p) => p.angle, { hoverinfo: "skip", hovertemplate: null }));
  }
  const predicted = data.points.filter((point) => point.predicted != null);
  if (predicted.length > 0) {
    traces.push(
      points("predicted", predicted, { symbol: "line-ew-open", size: 12, color: theme.muted }, data, (p) => p.predicted, {
        visible: "legendonly",
        error_y: {
          type: "data",
          array: predicted.map((point) => point.predicted_sd ?? 0),
          color: theme.muted,
          thickness: 1,
        },
      }),
    );
  }
  return { data: traces, layout: layout(data, theme, floor, high) };
}

function layout(data, theme, floor, high) {
  const base = baseLayout(theme);
  const last = Math.max(0, ...data.points.map((point) => point.number));
  const end = data.budget <= LONGEST_EMPTY_BUDGET ? Math.max(data.budget, last) : Math.max(10, Math.ceil(last * 1.1));
  const across = { xref: "paper", x0: 0, x1: 1 };
  return {
    ...base,
    margin: { ...base.margin, r: theme.narrow ? 10 : 62 },
    xaxis: { ...titled(base.xaxis, "simulation number"), range: [0.2, end + 0.8], tickformat: "d", zeroline: false, showgrid: false },
    yaxis: { ...titled(base.yaxis, "repose angle, degrees"), range: [floor, high], zeroline: false },
    shapes: [
      { type: "rect", layer: "below", ...across, y0: data.window[0], y1: data.window[1], fillcolor: theme["good-soft"], line: { width: 0 } },
      { type: "line", layer: "below", ...across, y0: data.target, y1: data.target, line: { color: theme.target, width: 1.5, dash: "dash" } },
    ],
    annotations: [
      {
        xref: "paper", x: 1, y: data.target, showarrow: false, font: { size: 12, color: theme.target },
        ...(theme.narrow
          ? { xanchor: "right", yanchor: "bottom", yshift: 8, text: `target ${data.target}°` }
          : { xanchor: "left", yanchor: "middle", xshift: 4, text: `target<br>${data.target}°`, align: "left" }),
      },
    ],
  };
}
