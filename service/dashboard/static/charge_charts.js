// A charge in curves: the burden by sector, the mass over time, the bed on the belt by height.

import { baseLayout, titled } from "./theme.js";

const line = (name, x, y, colour, template, more = {}) => ({
  type: "scatter", mode: "lines", name, x, y, line: { color: colour, width: 2 }, hovertemplate: `${template}<extra></extra>`, ...more,
});

// A second scale on the right with its own round numbers: plotly would put its ticks where the left one has them.
const right = (axis, title) => ({ ...titled(axis, title), overlaying: "y", side: "right", showgrid: false, tickmode: "auto" });

export function burdenFigure(data, theme) {
  const base = baseLayout(theme);
  return {
    data: [
      line("height", data.azimuth, data.height, theme.accent, "sector at %{x:.1f}°: %{y:.3f} m above the seat", { mode: "lines+markers" }),
      line("mean grain", data.azimuth, data.size, theme.target, "sector at %{x:.1f}°: grains of %{y:.0f} mm", {
        mode: "lines+markers", yaxis: "y2", line: { color: theme.target, width: 2, dash: "dot" },
      }),
    ],
    layout: {
      ...base,
      xaxis: { ...titled(base.xaxis, "direction around the axis, degrees (belt at 180)"), range: [0, 360], dtick: 90, zeroline: false },
      yaxis: { ...titled(base.yaxis, "height above the seat, m"), zeroline: false },
      yaxis2: { ...right(base.yaxis, "mean grain, mm"), zeroline: false },
      shapes: data.piles.map((at) => ({ type: "line", yref: "paper", y0: 0, y1: 1, x0: at, x1: at, line: { color: theme.muted, width: 1, dash: "dash" } })),
      annotations: data.piles.map((at) => ({ x: at, yref: "paper", y: 0, yanchor: "bottom", xanchor: "left", xshift: 3, showarrow: false, text: "pile", font: { size: 11, color: theme.muted } })),
    },
  };
}

// Name, colour, dash, and whether it is small beside the charge: those have the scale on the right.
const PLACES = [
  ["in_hopper", "in the hopper", "accent", "solid", false], ["fed", "fed", "muted", "dot", false],
  ["on_belt", "on the belt", "good", "solid", true], ["in_flight", "in flight", "doubt", "solid", true],
  ["lost", "lost", "bad", "dash", true],
];

export function accountFigure(data, theme) {
  const base = baseLayout(theme);
  return {
    data: PLACES.map(([key, name, colour, dash, isSmall]) =>
      line(isSmall ? `${name} (right)` : name, data.time, data[key], theme[colour], `%{x:.1f} s: %{y:.4~g} kg ${name}`, {
        line: { color: theme[colour], width: 2, dash }, ...(isSmall ? { yaxis: "y2" } : {}),
      })),
    layout: {
      ...base,
      xaxis: { ...titled(base.xaxis, "simulated time, s"), zeroline: false },
      yaxis: { ...titled(base.yaxis, "mass, kg"), rangemode: "tozero" },
      yaxis2: { ...right(base.yaxis, "on the belt, in flight, lost, kg"), rangemode: "tozero" },
    },
  };
}

export function beltFigure(data, theme) {
  const base = baseLayout(theme);
  const percent = data.share.map((share) => (share == null ? null : 100 * share));
  const highest = data.height[percent.findLastIndex((share) => share > 0.05)];
  return {
    data: [
      {
        type: "bar", name: "share of the mass", x: data.height, y: percent, marker: { color: theme["accent-soft"], line: { color: theme.accent, width: 1 } },
        hovertemplate: "%{x:.0f} mm above the belt: %{y:.1f} % of the mass<extra></extra>",
      },
      line("mean grain", data.height, data.size, theme.target, "%{x:.0f} mm above the belt: grains of %{y:.0f} mm", { mode: "lines+markers", yaxis: "y2" }),
    ],
    layout: {
      ...base,
      xaxis: { ...titled(base.xaxis, "height above the belt, mm"), range: [0, 1.1 * highest], zeroline: false },
      yaxis: { ...titled(base.yaxis, "share of the mass, %"), rangemode: "tozero" },
      yaxis2: { ...right(base.yaxis, "mean grain, mm"), rangemode: "tozero" },
    },
  };
}
