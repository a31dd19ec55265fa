// A live page of Relume: holds the volume, and marches it by WebGPU with the shader of the plan. The film stays on the device and is
// relit there, so that dial, lights, spectra and display are those of relume.js. docs/theory/live.md of Relume explains what is kept exact.

import { breath, button, clamp, copyable, css, el, fromBase64, inflated, listen, paragraph, pauses, slider } from "./relume.js";

const { abs, cos, floor, hypot, max, min, round, sin, sqrt, tan } = Math;

/** A reason for which the finished views stay, in words for the reader. */
class Unable extends Error {}
const DAMAGED = "the page is damaged";

// ---- rays: the twins of Camera::view and RayTable::new, in f64 ----

const dot3 = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross3 = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const scaled = (a, by) => a.map((part) => part * by);
const plus = (a, b) => a.map((part, axis) => part + b[axis]);
const unit = (a) => scaled(a, 1 / sqrt(dot3(a, a)));

/** Fraction of the picture that the box spans at an aspect ratio, linear between pairs. */
function fillAt(pairs, aspect) {
  const after = pairs.findIndex(([ratio]) => ratio >= aspect);
  if (after <= 0) return after < 0 ? pairs[pairs.length - 1][1] : pairs[0][1];
  const [[a, low], [b, high]] = [pairs[after - 1], pairs[after]];
  return low + (high - low) * (aspect - a) / (b - a);
}

/** Eye, axes and half extents of a camera: `seen` has azimuth and elevation in degrees, zoom, and a shift in heights of the picture. */
export function viewOf({ camera }, seen, aspect) {
  const up = unit(camera.up), front = unit(plus(camera.front, scaled(up, -dot3(camera.front, up))));
  const [a, e] = [seen.azimuth, seen.elevation].map((degrees) => degrees * (Math.PI / 180));
  const around = plus(scaled(front, cos(a)), scaled(cross3(up, front), sin(a)));
  const forward = scaled(plus(scaled(around, cos(e)), scaled(up, sin(e))), -1);
  const right = unit(cross3(forward, up)), above = cross3(right, forward);
  const fill = camera.fill && fillAt(camera.fill, aspect), radius = hypot(...camera.corners[0]);
  const reaches = camera.corners.map((corner) => [max(abs(dot3(corner, right)) / aspect, abs(dot3(corner, above))), dot3(corner, forward)]);
  const parallel = camera.tangent === null;
  let half = camera.tangent, distance = camera.distance;
  if (parallel) {
    half = camera.half || max(...reaches.map(([reach]) => reach / fill));
    if (camera.fill) distance = 2 * radius;
  } else if (camera.fill) {
    distance = max(radius, ...reaches.map(([reach, ahead]) => reach / (half * fill) - ahead));
  }
  // As a lens zooms: the eye stays outside of the volume.
  half /= seen.zoom;
  const span = 2 * (parallel ? half : half * distance);
  const target = plus(camera.target, plus(scaled(right, seen.x * span), scaled(above, seen.y * span)));
  return { eye: plus(target, scaled(forward, -distance)), target, forward, right, up: above, half: [half * aspect, half], parallel };
}

/** The part of a ray table that depends on the view, in texture coordinates. */
export function raysOf({ frame }, view) {
  const linear = (v) => frame.linear.map((row) => dot3(row, v)), by = (v, factor) => scaled(linear(v), factor);
  const distance = dot3(plus(frame.centre, scaled(view.eye, -1)), view.forward), far = distance > frame.diagonal ? distance : 0;
  const [u, v] = [scaled(view.right, view.half[0]), scaled(view.up, view.half[1])], [wide, slant] = view.parallel ? [1, 0] : [far, 1];
  const base = plus(plus(view.eye, scaled(view.forward, far)), scaled(frame.origin, -1));
  return {
    base: plus(linear(base), frame.half), base_u: by(u, wide), base_v: by(v, wide),
    direction: by(view.forward, frame.unit), direction_u: by(u, slant * frame.unit), direction_v: by(v, slant * frame.unit),
    eye_distance: far / frame.unit, spread_u: view.parallel ? 0 : view.half[0] ** 2, spread_v: view.parallel ? 0 : view.half[1] ** 2,
  };
}

// Places of numbers in the uniform of a march (`render::march::MarchUniform`).
const PLACES = { base: 0, eye_distance: 12, base_u: 16, spread_u: 28, base_v: 32, spread_v: 44, direction: 48, direction_u: 64, direction_v: 80 };
const PIXEL = [140, 156], SIZE = [188, 204], CROP = [208, 224];

/** Writes the numbers of a view, a size and a crop box, in voxel indices, to the uniform of a march. */
function describe(bytes, live, seen, cut, [width, height]) {
  const to = new DataView(bytes.buffer, bytes.byteOffset), put = (at, value) => [value].flat().forEach((part, i) => to.setFloat32(at + 4 * i, part, true));
  const rays = raysOf(live, viewOf(live, seen, width / height));
  for (const [name, at] of Object.entries(PLACES)) put(at, rays[name]);
  [width, height].forEach((side, axis) => { put(PIXEL[axis], 2 / side); to.setUint32(SIZE[axis], side, true); });
  // An axis with a single voxel is one voxel thick.
  cut.forEach((corner, end) => put(CROP[end], corner.map((at, axis) => live.thin[axis] ? end : (at + 0.5) / live.dims[axis])));
}

// ---- voxels ----

