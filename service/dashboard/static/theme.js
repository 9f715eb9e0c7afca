// The page's colours for the charts, read from the style sheet so that there is one place for them.

const dark = window.matchMedia("(prefers-color-scheme: dark)");

export function colours() {
  const style = getComputedStyle(document.documentElement);
  const read = (name) => style.getPropertyValue(`--${name}`).trim();
  return Object.fromEntries(
    ["ink", "muted", "line", "card", "accent", "accent-soft", "good", "good-soft", "doubt", "bad", "target"].map(
      (name) => [name, read(name)],
    ),
  );
}

export function onThemeChange(act) {
  dark.addEventListener("change", act);
}

/** What all charts share: fonts, grid, margins, hover. */
export function baseLayout(theme) {
  const axis = {
    gridcolor: theme.line,
    zerolinecolor: theme.line,
    linecolor: theme.muted,
    tickcolor: theme.muted,
    automargin: true,
    title: { standoff: 8 },
  };
  return {
    font: { family: "system-ui, sans-serif", size: 13, color: theme.ink },
    paper_bgcolor: "rgba(0,0,0,0)",
    plot_bgcolor: "rgba(0,0,0,0)",
    margin: { l: 48, r: 14, t: 8, b: 42 },
    hoverlabel: { bgcolor: theme.card, bordercolor: theme.muted, font: { color: theme.ink, size: 13 }, align: "left" },
    legend: { orientation: "h", x: 0, y: 1.02, xanchor: "left", yanchor: "bottom", font: { size: theme.narrow ? 11 : 12 }, itemwidth: 30, ...(theme.narrow ? { entrywidthmode: "fraction", entrywidth: 0.48 } : {}) },
    xaxis: { ...axis },
    yaxis: { ...axis },
  };
}

/** A text axis title in plotly's shape. */
export function titled(axis, text) {
  return { ...axis, title: { ...axis.title, text } };
}
