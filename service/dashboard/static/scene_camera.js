// The eye of a 3D view: it goes around a point, nearer and farther, and moves that point. z is up; SI units.

const FIELD = (32 * Math.PI) / 180; // angle of view from top to bottom
const STEEPEST = (89 * Math.PI) / 180;
const CLOSE = 0.82; // a heap is flatter than the ball around it
const NEAREST = 0.02; // of the scene's radius
const FARTHEST = 20;

const cross = ([a, b, c], [d, e, f]) => [b * f - c * e, c * d - a * f, a * e - b * d];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const along = (from, direction, far) => from.map((value, k) => value + far * direction[k]);

export class Camera {
  constructor() {
    this.home = { target: [0, 0, 0], radius: 1 };
    this.reset();
  }

  /** Looks at the box from `low` to `high` as a whole. */
  frame(low, high) {
    const target = low.map((value, k) => (value + high[k]) / 2);
    this.home = { target, radius: Math.max(1e-6, Math.hypot(...low.map((value, k) => high[k] - value)) / 2) };
    this.reset();
  }

  reset() {
    this.azimuth = -Math.PI / 3;
    this.elevation = Math.PI / 7.5;
    this.target = [...this.home.target];
    this.distance = (CLOSE * this.home.radius) / Math.sin(FIELD / 2);
  }

  orbit(across, up) {
    this.azimuth -= across;
    this.elevation = Math.max(-STEEPEST, Math.min(STEEPEST, this.elevation + up));
  }

  zoom(factor) {
    const { radius } = this.home;
    this.distance = Math.max(NEAREST * radius, Math.min(FARTHEST * radius, this.distance * factor));
  }

  /** Shares of the picture's height. */
  pan(across, up) {
    const span = 2 * this.distance * Math.tan(FIELD / 2);
    const { right, above } = this.axes();
    this.target = along(along(this.target, right, -across * span), above, up * span);
  }

  /** What another view needs to look at its own scene alike. */
  get pose() {
    const { radius, target } = this.home;
    return {
      azimuth: this.azimuth,
      elevation: this.elevation,
      distance: this.distance / radius,
      away: this.target.map((value, k) => (value - target[k]) / radius),
    };
  }

  set pose({ azimuth, elevation, distance, away }) {
    const { radius, target } = this.home;
    Object.assign(this, { azimuth, elevation, distance: distance * radius });
    this.target = along(target, away, radius);
  }

  axes() {
    const [a, e] = [this.azimuth, this.elevation];
    const back = [Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)];
    const right = [-Math.sin(a), Math.cos(a), 0];
    return { back, right, above: cross(back, right) };
  }

  get eye() {
    return along(this.target, this.axes().back, this.distance);
  }

  /** Column by column, as WebGL takes them. */
  matrices(aspect) {
    const { back, right, above } = this.axes();
    const { eye } = this;
    const view = [
      right[0], above[0], back[0], 0, right[1], above[1], back[1], 0, right[2], above[2], back[2], 0,
      -dot(right, eye), -dot(above, eye), -dot(back, eye), 1,
    ];
    const reach = this.distance + 8 * this.home.radius;
    const [near, far] = [Math.max(reach * 1e-3, this.distance - 6 * this.home.radius), reach];
    const tall = 1 / Math.tan(FIELD / 2);
    // A narrow picture shows as much across as a wide one shows upright.
    const scale = Math.min(1, aspect);
    const projection = [
      (tall * scale) / aspect, 0, 0, 0, 0, tall * scale, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0,
    ];
    return { view, projection };
  }

  /** The ray through a place of the picture: x and y from -1 to 1, y upwards. */
  ray(x, y, aspect) {
    const { back, right, above } = this.axes();
    const span = Math.tan(FIELD / 2) / Math.min(1, aspect);
    const direction = along(along(back.map((value) => -value), right, x * span * aspect), above, y * span);
    const length = Math.hypot(...direction);
    return { from: this.eye, direction: direction.map((value) => value / length) };
  }
}
