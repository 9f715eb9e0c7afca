// Draws spheres and walls with WebGL2. A sphere is a square that the fragment shader makes round: it meets the ray
// of each pixel with the sphere, so that shape, shade and depth are exact however near the eye is.
//
// The 8 bytes of a sphere are a texel of 4 x 16 bits, which its six corners look up by their number. Instances would
// do without the look-up, but a software renderer takes each for a drawing of its own: ten times slower.

const WIDTH = 2048; // texels a row, which every WebGL2 allows

const SPHERE_VERTEX = `#version 300 es
precision highp usampler2D;
uniform usampler2D rows;              // place in the box (xyz), radius in its low byte (w)
uniform usampler2D values;            // row of the palette
uniform mat4 view, projection;
uniform vec3 low, span;
uniform vec2 radii;
uniform vec4 cut;                     // what lies beyond dot(p, xyz) = w is left out
uniform int picked;
uniform sampler2D palette;
out vec3 ray;
flat out vec3 centre;
flat out float radius;
flat out vec3 colour;
void main() {
  int i = gl_VertexID / 6;
  ivec2 at = ivec2(i % ${WIDTH}, i / ${WIDTH});
  uvec4 row = texelFetch(rows, at, 0);
  vec3 world = low + vec3(row.xyz) / 65535.0 * span;
  vec3 c = (view * vec4(world, 1.0)).xyz;
  radius = mix(radii.x, radii.y, float(row.w & 255u) / 255.0);
  centre = c;
  colour = texelFetch(palette, ivec2(texelFetch(values, at, 0).r, 0), 0).rgb;
  if (i == picked) colour = vec3(1.0, 0.15, 0.75);
  float far = length(c);
  if (dot(world, cut.xyz) > cut.w || far <= radius * 1.001) {
    ray = vec3(0.0);
    gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
    return;
  }
  vec3 ahead = c / far;
  vec3 right = normalize(cross(ahead, abs(ahead.y) < 0.99 ? vec3(0.0, 1.0, 0.0) : vec3(1.0, 0.0, 0.0)));
  vec3 above = cross(right, ahead);
  // The cone around the sphere meets the plane through its centre in a circle that is larger than the sphere.
  float reach = radius * far / sqrt(far * far - radius * radius);
  int k = gl_VertexID % 6;
  k = k < 3 ? k : 6 - k;              // 0 1 2, 3 2 1: two triangles
  vec2 corner = vec2(k & 1, k >> 1) * 2.0 - 1.0;
  ray = c + (right * corner.x + above * corner.y) * reach;
  gl_Position = projection * vec4(ray, 1.0);
}`;

const SPHERE_FRAGMENT = `#version 300 es
precision highp float;
in vec3 ray;
flat in vec3 centre;
flat in float radius;
flat in vec3 colour;
uniform mat4 projection;
out vec4 pixel;
void main() {
  vec3 direction = normalize(ray);
  float nearest = dot(direction, centre);
  vec3 beside = centre - nearest * direction;
  float under = radius * radius - dot(beside, beside);
  if (under <= 0.0) discard;
  vec3 hit = (nearest - sqrt(under)) * direction;
  vec3 normal = (hit - centre) / radius;
  vec4 clip = projection * vec4(hit, 1.0);
  gl_FragDepth = 0.5 * clip.z / clip.w + 0.5;
  float lit = 0.32 + 0.62 * max(dot(normal, vec3(0.36, 0.72, 0.59)), 0.0) + 0.16 * normal.z;
  float shine = pow(max(dot(normal, vec3(0.2, 0.55, 0.81)), 0.0), 24.0);
  float edge = mix(0.55, 1.0, smoothstep(0.0, 0.45, dot(normal, -direction)));
  pixel = vec4(colour * lit * edge + 0.14 * shine, 1.0);
}`;

