// Buttons that do something to a study, charge or diagnosis: each posts to the API and says what it answered.

function bodyOf(button) {
  const fields = button.closest("[data-fields]");
  const fixed = button.dataset.body ? JSON.parse(button.dataset.body) : null;
  if (!fields) {
    return fixed;
  }
  const values = {};
  for (const input of fields.querySelectorAll("input[name]")) {
    // An empty field is left out: the API then says what it needs.
    if (input.value !== "") {
      values[input.name] = input.type === "number" ? Number(input.value) : input.value;
    }
  }
  const typed = button.dataset.under ? { [button.dataset.under]: values } : values;
  return { ...typed, ...fixed };
}

function tell(button, text, isBad) {
  const place = document.getElementById("control-answer");
  if (place) {
    place.textContent = text;
    place.classList.toggle("fail", isBad);
  }
}

async function press(button, refresh) {
  if (button.dataset.sure && !window.confirm(button.dataset.sure)) {
    return;
  }
  const body = bodyOf(button);
  button.disabled = true;
  tell(button, "…", false);
  try {
    const answer = await fetch(button.dataset.post, {
      method: "POST",
      headers: { "Content-Type": "application/json", Accept: "application/json" },
      body: body === null ? undefined : JSON.stringify(body),
    });
    const told = await answer.json();
    tell(button, answer.ok ? button.dataset.done : told.detail, !answer.ok);
    refresh();
  } catch {
    tell(button, "The service does not answer.", true);
  } finally {
    button.disabled = false;
  }
}

/** `refresh` fetches the page's parts again. */
export function listenToControls(refresh) {
  document.addEventListener("click", (event) => {
    const button = event.target.closest?.("button[data-post]");
    if (button) {
      press(button, refresh);
    }
  });
}
