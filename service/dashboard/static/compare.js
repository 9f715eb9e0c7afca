// Picks two things to compare, and gives their table as a file.

import { saveCsv, savePng } from "./downloads.js";

const picker = document.getElementById("picker");
const [first, second] = picker?.querySelectorAll("select") ?? [];

document.getElementById("compare")?.addEventListener("click", () => {
  const chosen = new URLSearchParams({ kind: picker.dataset.kind, a: first.value, b: second.value });
  window.location.assign(`/compare?${chosen}`);
});

const named = (what) => `talus-compare${window.location.search.replace(/\W+/g, "-")}${what}`;

document.getElementById("outline-png")?.addEventListener("click", () => savePng(document.getElementById("outlines"), named("-heights")));

document.getElementById("outline-csv")?.addEventListener("click", () => {
  const sides = JSON.parse(document.getElementById("outline-data").textContent);
  const rows = sides.flatMap(([name, [r, h]]) => r.map((at, k) => [name, at, h[k]]));
  saveCsv(named("-heights"), ["pile", "distance from the axis, m", "mean height, m"], rows);
});

document.getElementById("csv")?.addEventListener("click", () => {
  const rows = [...document.querySelectorAll("#compared tr")].map((row) => [...row.cells].map((cell) => cell.textContent));
  saveCsv(named(""), rows[0], rows.slice(1));
});