/** Adds to each number that before it along one axis. */
function summed(numbers, [nx, ny], axis, mask) {
  const stride = [1, nx, nx * ny][axis], line = [nx, nx * ny, Infinity][axis];
  for (let first = 0; first < numbers.length; first += line) {
    const end = min(first + line, numbers.length);
    for (let i = first + stride; i < end; i++) numbers[i] = numbers[i] + numbers[i - stride] & mask;
  }
}

/** Numbers of all voxels of a field from the residuals of a prediction (`output::page::live`). */
async function numbersOf({ dims, prediction, wide }, bytes) {
  const [nx, ny, nz] = dims, all = nx * ny * nz;
  if (bytes.length !== all * (wide ? 2 : 1)) throw new Unable(DAMAGED);
  const numbers = new Uint16Array(all), pause = pauses(), mask = wide ? 65535 : 255;
  // Residuals have their sign in the lowest bit; their high bytes lie behind all low ones.
  for (let i = 0; i < all; i++) {
    const code = wide ? bytes[i] | bytes[all + i] << 8 : bytes[i];
    numbers[i] = (code >> 1 ^ -(code & 1)) & mask;
    if (i % 4194304 === 0) await pause();
  }
  const median = prediction === "median";
  for (const axis of { x: [0], xyz: [0, 1, 2] }[prediction] ?? []) { summed(numbers, dims, axis, mask); await pause(); }
  for (let z = 0; z < nz && median; z++) {
    for (let y = 0; y < ny; y++) {
      const first = nx * (y + ny * z);
      for (let x = 0, left = 0, corner = 0; x < nx; x++) {
        const i = first + x, above = y ? numbers[i - nx] : left;
        const [low, high] = left < above ? [left, above] : [above, left];
        const guess = !x || !y ? (x ? left : above) : corner >= high ? low : corner <= low ? high : left + above - corner;
        left = numbers[i] = numbers[i] + guess & mask;
        corner = above;
      }
    }
    await pause();
  }
  return numbers;
}

/** Bits of a whole number as a 16-bit float; beyond 2048 rounded to even. */
function half(number) {
  const size = abs(number);
  if (!size) return 0;
  const exponent = floor(Math.log2(size)), exact = size / 2 ** (exponent - 10), part = exact - floor(exact);
  const whole = floor(exact) + (part > 0.5 || part === 0.5 && floor(exact) % 2 ? 1 : 0);
  return (number < 0 ? 32768 : 0) + (exponent + 15 << 10) + whole - 1024;
}

/**
 * Fills a texture from slice `first` on with the values of these fields, `all` their numbers, or with that of one and its differences if gradients are
 * stored.
 */
async function fill(queue, texture, { format, gradient }, fields, all, first) {
  const [nx, ny, nz] = fields[0].dims, slice = nx * ny, [numbers] = all, parts = format.startsWith("rgba") ? 4 : 1;
  const narrow = format.includes("16"), span = 2 * max(...fields.map(({ largest }) => largest));
  const halves = Uint16Array.from({ length: narrow ? 2 * span + 1 : 0 }, (_, i) => half(i - span));
  const texels = new (narrow ? Uint16Array : Float32Array)(slice * parts), near = (at, n) => [max(at - 1, 0), min(at + 1, n - 1)];
  const code = narrow ? (number) => halves[span + number] : (number) => number;
  for (let z = 0; z < nz; z++) {
    fields.forEach(({ shift }, field) => {
      const from = all[field];
      for (let i = 0, at = gradient ? 3 : field; i < slice; i++, at += parts) texels[at] = code(from[slice * z + i] - shift);
    });
    const [behind, before] = near(z, nz), of_z = before - behind === 1 ? 2 : 1;
    for (let y = 0; y < ny && gradient; y++) {
      const [y0, y1] = near(y, ny), of_y = y1 - y0 === 1 ? 2 : 1, row = nx * (y + ny * z);
      for (let x = 0, at = parts * nx * y; x < nx; x++, at += parts) {
        const [x0, x1] = x && x + 1 < nx ? [x - 1, x + 1] : near(x, nx), of_x = x1 - x0 === 1 ? 2 : 1;
        texels[at] = code((numbers[row + x1] - numbers[row + x0]) * of_x);
        texels[at + 1] = code((numbers[nx * (y1 + ny * z) + x] - numbers[nx * (y0 + ny * z) + x]) * of_y);
        texels[at + 2] = code((numbers[nx * (y + ny * before) + x] - numbers[nx * (y + ny * behind) + x]) * of_z);
      }
    }
    queue.writeTexture({ texture, origin: [0, 0, first + z] }, texels, { bytesPerRow: texels.BYTES_PER_ELEMENT * parts * nx, rowsPerImage: ny }, [nx, ny, 1]);
    await breath();
  }
}

// ---- the device ----

