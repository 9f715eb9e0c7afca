// Mouse, touch and keys on a 3D view: turn, move, zoom, pick.

const TURN = Math.PI; // a drag over the whole height
const STEP = Math.PI / 24;
const SHIFT = 0.06;
const NEARER = 0.85;
const TAP_PX = 4;

const KEYS = {
  ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1],
};

export class SceneInput {
  /** `moved()`: the eye did; `tap(x, y)`: in CSS pixels of the canvas; `clear()`: nothing is picked any more. */
  constructor(canvas, camera, { moved, tap, clear }) {
    Object.assign(this, { canvas, camera, moved, tap, clear });
    this.fingers = new Map();
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.drag(event));
    canvas.addEventListener("pointerup", (event) => this.up(event));
    canvas.addEventListener("pointercancel", (event) => this.fingers.delete(event.pointerId));
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    canvas.addEventListener("keydown", (event) => this.key(event));
  }

  down(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.canvas.focus({ preventScroll: true });
    this.fingers.set(event.pointerId, { x: event.clientX, y: event.clientY, far: 0 });
  }

  drag(event) {
    const finger = this.fingers.get(event.pointerId);
    if (!finger) {
      return;
    }
    const before = this.spread();
    const [dx, dy] = [event.clientX - finger.x, event.clientY - finger.y];
    Object.assign(finger, { x: event.clientX, y: event.clientY, far: finger.far + Math.hypot(dx, dy) });
    const high = this.canvas.clientHeight;
    if (this.fingers.size > 1) {
      this.camera.zoom(before / this.spread() || 1);
      this.camera.pan(dx / high / 2, dy / high / 2);
    } else if (event.shiftKey || event.buttons & 6) {
      this.camera.pan(dx / high, dy / high);
    } else {
      this.camera.orbit((dx / high) * TURN, (dy / high) * TURN);
    }
    this.moved();
  }

  up(event) {
    const finger = this.fingers.get(event.pointerId);
    this.fingers.delete(event.pointerId);
    if (finger && finger.far < TAP_PX && event.button === 0) {
      this.tap(event.offsetX, event.offsetY);
    }
  }

  /** How far two fingers are apart. */
  spread() {
    const [a, b] = [...this.fingers.values()];
    return b ? Math.hypot(a.x - b.x, a.y - b.y) : 1;
  }

  /** Only where the view has the focus, or with ctrl: the page must scroll past it. */
  wheel(event) {
    if (document.activeElement !== this.canvas && !event.ctrlKey) {
      return;
    }
    event.preventDefault();
    this.camera.zoom(Math.exp(Math.max(-60, Math.min(60, event.deltaY)) * 0.004));
    this.moved();
  }

  key(event) {
    const { camera } = this;
    const arrow = KEYS[event.key];
    if (event.altKey || event.ctrlKey || event.metaKey) {
      return;
    }
    if (arrow && event.shiftKey) {
      camera.pan(arrow[0] * SHIFT, -arrow[1] * SHIFT);
    } else if (arrow) {
      camera.orbit(arrow[0] * STEP, arrow[1] * STEP);
    } else if (event.key === "+" || event.key === "=") {
      camera.zoom(NEARER);
    } else if (event.key === "-") {
      camera.zoom(1 / NEARER);
    } else if (event.key === "0" || event.key === "Home") {
      camera.reset();
    } else if (event.key === "Enter" || event.key === " ") {
      this.tap(this.canvas.clientWidth / 2, this.canvas.clientHeight / 2);
    } else if (event.key === "Escape") {
      this.clear();
    } else {
      return;
    }
    event.preventDefault();
    this.moved();
  }
}
