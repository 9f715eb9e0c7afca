// Which colour each grain of a frame gets, and the legend that says what it means.

import { channels, channelsAt, KINDS, VIRIDIS } from "./palette.js";
import { UNKNOWN } from "./scene_data.js";
import { tell, ticks } from "./svg.js";

const GREY = [138, 143, 152]; // not known
const LEVELS = 254;

/** 256 colours as RGBA: a scale with grey at its end, or a kind a row. */
function palette(isKinds) {
  const pixels = new Uint8Array(256 * 4);
  for (let k = 0; k < 256; k += 1) {
    const colour = isKinds ? channels(KINDS[k % KINDS.length]) : k === UNKNOWN ? GREY : channelsAt(VIRIDIS, k / LEVELS);
    pixels.set([...colour, 255], 4 * k);
  }
  return pixels;
}

export const SCALE = palette(false);
export const CATEGORIES = palette(true);

function levelsOf(count, value, [low, high]) {
  const width = high - low || 1;
  const levels = new Uint8Array(count);
  for (let i = 0; i < count; i += 1) {
    levels[i] = Math.round(Math.max(0, Math.min(1, (value(i) - low) / width)) * LEVELS);
  }
  return levels;
}

/** Rows of the materials' table that are in the frame, with their names; without names of their own, numbered. */
export function kindsOf(frame, materials) {
  const rows = [...new Set(frame.materials)].sort((a, b) => a - b);
  const whole = materials[0] ?? "material";
  return rows.map((row, k) => ({ row, name: materials[row] && row > 0 ? materials[row] : rows.length > 1 ? `${whole}, kind ${k + 1}` : whole }));
}

/** `levels`, `pixels` and, for the legend, `range` or `kinds` of a colouring. `reference` is the frame whose range lasts. */
export async function paint(colour, frame, reference, data) {
  const count = frame.radii.length;
  if (colour.name === "height") {
    const range = [reference.low[2], reference.high[2]];
    return { levels: levelsOf(count, (i) => frame.positions[3 * i + 2], range), pixels: SCALE, range };
  }
  if (colour.name === "size") {
    const range = reference.radius.map((radius) => 2 * radius);
    const levels = levelsOf(count, (i) => 2 * frame.radii[i], range);
    return { levels, pixels: SCALE, range: range.map((metres) => 1000 * metres) };
  }
  if (colour.name === "material") {
    const kinds = kindsOf(frame, data.scene.materials);
    const place = new Map(kinds.map(({ row }, k) => [row, k]));
    return { levels: frame.materials.map((row) => place.get(row)), pixels: CATEGORIES, kinds };
  }
  const { levels, range } = await data.column(frame, colour.column);
  return { levels, pixels: SCALE, range, hasUnknown: levels.includes(UNKNOWN) };
}

const heading = ({ label, unit }) => (unit ? `${label}, ${unit}` : label);
const css = (pixels, k) => `rgb(${pixels[4 * k]}, ${pixels[4 * k + 1]}, ${pixels[4 * k + 2]})`;

/** What the colours mean, as rows of [colour, text] from the top. */
export function legendRows(colour, painted) {
  if (painted.kinds) {
    return painted.kinds.map(({ name }, k) => [css(painted.pixels, k), name]);
  }
  const unknown = painted.hasUnknown ? [[css(painted.pixels, UNKNOWN), "not yet"]] : [];
  return unknown;
}

/** Draws title, bar and numbers on a canvas' context, `high` tall; used in the page and in the picture to keep. */
export function drawLegend(context, colour, painted, { x, y, high, ink, font }) {
  context.fillStyle = ink;
  context.font = `600 ${font}px system-ui, sans-serif`;
  context.textBaseline = "alphabetic";
  context.fillText(heading(colour), x, y + font);
  context.font = `${font}px system-ui, sans-serif`;
  let top = y + 1.7 * font;
  if (painted.range) {
    const [low, wide] = [painted.range[0], 1.1 * font];
    const width = painted.range[1] - low;
    const bar = high - 1.7 * font - (painted.hasUnknown ? 1.8 * font : 0.5 * font);
    for (let k = 0; k < bar; k += 1) {
      context.fillStyle = css(painted.pixels, width ? Math.round((1 - k / bar) * LEVELS) : 0);
      context.fillRect(x, top + k, wide, 1.5);
    }
    context.fillStyle = ink;
    for (const value of width ? ticks(low, painted.range[1], 5) : [low]) {
      const at = top + (width ? (1 - (value - low) / width) * bar : bar / 2);
      context.fillRect(x + wide, at - 0.5, 4, 1);
      context.fillText(tell(value), x + wide + 7, at + 0.35 * font);
    }
    top += bar + 0.8 * font;
  }
  for (const [fill, words] of legendRows(colour, painted)) {
    context.fillStyle = fill;
    context.fillRect(x, top, font, font);
    context.fillStyle = ink;
    context.fillText(words, x + 1.5 * font, top + 0.85 * font);
    top += 1.5 * font;
  }
}

/** The legend in words. */
export function tellLegend(colour, painted) {
  if (painted.kinds) {
    return `Coloured by ${colour.label}: ${painted.kinds.map(({ name }) => name).join("; ")}.`;
  }
  const unit = colour.unit ? ` ${colour.unit}` : "";
  return `Coloured by ${colour.label}, from ${tell(painted.range[0])} (dark violet) to ${tell(painted.range[1])}${unit} (yellow).`;
}