// The film as a picture: canvas and film sizes, layers of accumulators and of transmittances, whether the tone is soft; then both, and the
// weights of red, green and blue of each layer. Short, as it is sent with every page; twin of `shaders/relight.wgsl`.
const DRAWN = `struct S{c:vec2f,f:vec2u,l:u32,t:u32,s:u32}
@group(0)@binding(0) var<uniform> s:S;
@group(0)@binding(1) var<storage> a:array<vec4f>;
@group(0)@binding(2) var<storage> t:array<vec4f>;
@group(0)@binding(3) var<storage> w:array<vec4f>;
@vertex fn v(@builtin(vertex_index) i:u32)->@builtin(position) vec4f{return vec4f(f32(i&1u)*4-1,f32(i>>1u)*4-1,0,1);}
@fragment fn f(@builtin(position) p:vec4f)->@location(0) vec4f{
let q=min(vec2u(p.xy*vec2f(s.f)/s.c),s.f-1);let n=s.f.x*s.f.y;let o=q.y*s.f.x+q.x;var r=vec3f();
for(var i=0u;i<s.l+s.t;i++){var x=vec4f();if(i<s.l){x=a[i*n+o];}else{x=t[(i-s.l)*n+o];}r+=vec3f(dot(x,w[3*i]),dot(x,w[3*i+1]),dot(x,w[3*i+2]));}
let m=max(r.x,max(r.y,r.z));if(s.s!=0&&m>.75){r*=(1-.0625/(m-.5))/m;}r=saturate(r);
return vec4f(select(1.055*pow(r,vec3f(1/2.4))-.055,12.92*r,r<=vec3f(.0031308)),1);}`;

/** Longest time of a band of rows, and of a picture while a hand moves, in ms. */
const BAND = 50, MOVING = 40;
// Samples of a ray at most (`tables::MOST_SAMPLES`).
const MOST_SAMPLES = 8388608;

/** A device that can hold the volume and the film, or an `Unable`. */
async function deviceFor(live) {
  const adapter = await navigator.gpu?.requestAdapter({ powerPreference: "high-performance" });
  if (!adapter) throw new Unable("this browser has no WebGPU, or no device for it");
  const { size, layers, transmittances } = live, pixels = size[0] * size[1];
  const film = 16 * pixels * max(layers, transmittances);
  const needs = { maxTextureDimension3D: max(...live.textures.flatMap(({ dims }) => dims), ...live.grids.flatMap(([, dims]) => dims)), maxStorageBufferBindingSize: film, maxBufferSize: film, maxStorageBuffersPerShaderStage: live.resources.filter(([, kind]) => kind === "storage").length };
  const lacking = Object.keys(needs).find((name) => adapter.limits[name] < needs[name]);
  if (lacking) throw new Unable(`this device has too little room for the volume (${lacking})`);
  // A device has the usual limits at least, whatever is asked for.
  return adapter.requestDevice({ requiredLimits: needs });
}

// Numbers of GPUBufferUsage, and of GPUTextureUsage.
const MAP_READ = 1, COPY_SRC = 4, COPY_DST = 8, UNIFORM = 64, STORAGE = 128;
const TEXTURE_COPY_SRC = 1, TEXTURE_COPY_DST = 2, TEXTURE_BINDING = 4, RENDER_ATTACHMENT = 16;

/** Marches a live page's volume: `blocks(name)` are inflated bytes. */
export async function marcher(live, blocks, device) {
  if (device) return prepared(live, blocks, device);
  device = await deviceFor(live);
  try { return await prepared(live, blocks, device); } catch (error) { device.destroy(); throw error; }
}

