// The values under the pointer, beside it. For the eye only: the same numbers are in the table below the charts.

let box = null;

export function showTip(event, lines) {
  box ??= document.body.appendChild(Object.assign(document.createElement("div"), { className: "tip" }));
  box.setAttribute("aria-hidden", "true");
  box.textContent = lines.join("\n");
  box.hidden = false;
  const { width, height } = box.getBoundingClientRect();
  const right = event.clientX + 16 + width > window.innerWidth;
  const x = right ? event.clientX - width - 12 : event.clientX + 16;
  box.style.left = `${Math.max(4, x)}px`;
  box.style.top = `${Math.max(4, Math.min(event.clientY + 12, window.innerHeight - height - 6))}px`;
}

export function hideTip() {
  if (box !== null) {
    box.hidden = true;
  }
}
