// Picks two things to compare, and gives their table as a file.

import { saveCsv } from "./downloads.js";

const picker = document.getElementById("picker");
const [first, second] = picker?.querySelectorAll("select") ?? [];

document.getElementById("compare")?.addEventListener("click", () => {
  const chosen = new URLSearchParams({ kind: picker.dataset.kind, a: first.value, b: second.value });
  window.location.assign(`/compare?${chosen}`);
});

document.getElementById("csv")?.addEventListener("click", () => {
  const rows = [...document.querySelectorAll("#compared tr")].map((row) => [...row.cells].map((cell) => cell.textContent));
  saveCsv(`talus-compare${window.location.search.replace(/\W+/g, "-")}`, rows[0], rows.slice(1));
});