async function prepared(live, blocks, device) {
  const { queue } = device, lost = device.lost;
  const code = new TextDecoder().decode(await blocks("shader"));
  device.pushErrorScope("validation");
  device.pushErrorScope("out-of-memory");
  const module = device.createShaderModule({ code });
  const pipeline = await device.createComputePipelineAsync({ layout: "auto", compute: { module, entryPoint: "main" } });
  const tables = await blocks("tables"), buffers = {}, bytesOf = {};
  let at = 0;
  for (const [name, length] of live.buffers) {
    bytesOf[name] = tables.subarray(at, at += length);
    const kind = live.resources.find((one) => one[0] === name)[1];
    buffers[name] = device.createBuffer({ size: max(16, length + 15 & ~15), usage: COPY_DST | (kind === "uniform" ? UNIFORM : STORAGE) });
    queue.writeBuffer(buffers[name], 0, bytesOf[name]);
  }
  const band = device.createBuffer({ size: 32, usage: UNIFORM | COPY_DST });
  const texture = (format, size) => device.createTexture({ dimension: "3d", format, size, usage: TEXTURE_BINDING | TEXTURE_COPY_DST });
  const textures = {};
  for (const it of live.textures) {
    const into = textures[it.name] = texture(it.format, it.dims);
    let first = 0;
    for (const together of it.behind ? it.fields.map((field) => [field]) : [it.fields]) {
      const fields = together.map((field) => live.fields[field]), numbers = [];
      for (const field of together) numbers.push(await numbersOf(live.fields[field], await blocks(`voxels-${field}`)));
      await fill(queue, into, it, fields, numbers, first);
      first += fields[0].dims[2];
    }
  }
  if (live.label_bytes) {
    const labels = textures.labels = texture({ 1: "r8uint", 2: "r16uint", 4: "r32uint" }[live.label_bytes], live.dims);
    queue.writeTexture({ texture: labels }, await blocks("labels"), { bytesPerRow: live.dims[0] * live.label_bytes, rowsPerImage: live.dims[1] }, live.dims);
  }
  if (live.grids.length) {
    const bytes = await blocks("grids");
    let at = 0;
    for (const [name, dims, numbers] of live.grids) {
      textures[name] = texture(numbers > 1 ? "rgba16float" : "r16float", dims);
      const length = 2 * numbers * dims[0] * dims[1] * dims[2];
      queue.writeTexture({ texture: textures[name] }, bytes.subarray(at, at += length), { bytesPerRow: 2 * numbers * dims[0], rowsPerImage: dims[1] }, dims);
    }
  }
  // Light is interpolated, whatever the values are.
  const samplers = Object.fromEntries(["nearest", "linear"].map((filter) => [filter, device.createSampler({ magFilter: filter, minFilter: filter })]));
  const films = () => {
    const [width, height] = live.size, of = (layers) => device.createBuffer({ size: 16 * width * height * max(1, layers), usage: STORAGE | COPY_SRC });
    return { accumulators: of(live.layers), transmittances: of(live.transmittances), size: [1, 1] };
  };
  // The film that is shown, and the next one.
  let [shown, next] = [films(), films()];
  for (const scope of ["out-of-memory", "validation"]) {
    const error = await device.popErrorScope();
    if (error) throw new Unable(scope === "validation" ? `this device refuses it: ${error.message}` : "this device has too little memory for the volume");
  }
  const resource = (name, kind) => kind === "sampler" ? samplers[name === "volume_sampler" ? live.filter : "linear"] : textures[name] ? textures[name].createView() : { buffer: next[name]?.size ? next[name] : name === "band" ? band : buffers[name] };
  const bind = () => device.createBindGroup({ layout: pipeline.getBindGroupLayout(0), entries: live.resources.map(([name, kind], binding) => ({ binding, resource: resource(name, kind) })) });
  const march = bytesOf.march_uniform.slice();
  let speed = 0, canvas, context, painter;
  return {
    device, lost,
    /** Pixels per ms of the last march; 0 before the first. */
    get speed() { return speed; },
    /** The film that is shown, its size, and its numbers by a pixel. */
    get size() { return shown.size; },
    /** Marches a picture in bands; stops at `isOver()`, and returns whether it was finished and is shown. */
    async march(seen, cut, size, isOver = () => false) {
      const [width, height] = size, [across, down] = live.group;
      describe(march, live, seen, cut, size);
      queue.writeBuffer(buffers.march_uniform, 0, march);
      const group = bind(), began = performance.now();
      for (let row = 0, rows; row < height; row += rows) {
        // One row of groups tells the speed of a device that has not marched yet.
        rows = min(height - row, down * max(1, floor((speed ? BAND * speed : 64 * down) / (width * down))));
        const words = Uint32Array.of(row, 0, MOST_SAMPLES, 0, 0, 0);
        // One ray through the middle of each pixel.
        new Float32Array(words.buffer).fill(0.5, 3, 5);
        queue.writeBuffer(band, 0, words);
        const encoder = device.createCommandEncoder(), pass = encoder.beginComputePass(), before = performance.now();
        pass.setPipeline(pipeline);
        pass.setBindGroup(0, group);
        pass.dispatchWorkgroups(Math.ceil(width / across), Math.ceil(rows / down));
        pass.end();
        queue.submit([encoder.finish()]);
        await queue.onSubmittedWorkDone();
        const now = width * rows / max(performance.now() - before, 0.1);
        speed = speed ? (speed + now) / 2 : now;
        if (isOver()) return false;
      }
      speed = width * height / max(performance.now() - began, 0.1);
      next.size = size;
      [shown, next] = [next, shown];
      return true;
    },
    /** Draws the film on a canvas of the page: for each layer of four numbers the weights of red, green and blue. */
    draw(onto, colours, soft) {
      if (!canvas) {
        canvas = el("canvas", { width: onto.width, height: onto.height });
        context = canvas.getContext("webgpu");
        const format = navigator.gpu.getPreferredCanvasFormat(), drawn = device.createShaderModule({ code: DRAWN });
        context.configure({ device, format, alphaMode: "opaque", usage: RENDER_ATTACHMENT | TEXTURE_COPY_SRC });
        painter = {
          pipeline: device.createRenderPipeline({ layout: "auto", vertex: { module: drawn }, fragment: { module: drawn, targets: [{ format }] } }),
          uniform: device.createBuffer({ size: 32, usage: UNIFORM | COPY_DST }),
          colours: device.createBuffer({ size: 48 * (live.layers + live.transmittances), usage: STORAGE | COPY_DST }),
        };
      }
      queue.writeBuffer(painter.uniform, 0, Float32Array.of(canvas.width, canvas.height));
      queue.writeBuffer(painter.uniform, 8, Uint32Array.of(...shown.size, live.layers_used, live.transmittances_used, soft ? 1 : 0));
      queue.writeBuffer(painter.colours, 0, Float32Array.from(colours));
      const entries = [painter.uniform, shown.accumulators, shown.transmittances, painter.colours].map((buffer, binding) => ({ binding, resource: { buffer } }));
      const encoder = device.createCommandEncoder();
      const pass = encoder.beginRenderPass({ colorAttachments: [{ view: context.getCurrentTexture().createView(), loadOp: "clear", storeOp: "store" }] });
      pass.setPipeline(painter.pipeline);
      pass.setBindGroup(0, device.createBindGroup({ layout: painter.pipeline.getBindGroupLayout(0), entries }));
      pass.draw(3);
      pass.end();
      queue.submit([encoder.finish()]);
      // A canvas of WebGPU is empty once it was shown; copies, prints and screenshots need one that stays.
      onto.getContext("2d", { alpha: false }).drawImage(canvas, 0, 0);
    },
    /** Numbers of the film that is shown, from one pixel on: those of accumulators, and those of transmittances, layer by layer in fours. */
    async numbers(first = 0, count = shown.size[0] * shown.size[1]) {
      const pixels = shown.size[0] * shown.size[1], parts = [[shown.accumulators, live.layers_used], [shown.transmittances, live.transmittances_used]];
      const read = async ([buffer, layers]) => {
        if (!layers) return new Float32Array(0);
        const to = device.createBuffer({ size: 16 * layers * count, usage: MAP_READ | COPY_DST }), encoder = device.createCommandEncoder();
        for (let layer = 0; layer < layers; layer++) encoder.copyBufferToBuffer(buffer, 16 * (layer * pixels + first), to, 16 * layer * count, 16 * count);
        queue.submit([encoder.finish()]);
        await to.mapAsync(GPUMapMode.READ);
        const numbers = new Float32Array(to.getMappedRange().slice(0));
        to.destroy();
        return numbers;
      };
      return Promise.all(parts.map(read));
    },
    /** Gives the materials densities that are so many times their own. */
    thin(densities) {
      const copy = (name) => bytesOf[name].slice().buffer, tables = { table: live.tables, label: live.tables === "steps" ? "steps" : "densities" };
      for (const [of, kind] of Object.entries(tables)) {
        const names = [`${of}_source`, `${of}_opacity`];
        if (buffers[names[0]]) thinned(live, kind, ...names.map(copy), densities).forEach((table, i) => queue.writeBuffer(buffers[names[i]], 0, table));
      }
      if (live.tables === "integrals") queue.writeBuffer(buffers.segments_uniform, 0, Float32Array.of(new Float32Array(copy("segments_uniform"))[0] * max(1, ...densities)));
    },
    end() { device.destroy(); },
  };
}

