// Frames of a scene as they come from the service (service/scene/packing.py): unpacked, kept for a while, searched.

const MAGIC = "TLS1";
const KEPT_BYTES = 96e6;
export const UNKNOWN = 255;

function unpack(buffer) {
  const text = new TextDecoder();
  if (text.decode(buffer.slice(0, 4)) !== MAGIC) {
    throw new Error("not a frame");
  }
  const length = new DataView(buffer).getUint32(4, true);
  return { head: JSON.parse(text.decode(buffer.slice(8, 8 + length))), body: buffer.slice(8 + length) };
}

function asFrame({ head, body }) {
  const count = head.grains;
  const [places, bytes] = [new Uint16Array(body), new Uint8Array(body)];
  const positions = new Float32Array(3 * count);
  const radii = new Float32Array(count);
  const materials = new Uint8Array(count);
  const steps = head.low.map((low, k) => (head.high[k] - low) / 65535);
  const [thin, thick] = head.radius;
  for (let i = 0; i < count; i += 1) {
    for (let k = 0; k < 3; k += 1) {
      positions[3 * i + k] = head.low[k] + steps[k] * places[4 * i + k];
    }
    radii[i] = thin + ((thick - thin) * bytes[8 * i + 6]) / 255;
    materials[i] = bytes[8 * i + 7];
  }
  return { ...head, body, positions, radii, materials, columns: new Map(), bytes: body.byteLength };
}

const asWalls = ({ head, body }) => ({
  ...head,
  points: new Float32Array(body, 0, 3 * head.points),
  corners: new Uint32Array(body, 12 * head.points, 3 * head.triangles),
});

async function ask(address) {
  const answer = await fetch(address);
  if (!answer.ok) {
    const problem = await answer.json().catch(() => ({}));
    throw new Error(problem.detail ?? `${answer.status} from ${address}`);
  }
  return unpack(await answer.arrayBuffer());
}

/** Answers of a scene; the oldest go when there are too many bytes. */
export class SceneData {
  constructor(scene) {
    this.scene = scene;
    this.kept = new Map();
  }

  /** The same frames and those that came after them. */
  with(scene) {
    this.scene = scene;
    return this;
  }

  /** A frame with its walls (null where there are none). */
  async frame(k) {
    const known = this.kept.get(k);
    if (known) {
      return known;
    }
    const told = this.scene.frames[k];
    const [spheres, walls] = await Promise.all([ask(told.url), told.walls ? ask(told.walls) : null]);
    const frame = { ...asFrame(spheres), k, walls: walls && asWalls(walls) };
    this.kept.set(k, frame);
    let held = [...this.kept.values()].reduce((sum, { bytes }) => sum + bytes, 0);
    for (const [old, { bytes }] of this.kept) {
      if (held > KEPT_BYTES && old !== k) {
        this.kept.delete(old);
        held -= bytes;
      }
    }
    return frame;
  }

  /** A number of each grain in 255 levels, and what the lowest and the highest are. */
  async column(frame, name) {
    if (!frame.columns.has(name)) {
      const { head, body } = await ask(`${this.scene.frames[frame.k].url}/columns/${name}`);
      frame.columns.set(name, { range: head.range, levels: new Uint8Array(body) });
    }
    return frame.columns.get(name);
  }

  async grain(k, row) {
    const answer = await fetch(`${this.scene.frames[k].url}/grains/${row}`);
    if (!answer.ok) {
      throw new Error(`${answer.status}`);
    }
    return answer.json();
  }

  tableAddress(k) {
    return `${this.scene.frames[k].url}/table.csv`;
  }
}

/** The nearest grain that the ray meets and the cut leaves; -1: none. */
export function hitGrain({ positions, radii }, { from, direction }, isCutAway) {
  let [best, nearest] = [-1, Infinity];
  for (let i = 0; i < radii.length; i += 1) {
    const [x, y, z] = [positions[3 * i] - from[0], positions[3 * i + 1] - from[1], positions[3 * i + 2] - from[2]];
    const far = x * direction[0] + y * direction[1] + z * direction[2];
    const beside = x * x + y * y + z * z - far * far;
    const under = radii[i] * radii[i] - beside;
    if (under > 0 && far > 0) {
      const hit = far - Math.sqrt(under);
      if (hit < nearest && !isCutAway(i)) {
        [best, nearest] = [i, hit];
      }
    }
  }
  return best;
}

/** Layers of equal height with how many grains each has, their mean diameter by volume, and their share of volume. */
export function layers({ positions, radii, low, high }, count) {
  const found = Array.from({ length: count }, (_, k) => ({
    from: low[2] + ((high[2] - low[2]) * k) / count,
    to: low[2] + ((high[2] - low[2]) * (k + 1)) / count,
    grains: 0,
    volume: 0,
    moment: 0,
  }));
  const tall = high[2] - low[2] || 1;
  let whole = 0;
  for (let i = 0; i < radii.length; i += 1) {
    const place = Math.floor(((positions[3 * i + 2] - low[2]) / tall) * count);
    const layer = found[Math.max(0, Math.min(count - 1, place))];
    const volume = radii[i] ** 3;
    layer.grains += 1;
    layer.volume += volume;
    layer.moment += 2 * radii[i] * volume;
    whole += volume;
  }
  return found.map((layer) => ({ ...layer, diameter: layer.volume ? layer.moment / layer.volume : null, share: whole ? layer.volume / whole : 0 }));
}
