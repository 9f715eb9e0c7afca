// Colour scales that read in grey and by the colour-blind.

/** Stops of viridis (matplotlib, CC0). */
export const VIRIDIS = ["#440154", "#472d7b", "#3b528b", "#2c728e", "#21918c", "#28ae80", "#5ec962", "#addc30", "#fde725"];
/** Kinds, by Okabe and Ito. */
export const KINDS = ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#f0e442", "#8a8f98"];

/** Red, green and blue, 0 to 255. */
export const channels = (colour) => [1, 3, 5].map((k) => parseInt(colour.slice(k, k + 2), 16));

/** The channels between the stops; `share` from 0 to 1. */
export function channelsAt(stops, share) {
  const place = Math.max(0, Math.min(1, share)) * (stops.length - 1);
  const k = Math.min(Math.floor(place), stops.length - 2);
  const [a, b] = [channels(stops[k]), channels(stops[k + 1])];
  return a.map((from, i) => Math.round(from + (place - k) * (b[i] - from)));
}

/** The same as a colour of CSS. */
export const colourOf = (stops, share) => `rgb(${channelsAt(stops, share).join(",")})`;