export { fromBase64, inflated };

// ---- the page ----

export const digits = (value) => +(+value).toFixed(4);
const numbersIn = (text, count) => { const all = text.split(",").map(Number); return text && all.length === count && all.every(Number.isFinite) ? all : null; };

/** The camera of a state: as the page opens, but for what the reader turned. */
export function seenIn(live, { seen }) {
  const { azimuth, elevation } = live.camera, [a, e, zoom, x, y] = numbersIn(seen, 5) ?? [azimuth, elevation, 1, 0, 0];
  return within({ azimuth: a, elevation: e, zoom, x, y });
}

/** Steepest view in degrees, and the range of a zoom. */
const STEEPEST = 89.9, FAR = 0.3, NEAR = 30;
const within = ({ azimuth, elevation, zoom, x, y }) => ({ azimuth: azimuth % 360, elevation: clamp(elevation, -STEEPEST, STEEPEST), zoom: clamp(zoom, FAR, NEAR), x: clamp(x, -5, 5), y: clamp(y, -5, 5) });

/** The crop box of a state: two corners in voxel indices, within the volume, at least a voxel apart. */
export function cutIn(live, { cut }) {
  const given = numbersIn(cut, 6), [first, last] = live.crop;
  if (!given) return live.crop;
  const low = first.map((at, axis) => clamp(given[axis], at, max(at, last[axis] - 1)));
  return [low, last.map((at, axis) => clamp(given[axis + 3], min(low[axis] + 1, at), at))];
}

/** Densities of the materials, as factors. */
export const densitiesIn = (live, { dense }) => (numbersIn(dense, live.densities.length) ?? live.densities.map(() => 1)).map((part) => clamp(part, 0, 2));

/**
 * Tables of light and opacity with these densities of the materials. An entry of "steps" holds for each material the light that a step gains,
 * σ(1 − e^−τ)/τ, and what it loses, 1 − e^−τ, with τ the sum of all σ that dim; one of "densities" σ and τ themselves, and one of "integrals" their
 * sums in whole numbers, of units that are as many times as large as the largest factor above 1.
 */
export function thinned(live, kind, source, opacity, densities) {
  const whole = kind === "integrals", steps = kind === "steps", [light, lost] = [source, opacity].map((bytes) => new (whole ? Int32Array : Float32Array)(bytes));
  if (densities.every((part) => part === 1)) return [light, lost];
  const stride = 4 * live.table_lanes, scale = whole ? max(1, ...densities) : 1, rounded = whole ? round : (number) => number;
  for (let row = 0, at = 0; at < light.length; row++, at += stride) {
    const before = lost[row], scatter = steps && before > 0 ? -Math.log1p(-min(before, 0.99999994)) / before : 1;
    const gains = densities.map((part, i) => light[at + i] * part * scatter / scale);
    // Materials may dim less than they scatter.
    const dims = gains.reduce((sum, gain, i) => sum + gain * live.densities[i], 0);
    lost[row] = rounded(steps ? -Math.expm1(-dims) : dims);
    gains.forEach((gain, i) => { light[at + i] = rounded(steps && dims > 0 ? gain * lost[row] / dims : gain); });
  }
  return [light, lost];
}

/** Corners in voxel indices of the file from those of the page, whose voxels may be means of blocks; and the other way. */
export const inFile = (live, corners) => corners.map((corner) => corner.map((at, axis) => (at + 0.5) * live.block[axis] - 0.5));
export const inPage = (live, corners) => corners.map((corner) => corner.map((at, axis) => (at + 0.5) / live.block[axis] - 0.5));

