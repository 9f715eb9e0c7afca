// Says at the top whether the page is live, finished, or stale, and since when.

import { timeNow } from "./clock.js";

const TEXTS = { live: "live", over: "finished", lost: "connection lost", wait: "connecting" };
let lostSince = null;

export function showConnection(state) {
  const place = document.getElementById("live");
  const banner = document.getElementById("banner");
  place.hidden = false;
  if (place.dataset.state !== state) {
    place.dataset.state = state;
    document.getElementById("live-text").textContent = TEXTS[state];
  }
  if (state === "lost") {
    lostSince ??= timeNow();
    banner.textContent = `The connection to Talus is lost. What you see is from ${lostSince}; trying again by itself.`;
  } else if (state !== "wait") {
    lostSince = null;
  }
  banner.hidden = lostSince === null;
  document.body.classList.toggle("stale", lostSince !== null);
}
