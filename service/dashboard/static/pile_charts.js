// The pile's profile with its fitted slope, and the angle of each sector.

import { baseLayout, titled } from "./theme.js";

const radians = (degrees) => (degrees * Math.PI) / 180;

export function profileFigure(data, theme) {
  const R = data.base_radius;
  const limits = [data.fit_from * R, data.fit_to * R];
  const line = (r) => data.intercept - Math.tan(radians(data.angle)) * r;
  const backwards = [...data.r].reverse();
  const traces = [
    {
      type: "scatter", mode: "lines", name: "90 % of each ring", x: [...data.r, ...backwards],
      y: [...data.high, ...[...data.low].reverse()], fill: "toself", fillcolor: theme["accent-soft"],
      line: { width: 0, color: theme.accent }, hoverinfo: "skip",
    },
    {
      type: "scatter", mode: "lines", name: "mean height", x: data.r, y: data.h, line: { color: theme.accent, width: 2 },
      customdata: data.r.map((_, k) => [data.low[k], data.high[k]]),
      hovertemplate: "r %{x:.3f} m<br>height %{y:.3f} m<br>90 % of the ring: %{customdata[0]:.3f} to %{customdata[1]:.3f} m<extra></extra>",
    },
  ];
  if (data.intercept != null) {
    traces.push({
      type: "scatter", mode: "lines", name: `fitted slope ${data.angle.toFixed(2)}°`, x: limits, y: limits.map(line),
      line: { color: theme.target, width: 3 },
      hovertemplate: `fitted line: ${data.angle.toFixed(2)}°, ${data.intercept.toFixed(3)} m at the axis<extra></extra>`,
    });
  }
  const base = baseLayout(theme);
  const top = 1.08 * Math.max(...data.high, data.intercept ?? 0);
  return {
    data: traces,
    layout: {
      ...base,
      xaxis: { ...titled(base.xaxis, "distance from the axis r, m"), range: [0, 1.02 * R], constrain: "domain", zeroline: false },
      // One scale on both axes, so that the slope looks as steep as it is.
      yaxis: { ...titled(base.yaxis, "height h, m"), range: [0, top], scaleanchor: "x", constrain: "domain", constraintoward: "bottom" },
      shapes: limits.map((r) => ({ type: "line", yref: "paper", y0: 0, y1: 1, x0: r, x1: r, line: { color: theme.muted, width: 1, dash: "dot" } })),
      annotations: limits.map((r, k) => ({
        x: r, yref: "paper", y: 1, yanchor: "top", xanchor: k === 0 ? "left" : "right", xshift: k === 0 ? 3 : -3,
        showarrow: false, text: k === 0 ? "fit from .15 R" : "to .9 R", font: { size: 11, color: theme.muted },
      })),
    },
  };
}

export function sectorFigure(data, theme) {
  const width = 360 / data.angles.length;
  const middles = data.angles.map((_, k) => (k + 0.5) * width);
  const known = data.angles.filter((angle) => angle != null);
  const low = Math.min(...known, data.window[0]);
  const high = Math.max(...known, data.window[1]);
  const space = 0.12 * (high - low);
  const base = baseLayout(theme);
  const across = { xref: "paper", x0: 0, x1: 1, layer: "below" };
  const level = (y, colour, dash) => ({ type: "line", ...across, y0: y, y1: y, line: { color: colour, width: 1.6, dash } });
  const band = (from, to, colour) => ({ type: "rect", ...across, y0: from, y1: to, fillcolor: colour, line: { width: 0 } });
  const error = data.error ?? 0;
  return {
    data: [
      {
        type: "scatter", mode: "markers", name: "sector", x: middles, y: data.angles,
        marker: { color: theme.accent, size: 8 }, showlegend: false,
        hovertemplate: "sector at %{x:.1f}°: slope %{y:.2f}°<extra></extra>",
      },
      { type: "scatter", mode: "lines", name: `mean ${data.mean.toFixed(2)}° ± ${error.toFixed(2)}°`, x: [0, 360], y: [data.mean, data.mean], line: { color: theme.accent, width: 2 }, hoverinfo: "skip" },
      { type: "scatter", mode: "lines", name: `target ${data.target}°`, x: [0, 360], y: [data.target, data.target], line: { color: theme.target, width: 1.6, dash: "dash" }, hoverinfo: "skip" },
    ],
    layout: {
      ...base,
      xaxis: { ...titled(base.xaxis, "direction around the axis, degrees"), range: [0, 360], dtick: 90, zeroline: false },
      yaxis: { ...titled(base.yaxis, "slope of the sector, degrees"), range: [low - space, high + space], zeroline: false },
      shapes: [
        band(data.window[0], data.window[1], theme["good-soft"]),
        band(data.mean - error, data.mean + error, theme["accent-soft"]),
        level(data.mean, theme.accent, "solid"),
      ],
    },
  };
}