/** Flags of Relume for the same view. */
function flagsOf(live, seen, cut, aspect) {
  const { camera } = live, view = viewOf(live, seen, aspect), list = (numbers) => `[${numbers.map((number) => +number.toPrecision(7))}]`, flags = [];
  if (camera.fill && !seen.x && !seen.y && seen.zoom === 1) flags.push(`camera.azimuth=${digits(seen.azimuth)}`, `camera.elevation=${digits(seen.elevation)}`);
  else {
    flags.push(`camera={projection="${view.parallel ? "orthographic" : "perspective"}", ${view.parallel ? `height=${+(2 * view.half[1]).toPrecision(7)}` : `fov=${digits(Math.atan(view.half[1]) * 360 / Math.PI)}`}, position=${list(view.eye)}, target=${list(view.target)}, up=${list(camera.up)}}`);
  }
  if (String(cut) !== String(live.crop)) {
    const [low, high] = inFile(live, cut).map(list);
    flags.push(`crop={min=${low}, max=${high}}`);
  }
  return flags.map((flag) => `-D '${flag}'`).join(" ");
}

/** Numbers of a light position in a pixel. */
const numbersOfPosition = ({ model, components }) => (model ? model.spectra : components).length;

/** Weights of each layer of the film from those of the page's planes: red, green and blue of four numbers. */
function weightsOf(live, page, colours) {
  const k = numbersOfPosition(page), all = k * page.positions.length;
  const weights = new Float32Array(12 * (live.layers_used + live.transmittances_used));
  colours.forEach((rgb, plane) => {
    const at = plane < all ? [floor(plane / k) * live.lanes + (plane % k >> 2), plane % k % 4] : [live.layers_used + (plane - all >> 2), (plane - all) % 4];
    rgb.forEach((part, axis) => { weights[12 * at[0] + 4 * axis + at[1]] = part; });
  });
  return weights;
}

/** Letters of the sides of a patient in a direction of the world, the largest part first (`annotate::letters`). */
export function lettersOf(patient, direction) {
  const sizes = direction.map(abs), most = max(...sizes);
  return [0, 1, 2].filter((axis) => sizes[axis] >= most / 2).sort((a, b) => sizes[b] - sizes[a]).map((axis) => patient[axis][direction[axis] > 0 ? 1 : 0]).join("");
}

/** Scale bar and letters of a view (twin of `annotate::Overlay`): elements over the picture, and what writes them. */
function marksOf(live, aspect) {
  const bar = el("i"), ends = ["left", "right", "top", "bottom"].map((side) => el("b", { class: side }));
  const write = (seen) => {
    const { eye, target, forward, right, up, half, parallel } = viewOf(live, seen, aspect);
    const across = 2 * half[0] * (parallel ? 1 : dot3(plus(target, scaled(eye, -1)), forward)), most = across / 5, power = 10 ** floor(Math.log10(most));
    const length = +([5, 2, 1].find((digit) => digit * power <= most) * power).toPrecision(1);
    bar.style.width = `${100 * length / across}%`;
    bar.textContent = `${length} ${live.unit}${parallel ? "" : " at the target"}`;
    if (live.patient) [scaled(right, -1), right, up, scaled(up, -1)].forEach((way, i) => { ends[i].textContent = lettersOf(live.patient, way); });
  };
  return [el("div", { class: "marks", "aria-hidden": "true" }, bar, ...ends), write];
}

const after = (ms) => new Promise((go) => setTimeout(go, ms));

/** Longest march of 64×64 pixels of a device that is worth it, in ms, and of the time after which a hand rests. */
const SLOW = 250, REST = 160;
/** Degrees of a drag as long as the picture is high, and of a key; growth by a step of the wheel or a key: as in the window. */
const TURN = 180, KEY_TURN = 5, NEARER = 1.1;

