// The 3D views of a page: every [data-scene] becomes one, as soon as its run has left grains to show.

import { timeNow } from "./clock.js";
import { Camera } from "./scene_camera.js";
import { drawLegend, paint, tellLegend } from "./scene_colours.js";
import { hitGrain, layers, SceneData } from "./scene_data.js";
import { describeGrain } from "./scene_grain.js";
import { NO_CUT, SceneRenderer } from "./scene_gl.js";
import { SceneInput } from "./scene_input.js";
import { sceneAsPng } from "./scene_picture.js";
import { tell, withUnit } from "./svg.js";
import { onThemeChange } from "./theme.js";

const SLOW_MS = 70; // a drawing that takes longer is made coarser while it moves, so as to take this
const COARSEST = 0.3;
const STILL_MS = 180;
const PLAY_MS = { full: 250, reduced: 1000 };
const LAYERS = 8;
const MESH_ROOM = 1.25; // a heap fills its picture, a part of a plant stands free in it
const WALL_LIGHT = [0.36, 0.42, 0.5];
const WALL_DARK = [0.62, 0.7, 0.8];
const AXES = ["x", "y", "z"];

const dark = window.matchMedia("(prefers-color-scheme: dark)");
const calm = window.matchMedia("(prefers-reduced-motion: reduce)");

class SceneView {
  constructor(root) {
    this.root = root;
    this.find = (name) => root.querySelector(`[data-part="${name}"]`);
    this.camera = new Camera();
    this.picked = -1;
    this.cut = NO_CUT;
    this.coarse = 1;
    this.frame = null;
    this.wanted = 0;
  }

  say(text, isBad = false) {
    const line = this.find("state");
    line.textContent = text;
    line.hidden = text === "";
    line.classList.toggle("fail", isBad);
    this.find("again").hidden = !isBad;
  }

  async load() {
    this.loading = true;
    if (!this.frame) {
      this.say("Loading the grains …");
    }
    try {
      const answer = await fetch(this.root.dataset.scene, { headers: { Accept: "application/json" } });
      if (!answer.ok) {
        throw new Error((await answer.json().catch(() => ({}))).detail ?? `the service answered ${answer.status}`);
      }
      await this.take(await answer.json());
    } catch (error) {
      this.say(`The grains could not be loaded: ${error.message}.`, true);
    } finally {
      this.loading = false;
    }
  }

  get isWaiting() {
    return !this.frame && this.scene?.state === "waiting";
  }

  /** Whether there is more to see than what is shown; `told` is what the page's parts say. */
  isBehind(told) {
    const isGrowing = Boolean(this.scene?.is_growing);
    const hasEnded = ((this.isWaiting || isGrowing) && told.has_scene) || (isGrowing && told.scene_size === 0);
    return !this.loading && (hasEnded || (told.scene_size > 0 && told.scene_size !== this.size));
  }

  /** What there is to draw now: at first, a frame more of a run under way, or the files that it left. */
  async take(scene) {
    const old = this.scene;
    this.scene = scene;
    if (scene.state !== "ready") {
      const isTold = "quiet" in this.root.dataset && ["waiting", "none"].includes(scene.state);
      this.say(isTold ? "" : scene.says);
      this.find("body").hidden = true;
      return;
    }
    const goesOn = Boolean(old?.is_growing && scene.is_growing && old.frames.length <= scene.frames.length);
    // Who plays, looks back or looks at a grain is left there.
    const isNewest = !this.frame || !goesOn || (this.frame.k === old.frames.length - 1 && this.picked < 0);
    this.data = goesOn && this.data ? this.data.with(scene) : new SceneData(scene);
    await this.begin(isNewest && !this.playing ? scene.frames.length - 1 : this.frame.k);
    this.say(scene.says);
  }

