// Puts the changed parts of a page in place, without losing what the reader has open or in focus.

import { localise } from "./clock.js";

function keepFocus(act) {
  const held = document.activeElement;
  const address = held?.getAttribute?.("href");
  act();
  if (held && !held.isConnected && address) {
    document.querySelector(`a[href="${CSS.escape(address)}"]`)?.focus({ preventScroll: true });
  }
}

const shown = new Map();

function replacePart(name, html) {
  const place = document.getElementById(`part-${name}`);
  if (place && shown.get(name) !== html) {
    keepFocus(() => {
      place.innerHTML = html;
    });
    shown.set(name, html);
    localise(place);
  }
}

function putRow(id, html) {
  const holder = document.createElement("template");
  holder.innerHTML = html.trim();
  const row = holder.content.firstElementChild;
  const old = document.getElementById(id);
  const open = old?.querySelector("details")?.open;
  if (open) {
    row.querySelector("details").open = true;
  }
  if (old === null) {
    row.classList.add("fresh");
    document.getElementById("rows").append(row);
  } else {
    old.classList.remove("fresh");
    if (!old.isEqualNode(row)) {
      row.classList.add("fresh");
      keepFocus(() => old.replaceWith(row));
    }
  }
}

function markChosen(numbers) {
  const chosen = new Set(numbers.map((number) => `design-${number}`));
  for (const row of document.querySelectorAll("#rows > tr")) {
    row.classList.toggle("chosen", chosen.has(row.id));
  }
}

/** `answer` is what a page's /parts says (service/dashboard/pages.py). */
export function applyParts(answer) {
  for (const [name, html] of Object.entries(answer.html)) {
    replacePart(name, html);
  }
  if (answer.rows) {
    for (const [id, html] of Object.entries(answer.rows)) {
      putRow(id, html);
    }
    markChosen(answer.chosen);
    document.getElementById("no-rows").hidden = document.querySelector("#rows > tr") !== null;
    for (const [key, count] of Object.entries(answer.counts)) {
      const place = document.querySelector(`[data-count="${key}"]`);
      if (place) {
        place.textContent = count;
      }
    }
  }
}

function timeLeft(seconds) {
  const whole = Math.max(0, Math.round(seconds));
  return whole < 60 ? `about ${whole} s left` : `about ${Math.floor(whole / 60)} min ${String(whole % 60).padStart(2, "0")} s left`;
}

const PHASES = { settle: "filling and settling", discharge: "discharge over the rim" };

/** Moves the bar of a running simulation; false where the page does not show it yet. */
export function applyProgress(told) {
  const job = document.querySelector(`[data-job="${told.number}"]`);
  if (!job) {
    return false;
  }
  if (told.fraction != null) {
    job.querySelector("progress").value = told.fraction;
  }
  job.querySelector("[data-phase]").textContent = PHASES[told.phase] ?? "starting";
  job.querySelector("[data-left]").textContent = told.seconds_left == null ? "" : timeLeft(told.seconds_left);
  return true;
}