/** Lets the reader turn the volume that `live` describes: controls, marches, and what happens when a device is lost. */
function turnable(handle, live, blocks, say, force) {
  const { page, frame } = handle, aspect = page.size[0] / page.size[1], root = frame.closest(".relume");
  let state = handle.state, machine, moving = 0, running = false, shown = "", dense = "", isFull = false, numbers = null, ended = false;
  const key = (of = state) => `${of.seen}|${of.cut}|${of.dense}`;
  const small = () => {
    const part = min(1, sqrt(max(machine.speed * MOVING, 4096) / (page.size[0] * page.size[1])));
    return page.size.map((side) => max(1, round(side * part)));
  };
  const thin = () => { if (dense !== state.dense) machine.thin(densitiesIn(live, state)); dense = state.dense; };
  const march = async () => {
    if (running || ended) return;
    running = true;
    try {
      while (!ended && machine && !(shown === key() && (isFull || moving))) {
        thin();
        const now = key(), mine = machine, isSmall = !!moving, size = isSmall ? small() : page.size, isLate = () => ended || mine !== machine || !(isSmall && moving) && now !== key();
        // A long march is told.
        const sharpening = setTimeout(() => { if (!ended) say("Sharpening…"); }, 400);
        const isDone = await mine.march(seenIn(live, state), cutIn(live, state), size, isLate).finally(() => clearTimeout(sharpening));
        if (!ended) say("");
        if (!isDone || mine !== machine) continue;
        [shown, isFull, numbers] = [now, size.every((side, axis) => side >= page.size[axis]), null];
        handle.draw();
      }
    } catch (error) {
      // A lost device is found by itself.
      if (machine && !await Promise.race([machine.lost, after(100)])) over(error);
    } finally { running = false; }
  };
  const painter = {
    name: "WebGPU", live: true,
    draw(colours, canvas) { machine.draw(canvas, weightsOf(live, page, colours), page.soft); },
    changed(next) {
      state = next;
      write(seenIn(live, state));
      refresh();
      if (key() === shown && isFull) return;
      clearTimeout(moving);
      moving = setTimeout(() => { moving = 0; march(); }, REST);
      march();
    },
    /** Numbers of a pixel by the planes of the page, once they are read. */
    values([x, y]) {
      const [width, height] = machine.size, at = min(floor((y + 0.5) * height / page.size[1]), height - 1) * width + min(floor((x + 0.5) * width / page.size[0]), width - 1);
      if (numbers?.at === at) return numbers.values;
      const mine = numbers = { at };
      machine.numbers(at, 1).then(([accumulators, transmittances]) => {
        const k = numbersOfPosition(page), all = k * page.positions.length;
        mine.values = page.channels.map((_, plane) => plane < all ? accumulators[4 * (floor(plane / k) * live.lanes + (plane % k >> 2)) + plane % k % 4] : transmittances[plane - all]);
        if (numbers === mine) handle.draw();
      }, () => { if (numbers === mine) numbers = null; });
      return null;
    },
    end() {},
  };
  const [marks, write] = marksOf(live, aspect);
  frame.append(marks);
  // Controls.
  const updates = [], refresh = () => { const { colours } = handle; for (const update of updates) update(colours); }, shows = (get) => { const out = el("output"); updates.push(() => { out.textContent = get(); }); return out; };
  const set = (seen) => handle.set({ seen: [seen.azimuth, seen.elevation, seen.zoom, seen.x, seen.y].map(digits).join() });
  const turn = (part) => { const seen = seenIn(live, state); set(within({ ...seen, ...part(seen) })); };
  const axis = (name, i) => {
    const [first, last] = [live.crop[0][i], live.crop[1][i]], ends = ["from", "to"].map((word, end) => {
      const control = slider(`Cut ${name}, ${word}`, first, last, (last - first) / 200 || 1, () => {
        const cut = cutIn(live, state).map((corner) => [...corner]);
        cut[end][i] = +control.value;
        cut[1 - end][i] = end ? min(cut[0][i], cut[1][i] - 1) : max(cut[1][i], cut[0][i] + 1);
        handle.set({ cut: cut.flat().map(digits).join() });
      });
      updates.push(() => { control.value = cutIn(live, state)[end][i]; });
      return control;
    });
    return last > first ? el("div", { class: "row" }, el("span", {}, `${name} `, shows(() => cutIn(live, state).map((corner) => round(corner[i])).join("–"))), ...ends) : "";
  };
  const reset = () => handle.set({ seen: "", cut: "", dense: "", pixel: null });
  const [command, setCommand] = copyable("Flags of Relume for this view");
  updates.push(() => setCommand(flagsOf(live, seenIn(live, state), cutIn(live, state), aspect)));
  const zoom = slider("Zoom", Math.log(FAR), Math.log(NEAR), 0.01, () => turn(() => ({ zoom: Math.exp(+zoom.value) })));
  updates.push(() => { zoom.value = Math.log(seenIn(live, state).zoom); });
  const section = el("section", { "aria-label": "View" }, el("h2", {}, "View"),
    el("label", { class: "row" }, el("span", {}, "Zoom ", shows(() => `${digits(seenIn(live, state).zoom.toFixed(1))} ×`)), zoom),
    el("h3", {}, "Cut"), ...live.axes.map(axis),
    ...live.densities.length ? [el("h3", {}, "Density"), ...live.densities.map((_, i) => {
      const { name } = page.components[i], control = slider(`Density of ${name}`, 0, 2, 0.01, () => handle.set({ dense: densitiesIn(live, state).with(i, +control.value).map(digits).join() }));
      const disc = el("span", { class: "swatch" });
      updates.push((colours) => {
        control.value = densitiesIn(live, state)[i];
        disc.style.background = css(page.positions.reduce((sum, _, position) => plus(sum, colours[position * page.components.length + i]), [0, 0, 0]));
      });
      return el("label", { class: "row" }, el("span", {}, disc, " ", el("bdi", {}, name.replaceAll("_", " ")), " ", shows(() => `${round(100 * densitiesIn(live, state)[i])} %`)), control);
    })] : [],
    live.grids.length ? paragraph("hint", "Shadows stay as they were rendered.") : "",
    el("div", { class: "buttons" }, button("Reset view", reset), button("Whole volume", () => handle.set({ cut: "" }))),
    paragraph("hint", "The same view by Relume (densities have no flag):"), command);
  /** Zooms; what is under the pointer stays there. */
  const nearer = (by, { clientX, clientY }) => {
    const box = frame.getBoundingClientRect(), at = [clientX - box.x - box.width / 2, box.y + box.height / 2 - clientY].map((part) => part / box.height);
    turn((seen) => {
      const zoom = clamp(seen.zoom * by, FAR, NEAR), [x, y] = [seen.x, seen.y].map((shift, axis) => (shift + at[axis]) * zoom / seen.zoom - at[axis]);
      return { zoom, x, y };
    });
  };
  // One finger or button turns, two fingers or Shift move, wheel and pinch zoom.
  const fingers = new Map();
  let pinch = 0;
  listen(frame, "pointerdown", (event) => { if (ended || !machine) return; frame.setPointerCapture(event.pointerId); fingers.set(event.pointerId, [event.clientX, event.clientY, false]); });
  listen(frame, "pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before || ended || !machine) return;
    const [dx, dy] = [event.clientX - before[0], event.clientY - before[1]], side = frame.clientHeight;
    // A click that trembles turns nothing.
    if (!before[2] && hypot(dx, dy) <= 4) return;
    fingers.set(event.pointerId, [event.clientX, event.clientY, true]);
    // The volume follows the pointer, so the camera moves the opposite way.
    if (fingers.size > 1 || event.shiftKey) turn(({ x, y }) => ({ x: x - dx / side / fingers.size, y: y + dy / side / fingers.size }));
    else turn(({ azimuth, elevation }) => ({ azimuth: azimuth - TURN * dx / side, elevation: elevation + TURN * dy / side }));
    if (fingers.size === 2) {
      const [a, b] = [...fingers.values()], apart = hypot(a[0] - b[0], a[1] - b[1]);
      if (pinch) nearer(apart / pinch, { clientX: (a[0] + b[0]) / 2, clientY: (a[1] + b[1]) / 2 });
      pinch = apart;
    }
  });
  listen(frame, "pointerup pointercancel", (event) => { fingers.delete(event.pointerId); pinch = 0; });
  frame.addEventListener("wheel", (event) => { if (ended || !machine) return; event.preventDefault(); nearer(NEARER ** (-event.deltaY * (event.deltaMode ? 16 : 1) / 50), event); }, { passive: false });
  listen(frame, "keydown", (event) => {
    if (ended || !machine) return;
    const arrow = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key], near = { "+": 1, "=": 1, "-": -1 }[event.key];
    if (arrow && !state.pixel) turn((seen) => event.shiftKey ? { x: seen.x - arrow[0] / 20, y: seen.y - arrow[1] / 20 } : { azimuth: seen.azimuth + KEY_TURN * arrow[0], elevation: seen.elevation + KEY_TURN * arrow[1] });
    else if (near) turn((seen) => ({ zoom: seen.zoom * NEARER ** near }));
    else if (event.key === "Home") reset();
  });
  let losses = 0, before = "";
  const begin = async () => {
    machine = await marcher(live, blocks);
    dense = "";
    const began = performance.now();
    await machine.march(seenIn(live, state), cutIn(live, state), [64, 64]);
    if (performance.now() - began > SLOW && !force) throw new Unable("this device takes too long to march it (#march=always in the address or always=True in a notebook waits)");
    if (isOver()) return end();
    say("");
    // The finished view stays until this one is as sharp, or a hand moves.
    state = handle.state;
    const first = key();
    thin();
    if (await machine.march(seenIn(live, state), cutIn(live, state), page.size, () => isOver() || key(handle.state) !== first)) [shown, isFull] = [first, true];
    if (isOver()) return end();
    machine.lost.then(() => { if (!ended) again(); });
    handle.adopt(painter);
    if (section.parentNode) return;
    root.querySelector("aside section").after(section);
    const hint = root.querySelector("main .hint");
    const how = matchMedia("(pointer: coarse)").matches ? "Drag to turn; two fingers move and zoom." : "Drag or arrows turn, with Shift they move; wheel, + and − zoom.";
    before = hint.textContent;
    hint.textContent = `${how} Cuts and densities are below the lights. ${hint.textContent.replace("Drag to turn. ", "")}`;
    root.querySelector("details p").append(" Home resets view, cuts and densities.");
    refresh();
  };
  const again = async () => {
    machine = null;
    shown = "";
    handle.adopt(null);
    try {
      if (++losses > 1) throw new Unable("the device was lost twice");
      await begin();
    } catch (error) { over(error); }
  };
  /** Ends with the finished views. */
  const over = (error) => {
    if (isOver()) return end();
    end();
    if (section.parentNode) { section.remove(); root.querySelector("main .hint").textContent = before; }
    marks.remove();
    const reason = error instanceof Unable ? error.message : `${error.name}, ${error.message}`;
    say(`The volume cannot be turned: ${reason}. ${page.views > 1 ? "Its finished views are" : "Its finished view is"} shown.`);
  };
  const end = () => { ended = true; machine?.end(); }, isOver = () => ended || handle.ended;
  return { begin, over, end, get machine() { return machine; }, get settled() { return shown === key() && isFull && !running; } };
}

