// The designs in a grid of pairs.

import { all } from "./pair_grid.js";

const MOST_COLUMNS = 7;
const VERDICTS = ["error", "unfeasible", "feasible"];

export function designPairs(selection, tellDesign) {
  return {
    sign: "r",
    count: () => selection.count,
    columns: () => selection.shownColumns.slice(0, MOST_COLUMNS),
    values: (name) => selection.values(name),
    groups: () => [
      ...VERDICTS.map((verdict) => [`v-${verdict} off`, selection.indices(verdict, false)]),
      ...VERDICTS.map((verdict) => [`v-${verdict} on`, selection.indices(verdict, true)]),
    ],
    everything: () => all(selection.count),
    chosen: () => all(selection.count).filter((i) => selection.chosen[i]),
    together: () => null,
    interval: () => null,
    hovered: () => selection.hovered,
    hover: (i) => selection.hover(i),
    tell: tellDesign,
    rows: () => null,
  };
}