  async begin(k) {
    const isFirst = !this.canvas;
    this.canvas = this.find("canvas");
    this.renderer ??= SceneRenderer.open(this.canvas);
    this.reference = await this.data.frame(this.scene.frames.length - 1);
    this.fillControls();
    this.fillNotes();
    this.find("body").hidden = false;
    if (!this.renderer) {
      this.find("picture").hidden = true;
      this.find("no-gl").hidden = false;
    } else if (isFirst) {
      this.aim();
      this.listen();
      this.root.closest("section")?.classList.add("has-scene");
    }
    await this.show(k);
  }

  /** At the grains; while they still come, at where they go; at a mesh. */
  aim() {
    const { reference } = this;
    const { is_growing: isGrowing, is_mesh: isMesh } = this.scene;
    const box = (isGrowing || isMesh) && reference.walls?.triangles ? reference.walls : reference;
    this.camera.frame(box.low, box.high);
    if (isMesh) {
      this.camera.zoom(MESH_ROOM);
    }
  }

  /** Frame `k`; of several that are asked for at once, the last. */
  async show(k) {
    const own = (this.wanted += 1);
    const frame = await this.data.frame(k);
    const colour = this.scene.colours[Number(this.find("colour").value)];
    const painted = await paint(colour, frame, this.reference, this.data);
    if (own !== this.wanted) {
      return;
    }
    if (frame.k !== this.frame?.k) {
      this.pick(-1);
    }
    Object.assign(this, { frame, colour, painted });
    this.find("time").value = k;
    this.find("time").setAttribute("aria-valuetext", this.when());
    this.find("when").textContent = this.when();
    this.find("csv").href = this.data.tableAddress(k);
    this.find("csv").download = `talus-${this.root.dataset.name}-${k}.csv`;
    this.upload();
    this.tellFrame();
  }

  when() {
    const { time_s: time, radii } = this.frame;
    if (this.scene.is_mesh) {
      return `${tell(this.frame.walls.triangles)} triangles`;
    }
    const grains = `${radii.length.toLocaleString("en").replaceAll(",", "\u202f")} grains`;
    return this.scene.frames.length > 1 ? `${withUnit(time, "s", 4)}, ${grains}` : grains;
  }

  upload() {
    this.renderer?.setFrame(this.frame);
    this.renderer?.setColours(this.painted);
    this.setCut();
    this.redraw();
  }

  fillControls() {
    const { frames, colours } = this.scene;
    const before = this.find("colour").selectedOptions[0]?.label;
    this.find("colour").replaceChildren(...colours.map(({ label, unit }, k) => new Option(unit ? `${label}, ${unit}` : label, k)));
    const chosen = [...this.find("colour").options].find(({ label }) => label === before);
    if (chosen) {
      chosen.selected = true;
    }
    this.root.classList.toggle("scene-mesh", this.scene.is_mesh);
    this.find("timeline").hidden = frames.length < 2;
    this.find("time").max = frames.length - 1;
    this.find("walls").closest("label").hidden = !frames.some(({ walls }) => walls);
  }

  fillNotes() {
    const { missing, note } = this.scene;
    const reasons = new Map();
    for (const { label, why } of missing) {
      reasons.set(why, [...(reasons.get(why) ?? []), label]);
    }
    const lines = [note, ...[...reasons].map(([why, labels]) => `Not stored: ${labels.join(", ")} (${why}).`)].filter(Boolean);
    this.find("notes").replaceChildren(...lines.map((line) => Object.assign(document.createElement("li"), { textContent: line })));
  }