/** Lets the reader of an open page turn its volume: `parsed()` describes it, and `blocksOf(description)(name)` are its inflated bytes. */
export async function open(handle, parsed, blocksOf, force) {
  const root = handle.frame.closest(".relume"), { dataset } = root, say = (text) => { if (!handle.ended) root.querySelector(".status").textContent = text; };
  // The finished view comes first.
  while (!("ready" in dataset || "failed" in dataset)) {
    if (handle.ended) return null;
    await after(20);
  }
  say("Preparing the volume…");
  let one;
  try {
    const live = parsed();
    one = turnable(handle, live, blocksOf(live), say, force);
    await one.begin();
  } catch (error) {
    if (one) one.over(error); else say(`The volume cannot be turned: ${DAMAGED}.`);
  }
  return one;
}

const text = (name) => document.getElementById(name).textContent;
if (globalThis.document?.getElementById("relume-live")) {
  const parsed = () => { try { return JSON.parse(text("relume-live")); } catch { throw new Unable(DAMAGED); } };
  const blocks = (live) => async (name) => {
    try { return await inflated(fromBase64(text(`relume-live-${name}`)), live.lengths[name]); } catch { throw new Unable(DAMAGED); }
  };
  globalThis.relumeLive = open(globalThis.relume, parsed, blocks, /[#&]march=always/.test(location.hash));
}
