// A form that starts work: builds the request that a program would send, asks what it would cost, prints it as curl
// and Python, and sends it once, however often the button is pressed.

const form = document.getElementById("start");
const { post, estimate, call, first } = form.dataset;
const isUpload = !first;
const fields = [...form.querySelectorAll(".field")].map((box) => ({
  box,
  path: box.dataset.path,
  kind: box.dataset.kind,
  input: box.querySelector("input, select"),
  names: [box.dataset.path, ...box.dataset.refused.split(" ").filter(Boolean)],
}));
const find = (id) => document.getElementById(id);
const button = find("go");
const QUIET_MS = 500; // between the last key and the question for the cost
const BUSY = 503;
const MOST_TRIES = 4; // of one request that finds the service busy

let files = {};
let asked = 0;
let sent = { text: null, key: null };

// Table names have points in them; all other names have none.
const steps = (path) => (path.startsWith("tables.") ? ["tables", path.slice(7)] : path.split("."));

function valueOf({ path, kind, input }) {
  const text = input.value.trim();
  if (kind === "switch") {
    return input.checked;
  }
  if (kind === "file") {
    return files[path];
  }
  if (text === "") {
    return undefined;
  }
  if (kind === "wholes") {
    return text.split(/[\s,;]+/).filter(Boolean).map(numberOf);
  }
  return kind === "number" || kind === "whole" || path === "data_set" ? numberOf(text) : text;
}

/** What is no number goes as it is: the API says what it wants instead. */
function numberOf(text) {
  const value = Number(text.replace("−", "-").replace(",", "."));
  return Number.isFinite(value) ? value : text;
}

function put(body, path, value) {
  const names = steps(path);
  let place = body;
  names.slice(0, -1).forEach((name, k) => {
    place[name] ??= /^\d+$/.test(names[k + 1]) ? [] : {};
    place = place[name];
  });
  place[names.at(-1)] = value;
}

/** The request. Where one range is given, all searched parameters are named: the others keep their default. */
function bodyOf() {
  const body = {};
  for (const field of fields) {
    const value = valueOf(field);
    const isDefault = field.kind === "switch" ? value === field.input.defaultChecked : value === undefined;
    if (!isDefault) {
      put(body, field.path, value);
    }
  }
  if (body.variables) {
    for (const { path } of fields.filter((field) => field.path.startsWith("variables."))) {
      body.variables[steps(path)[1]] ??= {};
    }
  }
  const window = body.objective?.window_deg;
  if (window) {
    body.objective.window_deg = [window[0] ?? null, window[1] ?? null];
  }
  return body;
}

function python(value, indent = "") {
  if (value === null || typeof value === "boolean") {
    return { null: "None", true: "True", false: "False" }[String(value)];
  }
  if (Array.isArray(value)) {
    return `[${value.map((item) => python(item)).join(", ")}]`;
  }
  if (typeof value === "object") {
    const rows = Object.entries(value).map(([key, item]) => `${indent}    ${JSON.stringify(key)}: ${python(item, `${indent}    `)},`);
    return rows.length ? `{\n${rows.join("\n")}\n${indent}}` : "{}";
  }
  return JSON.stringify(value);
}

const quoted = (text) => `'${text.replaceAll("'", "'\\''")}'`;

function printUpload(body) {
  const names = Object.keys(body.tables ?? {});
  const shown = names.length ? names : ["conditions.csv", "observations.csv"];
  const raw = shown.map((name, k) => `--rawfile t${k} ${name}`).join(" ");
  const made = `{name: $name, tables: {${shown.map((name, k) => `"${name}": $t${k}`).join(", ")}}}`;
  const name = body.name ?? "my piles";
  find("curl").textContent = `jq -n --arg name ${quoted(name)} ${raw} \\\n  ${quoted(made)} |\ncurl -X POST ${window.location.origin}${post} \\\n  -H 'Content-Type: application/json' -d @-`;
  find("python").textContent = `from pathlib import Path\nfrom service.client.notebook import Talus\n\nnames = ${python(shown)}\nwith Talus(${python(window.location.origin)}) as talus:\n    answer = talus.${call}(${python(name)}, {name: Path(name).read_text() for name in names})`;
}

function print(body) {
  if (isUpload) {
    printUpload(body);
    return;
  }
  find("curl").textContent = `curl -X POST ${window.location.origin}${post} \\\n  -H 'Content-Type: application/json' \\\n  -d ${quoted(JSON.stringify(body))}`;
  const named = Object.entries(body).filter(([name]) => name !== first).map(([name, value]) => `${name}=${python(value, "        ")}`);
  const given = [python(body[first] ?? null), ...named].map((text) => `\n        ${text},`).join("");
  find("python").textContent = `from service.client.notebook import Talus\n\nwith Talus(${python(window.location.origin)}) as talus:\n    started = talus.${call}(${given}\n    )\n    print(started)`;
}

