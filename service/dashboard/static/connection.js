// Says at the top whether the page is live, finished, or stale, and since when.

import { timeNow } from "./clock.js";

const TEXTS = { live: "live", over: "finished", lost: "stale: connection lost", wait: "connecting" };
let isLost = false;
let heard = { at: performance.now(), told: timeNow() };

/** Something came from the service: the page is as of now. */
export function hear() {
  heard = { at: performance.now(), told: timeNow() };
}

/** For how long nothing came. */
export const silentMs = () => performance.now() - heard.at;

export function showConnection(state) {
  const place = document.getElementById("live");
  const banner = document.getElementById("banner");
  place.hidden = false;
  if (place.dataset.state !== state) {
    place.dataset.state = state;
    document.getElementById("live-text").textContent = TEXTS[state];
  }
  if (state === "lost") {
    isLost = true;
    banner.textContent = `The connection to Talus is lost. What you see is stale, from ${heard.told}; trying again by itself.`;
  } else if (state !== "wait") {
    isLost = false;
  }
  banner.hidden = !isLost;
  document.body.classList.toggle("stale", isLost);
}
