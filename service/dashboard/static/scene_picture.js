// A 3D view as a picture to keep: what is drawn, its legend, and a line that says what it is.

import { save } from "./downloads.js";
import { drawLegend } from "./scene_colours.js";
import { tell } from "./svg.js";

const FONT = 24;
const LEGEND = 190;
const FOOT = 2.2 * FONT;

/** The view must have been drawn in this very moment: WebGL keeps no picture for later. */
export function sceneAsPng({ canvas, root, scene, colour, painted, cut, find, frame }) {
  const made = document.createElement("canvas");
  const style = getComputedStyle(root.closest(".card") ?? document.body);
  [made.width, made.height] = [canvas.width + LEGEND, canvas.height + FOOT];
  const context = made.getContext("2d");
  context.fillStyle = style.backgroundColor;
  context.fillRect(0, 0, made.width, made.height);
  context.drawImage(canvas, 0, 0);
  const ink = style.color;
  drawLegend(context, colour, painted, { x: canvas.width + 8, y: 12, high: Math.min(canvas.height - 24, 520), ink, font: FONT });
  context.fillStyle = ink;
  context.font = `${FONT}px system-ui, sans-serif`;
  const words = [scene.title, `${frame.radii.length} grains at ${tell(frame.time_s, 4)} s`, cut[0] || cut[1] || cut[2] ? find("cut-at").textContent : ""];
  context.fillText(words.filter(Boolean).join("; "), 12, canvas.height + 1.4 * FONT);
  made.toBlob((blob) => save(`talus-${root.dataset.name}.png`, blob), "image/png");
}