/** Asked again while the service is busy, when it says: an estimate stores nothing, and a start has its key. */
async function send(path, body, headers = {}, isWanted = () => true) {
  for (let tries = 1; ; tries += 1) {
    const answer = await fetch(path, {
      method: "POST",
      headers: { "Content-Type": "application/json", Accept: "application/json", ...headers },
      body: JSON.stringify(body),
    });
    const pause = 1000 * Number(answer.headers.get("Retry-After"));
    if (answer.status !== BUSY || !pause || tries === MOST_TRIES || !isWanted()) {
      return answer;
    }
    await new Promise((resolve) => setTimeout(resolve, pause));
  }
}

function clearRefusals() {
  for (const { box, input } of fields) {
    box.querySelector(".refused").hidden = true;
    input.removeAttribute("aria-invalid");
  }
  find("refused").hidden = true;
}

/** The field that a refusal speaks of: the one of that name, else the one whose name it goes on from. */
function fieldOf(name) {
  const starts = (own) => name === own || name.startsWith(`${own}.`) || name.startsWith(`${own}[`);
  const rank = (field) => Math.max(0, ...field.names.filter(starts).map((own) => own.length));
  const best = [...fields].sort((a, b) => rank(b) - rank(a))[0];
  return best && rank(best) > 0 ? best : null;
}

function showRefusal(problem) {
  const rest = [];
  for (const one of problem.errors ?? []) {
    const field = fieldOf(one.field);
    const words = one.allowed === "required" ? "This is needed." : `Allowed is ${one.allowed}.`;
    if (field === null) {
      rest.push(`${one.field}: ${words}`);
      continue;
    }
    const place = field.box.querySelector(".refused");
    const where = one.field.startsWith("tables.") ? `${one.field.slice(7)}: got ${JSON.stringify(one.value)}. ` : "";
    place.textContent = (place.hidden ? "" : `${place.textContent} `) + where + words;
    place.hidden = false;
    field.input.setAttribute("aria-invalid", "true");
    field.box.closest("details")?.setAttribute("open", "");
  }
  if (!problem.errors?.length || rest.length) {
    find("refused").textContent = rest.join(" ") || problem.detail;
    find("refused").hidden = false;
  }
}

async function askCost(body) {
  const own = (asked += 1);
  find("cost").textContent = "…";
  try {
    const answer = await send(estimate, body, {}, () => own === asked);
    const told = await answer.json();
    if (own !== asked) {
      return; // another one was asked since
    }
    clearRefusals();
    const why = answer.status === BUSY ? told.detail : "Not known until every field is right.";
    find("cost").textContent = answer.ok ? told.text : why;
    button.disabled = false;
    if (!answer.ok && answer.status !== BUSY) {
      showRefusal(told);
    }
  } catch {
    find("cost").textContent = "The service does not answer.";
  }
}

/** Random bytes, because crypto.randomUUID is there on secure origins alone. */
function newKey() {
  return [...crypto.getRandomValues(new Uint8Array(16))].map((byte) => byte.toString(16).padStart(2, "0")).join("");
}

async function start() {
  if (button.disabled) {
    return;
  }
  const body = bodyOf();
  const text = JSON.stringify(body);
  if (sent.text !== text) {
    sent = { text, key: newKey() };
  }
  button.disabled = true;
  clearRefusals();
  try {
    const answer = await send(post, body, { "Idempotency-Key": sent.key });
    const told = await answer.json();
    if (answer.ok) {
      window.location.assign(next(answer.headers.get("Location"), told));
      return;
    }
    showRefusal(told);
    fields.find(({ input }) => input.hasAttribute("aria-invalid"))?.input.focus();
  } catch {
    find("refused").textContent = "The service does not answer. Pressing again is safe: it is the same request.";
    find("refused").hidden = false;
  }
  button.disabled = false;
}

const next = (location, told) => (isUpload ? `/new/diagnosis?data_set=${told.id}` : location.replace(/^\/v1/, ""));

async function readFiles() {
  const chosen = fields.filter(({ kind, input }) => kind === "file" && input.files.length);
  files = Object.fromEntries(await Promise.all(chosen.map(async ({ path, input }) => [path, await input.files[0].text()])));
}

let waiting = null;

async function changed() {
  await readFiles();
  const body = bodyOf();
  print(body);
  if (estimate) {
    clearTimeout(waiting);
    waiting = setTimeout(() => askCost(body), QUIET_MS);
  }
}

form.addEventListener("input", changed);
form.addEventListener("change", changed);
form.addEventListener("keydown", (event) => {
  if (event.key === "Enter" && event.target.matches("input[type=text]")) {
    start();
  }
});
button.addEventListener("click", start);
// Come back to, the page is a new wish: another start is another study.
window.addEventListener("pageshow", (event) => {
  if (event.persisted) {
    sent = { text: null, key: null };
    button.disabled = false;
  }
});
changed();