const WALL_VERTEX = `#version 300 es
layout(location = 0) in vec3 place;
uniform mat4 view, projection;
uniform vec4 cut;
out vec3 seen;
out float beyond;
void main() {
  seen = (view * vec4(place, 1.0)).xyz;
  beyond = dot(place, cut.xyz) - cut.w;
  gl_Position = projection * vec4(seen, 1.0);
}`;

// Glass is fainter where it is looked at squarely, so that its outline stands out.
const WALL_FRAGMENT = `#version 300 es
precision highp float;
in vec3 seen;
in float beyond;
uniform vec3 colour;
uniform float solid;
out vec4 pixel;
void main() {
  if (beyond > 0.0) discard;
  vec3 normal = normalize(cross(dFdx(seen), dFdy(seen)));
  float facing = abs(dot(normal, normalize(seen)));
  float lit = 0.55 + 0.45 * abs(dot(normal, vec3(0.36, 0.72, 0.59)));
  float opacity = mix(0.07 + 0.3 * pow(1.0 - facing, 3.0), 1.0, solid);
  pixel = vec4(colour * lit * opacity, opacity);
}`;

const [ROWS, VALUES, PALETTE] = [0, 1, 2]; // texture units

export const NO_CUT = [0, 0, 0, 1];

function compile(gl, kind, source) {
  const shader = gl.createShader(kind);
  gl.shaderSource(shader, source);
  gl.compileShader(shader);
  return shader;
}

function link(gl, vertex, fragment) {
  const program = gl.createProgram();
  gl.attachShader(program, compile(gl, gl.VERTEX_SHADER, vertex));
  gl.attachShader(program, compile(gl, gl.FRAGMENT_SHADER, fragment));
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
    throw new Error(gl.getProgramInfoLog(program) || "the shaders do not link");
  }
  const uniforms = {};
  for (let k = 0; k < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); k += 1) {
    const { name } = gl.getActiveUniform(program, k);
    uniforms[name] = gl.getUniformLocation(program, name);
  }
  return { program, uniforms };
}

export class SceneRenderer {
  /** Null where the browser or the machine has no WebGL2. */
  static open(canvas) {
    const gl = canvas.getContext("webgl2", { alpha: true, antialias: false, depth: true, premultipliedAlpha: true });
    return gl ? new SceneRenderer(gl) : null;
  }

  constructor(gl) {
    this.gl = gl;
    this.build();
  }