  listen() {
    new SceneInput(this.canvas, this.camera, {
      moved: () => this.moved(),
      tap: (x, y) => this.pickAt(x, y),
      clear: () => this.pick(-1),
    });
    const on = (name, kind, act) => this.find(name).addEventListener(kind, act);
    on("colour", "change", () => this.show(this.frame.k));
    on("axis", "change", () => this.changeCut());
    on("depth", "input", () => this.changeCut());
    on("flip", "change", () => this.changeCut());
    on("walls", "change", () => this.redraw());
    on("home", "click", () => {
      this.camera.reset();
      this.moved();
    });
    on("png", "click", () => this.savePng());
    on("time", "input", () => this.show(Number(this.find("time").value)).catch((error) => this.lost(error)));
    on("play", "click", () => (this.playing ? this.stop() : this.play()));
    new ResizeObserver(() => this.redraw()).observe(this.canvas);
    onThemeChange(() => this.redraw());
    this.canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      this.say("The graphics card let the picture go; it is drawn again when it comes back.");
    });
    this.canvas.addEventListener("webglcontextrestored", () => {
      this.renderer.build();
      this.upload();
      this.say("");
    });
  }

  lost(error) {
    this.stop();
    this.say(`This frame could not be loaded (${timeNow()}): ${error.message}. What is shown is an earlier one.`, true);
  }

  async play() {
    this.playing = true;
    this.find("play").textContent = "Pause";
    const last = () => this.scene.frames.length - 1;
    let k = this.frame.k >= last() ? 0 : this.frame.k + 1;
    try {
      while (this.playing && k <= last()) {
        const pause = new Promise((resolve) => setTimeout(resolve, calm.matches ? PLAY_MS.reduced : PLAY_MS.full));
        await this.show(k);
        k += 1;
        // The next one is on its way while this one is looked at.
        await Promise.all([pause, k <= last() ? this.data.frame(k) : null]);
      }
      this.stop();
    } catch (error) {
      this.lost(error);
    }
  }

  stop() {
    this.playing = false;
    this.find("play").textContent = "Play";
  }

  changeCut() {
    this.setCut();
    this.redraw();
  }

  /** From the controls: half of the space is left out, by whole grains. */
  setCut() {
    const axis = AXES.indexOf(this.find("axis").value);
    const depth = this.find("depth");
    this.find("cut-more").hidden = axis < 0;
    if (axis < 0) {
      this.cut = NO_CUT;
      return;
    }
    const [low, high] = [this.reference.low[axis], this.reference.high[axis]];
    const at = low + (Number(depth.value) / 100) * (high - low);
    const sign = this.find("flip").checked ? -1 : 1;
    this.cut = [...[0, 1, 2].map((k) => (k === axis ? sign : 0)), sign * at];
    const words = `${AXES[axis]} ${sign > 0 ? "≤" : "≥"} ${withUnit(at, "m")}`;
    this.find("cut-at").textContent = words;
    depth.setAttribute("aria-valuetext", words);
  }

  isCutAway(i) {
    const [a, b, c, w] = this.cut;
    const p = this.frame.positions;
    return a * p[3 * i] + b * p[3 * i + 1] + c * p[3 * i + 2] > w;
  }

  moved() {
    this.redraw(true);
    if (this.root.dataset.sync) {
      document.dispatchEvent(new CustomEvent("talus:pose", { detail: { from: this, group: this.root.dataset.sync, pose: this.camera.pose } }));
    }
  }

  follow({ from, group, pose }) {
    if (from !== this && group === this.root.dataset.sync && this.frame && this.renderer) {
      this.camera.pose = pose;
      this.redraw(true);
    }
  }

  /** On the next screen refresh; `isMoving`: coarser where that is slow, and fine when it rests. */
  redraw(isMoving = false) {
    clearTimeout(this.resting);
    if (isMoving) {
      this.resting = setTimeout(() => this.redraw(), STILL_MS);
    }
    this.coming ??= requestAnimationFrame(() => {
      this.coming = null;
      this.draw((isMoving ? this.coarse : 1) * Math.min(2, window.devicePixelRatio));
    });
  }

  draw(scale) {
    if (!this.renderer || !this.frame || !this.canvas.clientWidth) {
      return;
    }
    this.renderer.draw(this.camera, {
      width: Math.max(1, Math.round(this.canvas.clientWidth * scale)),
      height: Math.max(1, Math.round(this.canvas.clientHeight * scale)),
      cut: this.cut,
      picked: this.picked,
      showWalls: this.find("walls").checked,
      wallColour: dark.matches ? WALL_DARK : WALL_LIGHT,
    });
    if (scale >= 1) {
      this.time();
    }
    this.drawLegend();
    this.root.dataset.drawn = String(this.frame.k);
  }

  async time() {
    this.drawnIn = await this.renderer.duration();
    this.coarse = Math.max(COARSEST, Math.min(1, Math.sqrt(SLOW_MS / this.drawnIn)));
    this.root.dataset.drawnMs = String(Math.round(this.drawnIn));
  }

  drawLegend() {
    const legend = this.find("legend");
    const scale = Math.max(1, window.devicePixelRatio);
    const [width, height] = [legend.clientWidth, legend.clientHeight];
    [legend.width, legend.height] = [width * scale, height * scale];
    const context = legend.getContext("2d");
    context.scale(scale, scale);
    drawLegend(context, this.colour, this.painted, { x: 2, y: 0, high: height, ink: getComputedStyle(this.root).color, font: 12 });
  }

  tellFrame() {
    const { frame } = this;
    const [thin, thick] = frame.radius.map((radius) => 2000 * radius);
    const sizes = frame.radii.length === 0 ? "." : `, ${tell(thin)} to ${withUnit(thick, "mm")} across, centres between ${withUnit(frame.low[2], "m")} and ${withUnit(frame.high[2], "m")} high. ${tellLegend(this.colour, this.painted)}`;
    const words = `${this.scene.title}: ${this.when()}${sizes}`;
    this.find("words").textContent = this.colour.note ? `${words} Here that is ${this.colour.note}.` : words;
    this.canvas.setAttribute("aria-label", `3D view. ${this.scene.title}, ${this.when()}. Arrows turn, shift and arrows move, plus and minus zoom, 0 resets, Enter picks the grain in the middle.`);
    this.find("layers").replaceChildren(
      ...layers(frame, LAYERS).reverse().map((layer) => {
        const row = document.createElement("tr");
        const head = Object.assign(document.createElement("th"), { scope: "row", textContent: `${tell(layer.from)} to ${withUnit(layer.to, "m")}` });
        const cells = [String(layer.grains), layer.diameter === null ? "–" : withUnit(1000 * layer.diameter, "mm"), `${(100 * layer.share).toFixed(1)}\u202f%`];
        row.append(head, ...cells.map((textContent) => Object.assign(document.createElement("td"), { textContent, className: "num nums" })));
        return row;
      }),
    );
  }

  pickAt(x, y) {
    const { clientWidth: wide, clientHeight: high } = this.canvas;
    const ray = this.camera.ray((2 * x) / wide - 1, 1 - (2 * y) / high, wide / high);
    this.pick(hitGrain(this.frame, ray, (i) => this.isCutAway(i)));
  }

  async pick(row) {
    this.picked = row;
    const box = this.find("picked");
    box.hidden = row < 0;
    if (row < 0) {
      this.redraw();
      return;
    }
    this.redraw();
    const told = this.find("picked-told");
    told.textContent = "…";
    try {
      const grain = await this.data.grain(this.frame.k, row);
      if (this.picked === row) {
        told.replaceChildren(...describeGrain(grain, this.frame, this.scene.materials));
      }
    } catch {
      told.textContent = "The service does not answer; the grain is marked, its numbers are not known.";
    }
  }

  savePng() {
    this.draw(Math.max(2, window.devicePixelRatio));
    sceneAsPng(this);
    this.redraw();
  }
}

const views = [...document.querySelectorAll("[data-scene]")].map((root) => new SceneView(root));
for (const view of views) {
  view.find("again").addEventListener("click", () => view.load());
  view.load();
}
document.addEventListener("talus:pose", ({ detail }) => views.forEach((view) => view.follow(detail)));
document.addEventListener("talus:parts", ({ detail }) => {
  for (const view of views.filter((one) => one.isBehind(detail))) {
    view.size = detail.scene_size;
    view.load();
  }
});
