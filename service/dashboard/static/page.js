// Keeps an open page up to date: listens to the study's events, or asks now and then, and fetches what changed.

import { drawCharts, startCharts } from "./charts.js";
import { localise } from "./clock.js";
import { hear, showConnection, silentMs } from "./connection.js";
import { listenToControls } from "./controls.js";
import { applyParts, applyProgress } from "./parts.js";

const EVENTS = [
  "study_created", "study_paused", "study_resumed", "budget_extended", "study_stopping", "study_goes_on",
  "study_finished", "report_written",
  "design_proposed", "design_started", "design_returned", "design_finished",
];
const GATHER_MS = 120; // events come in bursts: one question for all of them
const RETRY_MS = 4000;
const ANSWER_MS = 15000; // an answer that takes longer does not come
const SILENCE_MS = 30000; // a stream may be dead without a word: after this long the parts are asked for
const PATIENCE_MS = 2500; // a reconnection shorter than this is not worth a word

const settings = document.body.dataset;
let cursor = Number(settings.cursor ?? 0);
let heard = cursor;
let isOver = "over" in settings;
let stream = null;
let asking = false;
let askAgain = false;
let gathering = null;
let worry = null;

async function fetchParts() {
  const address = new URL(settings.parts, window.location.href);
  if (settings.events) {
    address.searchParams.set("after", cursor);
  }
  const answer = await fetch(address, { headers: { Accept: "application/json" }, signal: AbortSignal.timeout(ANSWER_MS) });
  if (!answer.ok) {
    throw new Error(`${answer.status} from ${address.pathname}`);
  }
  return answer.json();
}

async function refresh() {
  gathering = null;
  if (asking) {
    askAgain = true;
    return;
  }
  asking = true;
  try {
    const answer = await fetchParts();
    hear();
    cursor = Math.max(cursor, answer.cursor);
    applyParts(answer);
    document.dispatchEvent(new CustomEvent("talus:parts", { detail: answer }));
    if (answer.charts) {
      drawCharts(answer.charts);
      document.dispatchEvent(new CustomEvent("talus:charts", { detail: answer.charts }));
    }
    isOver = answer.is_over;
    settle();
  } catch {
    showConnection("lost");
    gathering ??= setTimeout(refresh, RETRY_MS);
  } finally {
    asking = false;
    if (askAgain || (!isOver && heard > cursor)) {
      askAgain = false;
      soon();
    }
  }
}

function soon() {
  gathering ??= setTimeout(refresh, GATHER_MS);
}

function settle() {
  if (isOver) {
    stream?.close();
    clearTimeout(worry);
    showConnection("over");
  } else if (!stream || stream.readyState === EventSource.OPEN) {
    showConnection("live");
  }
}

function onEvent(event) {
  hear();
  const id = Number(event.lastEventId);
  heard = Math.max(heard, id);
  if (id > cursor) {
    soon();
  }
}

function onProgress(event) {
  hear();
  const told = JSON.parse(event.data);
  const isOurs = !settings.number || Number(settings.number) === told.number;
  if (isOurs && !applyProgress(told) && !isOver) {
    soon();
  }
}

function listen() {
  // The browser reconnects by itself and names the last event it had. A new stream tells all of them again;
  // those up to the cursor are known already.
  stream = new EventSource(settings.events);
  stream.onopen = () => {
    clearTimeout(worry);
    worry = null;
    showConnection("live");
  };
  stream.onerror = () => {
    if (isOver) {
      stream.close();
      return;
    }
    worry ??= setTimeout(() => showConnection("lost"), PATIENCE_MS);
    if (stream.readyState === EventSource.CLOSED) {
      // Refused, or all is told: the parts say which.
      setTimeout(() => refresh().then(() => isOver || listen()), RETRY_MS);
    }
  };
  for (const kind of EVENTS) {
    stream.addEventListener(kind, onEvent);
  }
  stream.addEventListener("progress", onProgress);
}

function watch() {
  setInterval(() => !isOver && silentMs() > SILENCE_MS && soon(), SILENCE_MS / 3);
}

function poll(seconds) {
  showConnection("live");
  setInterval(() => !isOver && document.visibilityState === "visible" && soon(), 1000 * seconds);
}

localise();
startCharts();
listenToControls(soon);
if (isOver) {
  showConnection("over");
} else if (settings.events) {
  showConnection("wait");
  listen();
  watch();
} else if (settings.pollSeconds) {
  poll(Number(settings.pollSeconds));
}