  /** Also after the graphics card has lost everything. */
  build() {
    const { gl } = this;
    this.spheres = { ...link(gl, SPHERE_VERTEX, SPHERE_FRAGMENT), vao: gl.createVertexArray(), count: 0 };
    this.walls = { ...link(gl, WALL_VERTEX, WALL_FRAGMENT), vao: gl.createVertexArray(), points: gl.createBuffer(), corners: gl.createBuffer(), groups: [] };
    this.textures = ["rows", "values", "palette"].map(() => gl.createTexture());
    gl.enable(gl.DEPTH_TEST);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.bindVertexArray(this.walls.vao);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.walls.points);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 12, 0);
    gl.enableVertexAttribArray(0);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.walls.corners);
    gl.bindVertexArray(null);
  }

  setFrame(frame) {
    const { gl, spheres } = this;
    const high = Math.max(1, Math.ceil(frame.grains / WIDTH));
    const rows = new Uint16Array(4 * WIDTH * high);
    rows.set(new Uint16Array(frame.body, 0, 4 * frame.grains));
    this.fill(ROWS, gl.RGBA16UI, [WIDTH, high], gl.RGBA_INTEGER, gl.UNSIGNED_SHORT, rows);
    Object.assign(spheres, { count: frame.grains, low: frame.low, span: frame.high.map((high, k) => high - frame.low[k]), radii: frame.radius });
    this.setWalls(frame.walls);
  }

  setWalls(walls) {
    const { gl } = this;
    this.walls.groups = walls?.groups ?? [];
    if (walls) {
      gl.bindVertexArray(this.walls.vao);
      gl.bindBuffer(gl.ARRAY_BUFFER, this.walls.points);
      gl.bufferData(gl.ARRAY_BUFFER, walls.points, gl.DYNAMIC_DRAW);
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, walls.corners, gl.DYNAMIC_DRAW);
      gl.bindVertexArray(null);
    }
  }

  /** `levels`: a byte a grain, a row of the 256 `pixels`. */
  setColours({ levels, pixels }) {
    const { gl } = this;
    const high = Math.max(1, Math.ceil(levels.length / WIDTH));
    const values = new Uint8Array(WIDTH * high);
    values.set(levels);
    this.fill(VALUES, gl.R8UI, [WIDTH, high], gl.RED_INTEGER, gl.UNSIGNED_BYTE, values);
    this.fill(PALETTE, gl.RGBA, [256, 1], gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  }

  fill(unit, inner, [width, height], format, type, texels) {
    const { gl } = this;
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, this.textures[unit]);
    gl.texImage2D(gl.TEXTURE_2D, 0, inner, width, height, 0, format, type, texels);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) {
      gl.texParameteri(gl.TEXTURE_2D, name, gl.NEAREST);
    }
  }

  draw(camera, { width, height, cut, picked, showWalls, wallColour }) {
    const { gl } = this;
    if (gl.isContextLost()) {
      return;
    }
    const { canvas } = gl;
    if (canvas.width !== width || canvas.height !== height) {
      [canvas.width, canvas.height] = [width, height];
    }
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const matrices = camera.matrices(width / height);
    const groups = showWalls ? this.walls.groups : [];
    this.drawWalls(groups.filter(({ solid }) => solid), matrices, { cut, wallColour, solid: 1 });
    this.drawSpheres(matrices, cut, picked);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthMask(false);
    this.drawWalls(groups.filter(({ solid }) => !solid), matrices, { cut, wallColour, solid: 0 });
    gl.depthMask(true);
    gl.disable(gl.BLEND);
  }

  use({ program, uniforms, vao }, { view, projection }, cut) {
    const { gl } = this;
    gl.useProgram(program);
    gl.uniformMatrix4fv(uniforms.view, false, view);
    gl.uniformMatrix4fv(uniforms.projection, false, projection);
    gl.uniform4fv(uniforms.cut, cut);
    gl.bindVertexArray(vao);
  }

  drawSpheres(matrices, cut, picked) {
    const { gl, spheres } = this;
    if (!spheres.count) {
      return;
    }
    this.use(spheres, matrices, cut);
    gl.uniform3fv(spheres.uniforms.low, spheres.low);
    gl.uniform3fv(spheres.uniforms.span, spheres.span);
    gl.uniform2fv(spheres.uniforms.radii, spheres.radii);
    gl.uniform1i(spheres.uniforms.picked, picked);
    for (const [name, unit] of [["rows", ROWS], ["values", VALUES], ["palette", PALETTE]]) {
      gl.uniform1i(spheres.uniforms[name], unit);
    }
    gl.drawArrays(gl.TRIANGLES, 0, 6 * spheres.count);
    gl.bindVertexArray(null);
  }

  drawWalls(groups, matrices, { cut, wallColour, solid }) {
    const { gl, walls } = this;
    if (!groups.length) {
      return;
    }
    this.use(walls, matrices, cut);
    gl.uniform3fv(walls.uniforms.colour, wallColour);
    gl.uniform1f(walls.uniforms.solid, solid);
    for (const { first, count } of groups) {
      gl.drawElements(gl.TRIANGLES, 3 * count, gl.UNSIGNED_INT, 12 * first);
    }
    gl.bindVertexArray(null);
  }

  /** In how many ms all that was asked for is drawn; it waits for the card without holding the page up. */
  async duration() {
    const { gl } = this;
    const started = performance.now();
    const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    while (fence && !gl.isContextLost() && gl.getSyncParameter(fence, gl.SYNC_STATUS) !== gl.SIGNALED) {
      await new Promise((resolve) => setTimeout(resolve, 4));
    }
    gl.deleteSync(fence);
    return performance.now() - started;
  }
}
