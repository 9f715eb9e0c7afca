// The posterior's draws in a grid of pairs. They are parameter sets, not designs: the limits on parameters hold for
// them too, so that one sees what a limit leaves of the posterior.

import { all } from "./pair_grid.js";
import { headingOf, withUnit } from "./svg.js";

export function posteriorPairs(selection) {
  const report = () => selection.data.report;
  const draws = () => report()?.draws ?? { names: [], x: [], means: [] };
  const values = (name) => {
    const k = draws().names.indexOf(name);
    return draws().x.map((row) => row[k]);
  };
  const told = (name) => report()?.posterior.parameters.find((parameter) => parameter.name === name);
  const columns = () => draws().names.map((name) => selection.columns.get(name)).filter(Boolean);
  const inside = (row) =>
    draws().names.every((name, k) => {
      const range = selection.limits.get(name);
      return !range || (row[k] >= range[0] && row[k] <= range[1]);
    });
  const chosen = () => all(draws().x.length).filter((i) => inside(draws().x[i]));
  let hovered = null;
  return {
    sign: "ρ",
    count: () => draws().x.length,
    columns,
    values,
    groups: () => {
      const taken = new Set(chosen());
      const indices = all(draws().x.length);
      return [["draw off", indices.filter((i) => !taken.has(i))], ["draw on", indices.filter((i) => taken.has(i))]];
    },
    everything: () => all(draws().x.length),
    chosen,
    // The report's own, from all points of its sample and not from those drawn here.
    together: (a, b) => {
      const names = report().posterior.parameters.map((parameter) => parameter.name);
      return selection.limits.size > 0 ? null : report().posterior.correlations[names.indexOf(a.name)][names.indexOf(b.name)];
    },
    interval: (column) => {
      const parameter = told(column.name);
      return parameter ? [parameter.lower_90, parameter.upper_90] : null;
    },
    hovered: () => hovered,
    hover: (i) => {
      hovered = i;
    },
    tell: (i) => [
      "one set of the posterior",
      ...columns().map((column, k) => `${column.text} ${withUnit(draws().x[i][k], column.unit)}`),
      `${selection.primary.text} ${withUnit(draws().means[i], selection.primary.unit)} by the model`,
    ],
    rows: () => ({
      header: [...columns().map(headingOf), `${headingOf(selection.primary)} by the model`],
      rows: draws().x.map((row, i) => [...row, draws().means[i]]),
    }),
  };
}
