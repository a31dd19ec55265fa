// Relume's page: unpacks the accumulators of a rendered volume, mixes its lights, and draws the picture.
// docs/theory/page.md of Relume derives the encoding; docs/PAGE.md describes the page. No library, no network.

/* global LIVE */ // True in pages that march a volume (live.js); set by scripts/page_script.

// ---- colour: the twins of film::RelightMatrices and of document::Dial, in f64 ----

const { abs, floor, hypot, max, min, round } = Math, BANDS = 81;
const apply = (m, v) => m.map((row) => row[0] * v[0] + row[1] * v[1] + row[2] * v[2]);
const product = (a, b) => a.map((row) => [0, 1, 2].map((j) => row[0] * b[0][j] + row[1] * b[1][j] + row[2] * b[2][j]));
const dot = (a, b) => a.reduce((sum, value, i) => sum + value * b[i], 0);
const clamp = (value, low, high) => min(high, max(low, value));

function inverse(m) {
  const minor = (i, j) => {
    const [a, b] = [0, 1, 2].filter((n) => n !== i), [c, d] = [0, 1, 2].filter((n) => n !== j);
    return (m[a][c] * m[b][d] - m[a][d] * m[b][c]) * ((i + j) % 2 ? -1 : 1);
  };
  const whole = m[0][0] * minor(0, 0) + m[0][1] * minor(0, 1) + m[0][2] * minor(0, 2);
  return [0, 1, 2].map((i) => [0, 1, 2].map((j) => minor(j, i) / whole));
}

/** A light of relative powers, scaled so that a perfect reflector has Y = 1. */
function lightOf(page, powers) {
  const luminance = dot(page.observers[0][1], powers);
  return { spectrum: luminance > 0 ? powers.map((power) => power / luminance) : powers };
}

/** Planck's law at 380, 385, … 780 nm, relative to 560 nm. */
function blackBody(kelvin) {
  const exponent = (nm) => 1.438776877e7 / (nm * kelvin);
  return Array.from({ length: BANDS }, (_, band) => {
    const nm = 380 + 5 * band;
    return (560 / nm) ** 5 * Math.exp(exponent(560) - exponent(nm)) * Math.expm1(-exponent(560)) / Math.expm1(-exponent(nm));
  });
}

/** XYZ of the components, of the background and of white under a light of weight 1, for observer 0 (1931) or 1 (1964). */
function coloursOf(page, light, seen) {
  light.known ??= [];
  if (!light.known[seen]) {
    const xyz = (surface) => page.observers[seen].map((matching) => {
      let sum = 0;
      for (let band = 0; band < BANDS; band++) sum += matching[band] * light.spectrum[band] * (surface ? surface[band] : 1);
      return sum;
    });
    const fitted = light.matrices?.[seen];
    const spectra = page.model ? page.model.spectra : page.components.map((one) => one.spectrum);
    const components = spectra.map((spectrum, i) => fitted ? fitted.slice(3 * i, 3 * i + 3) : xyz(spectrum));
    light.known[seen] = { components, behind: page.background ? xyz(page.background) : [0, 0, 0], white: xyz() };
  }
  return light.known[seen];
}

/** Linear sRGB of each plane under `mix`: lights with `position`, `weight`, and `light`. */
function matrices(page, mix, display) {
  const seen = display.observer === "1964" ? 1 : 0, k = (page.model ? page.model.spectra : page.components).length;
  const planes = page.channels.map(() => [0, 0, 0]), everywhere = Array.from({ length: k }, () => [0, 0, 0]);
  const white = [0, 0, 0], first = k * page.positions.length;
  const add = (sum, weight, xyz) => xyz.forEach((part, axis) => { sum[axis] += weight * part; });
  for (const { position, weight, light } of mix) {
    const colours = coloursOf(page, light, seen);
    colours.components.forEach((xyz, i) => { add(planes[position * k + i], weight, xyz); add(everywhere[i], weight, xyz); });
    if (page.background && !page.behind) add(planes[first], weight, colours.behind);
    add(white, weight, colours.white);
  }
  page.behind?.forEach((part, i) => add(planes[first + i], part, everywhere[i]));
  let shown = page.srgb;
  if (display.adapt && white[1] > 0) {
    const to = apply(page.cones, page.white), from = apply(page.cones, white.map((part) => part / white[1]));
    const scaled = page.cones.map((row, i) => row.map((part) => part * to[i] / from[i]));
    shown = product(shown, product(inverse(page.cones), scaled));
  }
  const vision = page.deficiencies.find((one) => one.name === display.vision);
  if (vision) shown = product(vision.matrix, shown);
  return planes.map((xyz) => apply(shown, xyz).map((part) => part * display.exposure));
}

/** Weights of the nodes of the dial: 1/distance from the hand, normalised over the nodes that are on. */
function dialWeights(nodes, hand) {
  const far = nodes.map(({ place }) => hypot(place[0] - hand[0], place[1] - hand[1])).map((d) => d < 1e-9 ? 0 : d);
  const nearest = min(Infinity, ...far.filter((_, i) => nodes[i].on));
  const near = far.map((d, i) => !nodes[i].on ? 0 : d <= nearest ? 1 : nearest / d);
  const sum = near.reduce((a, b) => a + b, 0);
  return near.map((part) => sum > 0 ? part / sum : 0);
}

/** `mix` times `master`, or with the luminance `master` on white. */
function mastered(page, mix, normalise, master) {
  const whole = normalise ? mix.reduce((sum, { weight, light }) => sum + weight * dot(page.observers[0][1], light.spectrum), 0) : 1;
  return mix.map((light) => ({ ...light, weight: light.weight * master / (whole > 0 ? whole : 1) }));
}

const encoded = (linear) => linear <= 0.0031308 ? 12.92 * linear : 1.055 * linear ** (1 / 2.4) - 0.055;
const codes = (rgb) => rgb.map((part) => round(255 * encoded(clamp(part, 0, 1))));
const css = (rgb) => `rgb(${codes(rgb).join(" ")})`;

/** Colour of a light itself, as bright as the screen can show it. */
function swatch(page, light) {
  const rgb = apply(page.srgb, coloursOf(page, light, 0).white).map((part) => max(part, 0));
  return css(rgb.map((part) => part / max(...rgb, 1e-9)));
}

// ---- unpacking ----

const breath = () => new Promise((go) => { const { port1, port2 } = new MessageChannel(); port1.onmessage = () => { port1.close(); go(); }; port2.postMessage(0); });

/** A function that lets the page be heard, whenever 12 ms are over. */
function pauses() {
  let began = performance.now();
  return async () => { if (performance.now() - began > 12) { await breath(); began = performance.now(); } };
}

/** Bytes of base64; a loop takes a twentieth of the time of `Uint8Array.from`. */
function fromBase64(text) {
  const letters = atob(text), bytes = new Uint8Array(letters.length);
  for (let i = 0; i < bytes.length; i++) bytes[i] = letters.charCodeAt(i);
  return bytes;
}

/** Inflates exactly `length` bytes. */
async function inflated(bytes, length) {
  const reader = new Response(bytes).body.pipeThrough(new DecompressionStream("deflate-raw")).getReader();
  const all = new Uint8Array(length), pause = pauses();
  for (let at = 0; ;) {
    const { value, done } = await reader.read();
    if (done ? at !== length : at + value.length > length) throw new Error(`no picture of ${length} bytes`);
    if (done) return all;
    all.set(value, at);
    at += value.length;
    await pause();
  }
}

/** What stored bytes add to their predictions: in planes of 8 bits the byte, in wide ones with the sign in the lowest bit. */
const NARROW = Int16Array.from({ length: 256 }, (_, code) => code), WIDE = NARROW.map((code) => code >> 1 ^ -(code & 1));

/**
 * Turns a row of codes into the next one, whose bytes begin at `first`: prediction (left + above − corner, within their range) plus
 * what the byte adds. Skips the ends that are empty in both: most of a picture is. `false` for a row of zeros.
 */
function nextRow(row, all, first, added, escaped) {
  const end = row.length - 1, wide = added === WIDE, mask = wide ? 65535 : 255;
  let from = 0, to = end;
  while (from <= end && (all[first + from] | row[from]) === 0) from++;
  if (from > end) return false;
  while ((all[first + to] | row[to]) === 0) to--;
  to = min(to + 1, end);
  let corner = from ? 0 : row[0], left = corner;
  for (let x = from; x <= to; x++) {
    const up = row[x], code = all[first + x];
    let value = left;
    if (up !== corner) {
      const low = left < up ? left : up, high = left < up ? up : left;
      value = corner >= high ? low : corner <= low ? high : left + up - corner;
    }
    if (code) value += wide && code === 255 ? escaped() : added[code];
    left = row[x] = value & mask;
    corner = up;
  }
  if (left) row.fill(left, to + 1);
  return true;
}

/** Planes of codes of a packed view, decoded in slices between which the page is heard. */
async function unpack(page, view, bytes) {
  const [width, height] = page.size, pixels = width * height, stored = page.channels.filter((one) => !one.empty).length * pixels;
  const all = await inflated(bytes, stored + 2 * page.large[view]), pause = pauses(), planes = [];
  let first = 0, large = stored;
  const escaped = () => {
    const code = all[large] | all[large + 1] << 8;
    large += 2;
    return code >> 1 ^ -(code & 1);
  };
  for (const { wide, empty } of page.channels) {
    const plane = new (wide ? Uint16Array : Uint8Array)(pixels), row = new plane.constructor(width);
    planes.push(plane);
    for (let y = 0; y < height && !empty; y++, first += width) {
      if (nextRow(row, all, first, wide ? WIDE : NARROW, escaped)) plane.set(row, y * width);
      if (y % 64 === 0) await pause();
    }
  }
  return planes;
}

/**
 * First pixel of each run of equal pixels, as beside a volume; then the number of pixels. Codes are compared two or four at a
 * time; the last few pixels are runs of their own.
 */
function runsOf(planes) {
  const pixels = planes[0].length, bytes = new Uint8Array(pixels).fill(1, pixels & ~3), pairs = new Uint16Array(pixels);
  for (const codes of planes) {
    const bits = 8 * codes.BYTES_PER_ELEMENT, [out, four] = [bits > 8 ? pairs : bytes, codes].map(({ buffer }) => new Uint32Array(buffer, 0, buffer.byteLength >> 2));
    for (let n = 0, before = 0; n < four.length; n++) {
      const word = four[n];
      out[n] |= word ^ (word << bits | before);
      before = word >>> 32 - bits;
    }
  }
  const runs = new Uint32Array(pixels + 1);
  let count = 1;
  for (let n = 1; n < pixels; n++) if (bytes[n] | pairs[n]) runs[count++] = n;
  runs[count] = pixels;
  return runs.subarray(0, count + 1);
}

/** For each channel its codes and their zero; those of groups are turned back, and squared already. */
async function turned(page, planes) {
  const BLOCK = 4096, pixels = planes[0].length, sum = new Float64Array(BLOCK), pause = pauses();
  const shown = planes.map((codes, i) => ({ codes, zero: page.channels[i].zero }));
  for (const { first, matrix } of page.groups) {
    // Eight roots at a time; those that are missing count with 0.
    const k = matrix.length, stride = 8 * Math.ceil(k / 8), roots = new Float64Array(stride * BLOCK), parts = shown.slice(first, first + k);
    const outs = matrix.map((_, j) => ({ squares: new Float32Array(pixels), weights: Float64Array.from({ length: stride }, (_, i) => matrix[i]?.[j] ?? 0) }));
    shown.splice(first, k, ...outs);
    for (let start = 0; start < pixels; start += BLOCK) {
      const size = min(BLOCK, pixels - start);
      parts.forEach(({ codes, zero }, i) => { for (let n = 0; n < size; n++) roots[i + n * stride] = codes[start + n] - zero; });
      for (const { squares, weights } of outs) {
        sum.fill(0);
        for (let i = 0; i < stride; i += 8) addEight(sum, roots, i, stride, weights, size, squares, start);
      }
      await pause();
    }
  }
  return shown;
}

/** Adds eight weighted roots from `i` to the sums, and sets their squares. */
function addEight(sum, roots, i, stride, weights, size, squares, start) {
  const [a, b, c, d, e, f, g, h] = weights.subarray(i, i + 8);
  for (let n = 0, at = i; n < size; n++, at += stride) {
    const root = sum[n] += a * roots[at] + b * roots[at + 1] + c * roots[at + 2] + d * roots[at + 3]
      + (e * roots[at + 4] + f * roots[at + 5] + g * roots[at + 6] + h * roots[at + 7]);
    squares[start + n] = root * abs(root);
  }
}

// ---- drawing: WebGL2 where a GPU is, and the same sums in JavaScript ----

let contexts = 0;

function codesTable() {
  const table = new Uint8Array(65536);
  for (let i = 0; i < 65536; i++) table[i] = round(255 * encoded(i / 65535));
  return table;
}

/** What a drawer is made for: size, channels and groups of a page. */
const shapeOf = ({ size, channels, groups, soft }) => JSON.stringify([soft, size, channels.length, channels.some(({ wide }) => wide), groups.map(({ first, matrix }) => [first, matrix.length])]);

/** Draws on a canvas by JavaScript. A drawer `takes` another page of the same shape. */
function plain(page, canvas) {
  const [width, height] = page.size, context = canvas.getContext("2d", { alpha: false });
  const image = context.createImageData(width, height), out = new Uint32Array(image.data.buffer), table = codesTable();
  const BLOCK = 4096, red = new Float32Array(BLOCK), green = new Float32Array(BLOCK), blue = new Float32Array(BLOCK);
  const addCodes = (codes, zero, first, count, r, g, b) => {
    for (let i = 0; i < count; i++) {
      const q = codes[first + i] - zero;
      if (q !== 0) {
        const v = q > 0 ? q * q : -q * q;
        red[i] += v * r; green[i] += v * g; blue[i] += v * b;
      }
    }
  };
  const addSquares = (squares, first, count, r, g, b) => {
    for (let i = 0; i < count; i++) {
      const v = squares[first + i];
      red[i] += v * r; green[i] += v * g; blue[i] += v * b;
    }
  };
  let shown = [], runs = [0];
  return {
    name: "JavaScript",
    takes(next) { page = next; },
    async load(planes) {
      const fresh = runsOf(planes), turning = await turned(page, planes.map((codes) => {
        const firsts = new codes.constructor(fresh.length - 1);
        for (let n = 0; n < firsts.length; n++) firsts[n] = codes[fresh[n]];
        return firsts;
      }));
      [shown, runs] = [turning, fresh];
    },
    draw(colours) {
      const toned = page.soft ? (most) => most > 0.75 ? (1 - 0.0625 / (most - 0.5)) / most : 1 : () => 1;
      const level = (value) => value <= 0 ? 0 : value >= 1 ? 65535 : (value * 65535 + 0.5) | 0;
      const parts = shown.map((one, c) => ({ ...one, rgb: colours[c].map((part) => part * page.channels[c].scale) }))
        .filter(({ rgb }) => rgb.some((part) => part));
      for (let first = 0, last = runs.length - 1; first < last; first += BLOCK) {
        const count = min(BLOCK, last - first);
        red.fill(0); green.fill(0); blue.fill(0);
        for (const { codes, zero, squares, rgb: [r, g, b] } of parts) {
          if (squares) addSquares(squares, first, count, r, g, b);
          else addCodes(codes, zero, first, count, r, g, b);
        }
        for (let i = 0, at = runs[first]; i < count; i++) {
          const r = red[i], g = green[i], b = blue[i], tone = toned(max(r, g, b));
          const colour = 0xff000000 | table[level(b * tone)] << 16 | table[level(g * tone)] << 8 | table[level(r * tone)];
          for (const end = runs[first + i + 1]; at < end; at++) out[at] = colour;
        }
      }
      context.putImageData(image, 0, 0);
    },
    end() {},
  };
}

/** Draws on a canvas by WebGL2; `null` where there is none, or its limits are too low. `forced` takes slow ones too. */
function accelerated(page, canvas, forced) {
  const gl = contexts < 8 && canvas.getContext("webgl2", {
    alpha: false, antialias: false, depth: false, preserveDrawingBuffer: true, failIfMajorPerformanceCaveat: !forced,
  });
  if (!gl) return null;
  // Four channels a layer; groups begin with a layer of their own.
  const slots = [];
  const groups = page.groups.map(({ first, matrix }) => {
    const layer = slots.length / 4, layers = Math.ceil(matrix.length / 4);
    for (let i = 0; i < 4 * layers; i++) slots.push(i < matrix.length ? first + i : -1);
    return { layer, layers };
  });
  const grouped = new Set(slots);
  page.channels.forEach((_, i) => { if (!grouped.has(i)) slots.push(i); });
  while (slots.length % 4) slots.push(-1);
  const [width, height] = page.size, layers = slots.length / 4, wide = page.channels.some((channel) => channel.wide);
  const turns = () => groups.flatMap(({ layers: n }, g) => {
    const blocks = [], { matrix } = page.groups[g];
    for (let to = 0; to < n; to++) for (let from = 0; from < n; from++) {
      for (let c = 0; c < 4; c++) for (let r = 0; r < 4; r++) blocks.push(matrix[4 * from + c]?.[4 * to + r] ?? 0);
    }
    return blocks;
  });
  const limit = (name) => gl.getParameter(gl[name]);
  if (max(width, height) > limit("MAX_TEXTURE_SIZE") || layers > limit("MAX_ARRAY_TEXTURE_LAYERS")
    || 4 * layers + turns().length / 4 + 2 > limit("MAX_FRAGMENT_UNIFORM_VECTORS")) return null;
  let turn = 0;
  const add = (layer, root) => `{ vec4 u = ${root}; vec4 v = u * abs(u); sum += vec3(dot(v, red[${layer}]), dot(v, green[${layer}]), dot(v, blue[${layer}])); }\n`;
  const code = (layer) => `(vec4(texelFetch(planes, ivec3(at, ${layer}), 0)) - zeros[${layer}])`;
  let body = groups.map(({ layer, layers: n }) => {
    let text = "";
    for (let i = 0; i < n; i++) text += `vec4 q${layer + i} = ${code(layer + i)};\n`;
    for (let to = 0; to < n; to++) text += add(layer + to, Array.from({ length: n }, (_, from) => `turn[${turn++}] * q${layer + from}`).join(" + "));
    return text;
  }).join("");
  for (let layer = groups.reduce((sum, group) => sum + group.layers, 0); layer < layers; layer++) body += add(layer, code(layer));
  const fragment = `#version 300 es
precision highp float; precision highp int; precision highp usampler2DArray;
uniform usampler2DArray planes;
uniform vec4 zeros[${layers}], red[${layers}], green[${layers}], blue[${layers}];
${turn ? `uniform mat4 turn[${turn}];` : ""}
out vec4 pixel;
void main() {
ivec2 at = ivec2(int(gl_FragCoord.x), ${height - 1} - int(gl_FragCoord.y));
vec3 sum = vec3(0);
${body}${page.soft ? "float most = max(sum.r, max(sum.g, sum.b)); if (most > 0.75) sum *= (1.0 - 0.0625 / (most - 0.5)) / most;" : ""}
sum = clamp(sum, 0.0, 1.0);
pixel = vec4(mix(12.92 * sum, 1.055 * pow(sum, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, sum)), 1);
}`;
  const program = gl.createProgram();
  for (const [kind, text] of [["VERTEX", "#version 300 es\nvoid main() { gl_Position = vec4(gl_VertexID == 1 ? 3 : -1, gl_VertexID == 2 ? 3 : -1, 0, 1); }"], ["FRAGMENT", fragment]]) {
    const shader = gl.createShader(gl[`${kind}_SHADER`]);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) return null;
  contexts++;
  gl.useProgram(program);
  const place = (name) => gl.getUniformLocation(program, name);
  const places = ["red", "green", "blue"].map(place);
  const stored = () => {
    gl.uniform4fv(place("zeros"), slots.map((slot) => page.channels[slot]?.zero ?? 0));
    if (turn) gl.uniformMatrix4fv(place("turn"), false, turns());
  };
  stored();
  gl.viewport(0, 0, width, height);
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  const target = gl.TEXTURE_2D_ARRAY;
  gl.bindTexture(target, gl.createTexture());
  gl.texStorage3D(target, 1, wide ? gl.RGBA16UI : gl.RGBA8UI, width, height, layers);
  for (const side of ["MIN", "MAG"]) gl.texParameteri(target, gl[`TEXTURE_${side}_FILTER`], gl.NEAREST);
  return {
    name: "WebGL",
    gl,
    takes(next) { page = next; stored(); },
    async load(planes) {
      const texels = new (wide ? Uint16Array : Uint8Array)(4 * width * height);
      for (let layer = 0; layer < layers; layer++) {
        for (let part = 0; part < 4; part++) {
          const plane = planes[slots[4 * layer + part]];
          for (let i = 0, at = part; i < width * height; i++, at += 4) texels[at] = plane ? plane[i] : 0;
        }
        gl.texSubImage3D(target, 0, 0, 0, layer, width, height, 1, gl.RGBA_INTEGER, wide ? gl.UNSIGNED_SHORT : gl.UNSIGNED_BYTE, texels);
        await breath();
      }
    },
    draw(colours) {
      places.forEach((at, axis) => gl.uniform4fv(at, slots.map((slot) => slot < 0 ? 0 : colours[slot][axis] * page.channels[slot].scale)));
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    },
    end() { contexts--; gl.getExtension("WEBGL_lose_context")?.loseContext(); },
  };
}

// ---- the page ----

const SVG = "http://www.w3.org/2000/svg";
let roots = 0;

/** An element: attributes, `on…` listeners, and children, which are text unless they are nodes. */
function el(tag, attributes = {}, ...children) {
  const made = /^(svg|path|line|circle|text|title|g|linearGradient|stop)$/.test(tag) ? document.createElementNS(SVG, tag) : document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) listen(made, name.slice(2), value);
    else if (value !== false && value != null) made.setAttribute(name, value === true ? "" : value);
  }
  made.append(...children.filter((child) => child != null));
  return made;
}

const listen = (node, types, act) => types.split(" ").forEach((type) => node.addEventListener(type, act));
/** Place of an event in a node, as fractions of its width and height. */
const placeIn = (node, { clientX, clientY }) => {
  const { left, top, width, height } = node.getBoundingClientRect();
  return [(clientX - left) / width, (clientY - top) / height];
};
const button = (text, onclick, attributes) => el("button", { type: "button", onclick, ...attributes }, text);
const slider = (label, min, max, step, oninput) => el("input", { type: "range", min, max, step, "aria-label": label, oninput });
const paragraph = (kind, ...children) => el("p", { class: kind }, ...children);
/** A text to be copied: an element that shows it, and what sets it. */
const copyable = (label) => {
  const text = el("input", { readonly: true, "aria-label": label, onfocus: () => text.select() });
  const copying = button("Copy", () => { text.select(); if (document.execCommand("copy")) copying.textContent = "Copied"; });
  return [el("div", { class: "source" }, text, copying), (now) => { if (text.value !== now) { text.value = now; copying.textContent = "Copy"; } }];
};
const percent = (part) => `${round(100 * part)} %`;
const short = (text, most = 16) => { const letters = [...text]; return letters.length > most ? `${letters.slice(0, most - 1).join("")}…` : text; };
// A name in a sentence: its bidi controls end with it.
const isolated = (name) => `\u2068${name}\u2069`;
// Text for a shell; letters that nobody sees, as those of text direction, by their numbers.
const quoted = (text) => /[\p{Cc}\p{Cf}]/u.test(text)
  ? `$'${text.replace(/['\\]/g, "\\$&").replace(/[\p{Cc}\p{Cf}]/gu, (letter) => `\\U${letter.codePointAt(0).toString(16).padStart(8, "0")}`)}'`
  : `'${text.replaceAll("'", "'\\''")}'`;
// Kinds of standard lights in the menu, and what a reader may know them as.
const KINDS = [["Daylight and lamps", /^(?!FL|LED)/], ["Fluorescent tubes", /^FL/], ["LEDs", /^LED/]];
const USUAL = { D50: "warm daylight", D65: "daylight", A: "tungsten lamp", E: "equal energy", FL11: "narrow bands" };
const HELP = "Tab reaches every control. Dial: arrows move the hand (Shift: farther), Home centres it; on a light, Enter shows it alone, Space switches it, arrows move it. P on the picture picks a pixel, which arrows move. Escape ends tour and pick.";
const TURNING = " Comma, full stop and arrows turn the picture.";

const digits = (value) => +(+value).toFixed(4);
/** Parts of the state of a marched volume: camera, cuts and densities, as text. */
const MARCHED = LIVE ? ["seen", "cut", "dense"] : [];
const standard = (page, name) => page.standards.find((one) => one.name === name);

/** The state as the fragment of an address: what differs from the page as it opens. */
function addressOf(page, state, now) {
  const onDial = state.by === "dial", out = new URLSearchParams(), put = (key, value, usual) => { if (String(value) !== String(usual)) out.set(key, value); };
  if (onDial) { out.set("hand", state.hand.map(digits)); } else put("by", "sliders", now.by);
  const off = ({ nodes }) => nodes.filter((node) => !node.on).map((node) => node.light), dark = off(state);
  if (onDial && String(dark) !== String(off(now))) for (const name of dark.length ? dark : [""]) out.append("off", name);
  state.nodes.forEach(({ light, place }, n) => put(`node.${light}`, place.map(digits), now.nodes[n].place.map(digits)));
  for (const key of ["stops", "adapt", "observer", "vision", "view", "pixel", "solo", ...MARCHED]) put(key, state[key] ?? "", now[key] ?? "");
  put("master", digits(state.master[+onDial]), now.master[+onDial]);
  put("keep", state.keep[+onDial], now.keep[+onDial]);
  page.lights.forEach(({ name }, i) => {
    const { on, value, source, kelvin, curve } = state.lights[i];
    if (!onDial) put(`light.${name}`, on ? digits(value) : "off", now.lights[i].on ? digits(now.lights[i].value) : "off");
    if (source) out.set(`spectrum.${name}`, source === "black body" ? kelvin : source === "drawn" ? curve.map((part) => round(99 * part)).join(" ") : source);
  });
  return out.toString();
}

/** `next`, the state of the page as it opens, with what an address says; nonsense in it is ignored. */
function stateOf(page, text, next) {
  const given = new URLSearchParams(text), pair = (key) => { const all = (given.get(key) ?? "").split(",").map(Number); return all.length === 2 && all.every(Number.isFinite) ? all : null; };
  const hand = pair("hand"), pixel = pair("pixel"), number = (key, usual) => given.has(key) && Number.isFinite(+given.get(key)) ? +given.get(key) : usual;
  next.by = hand && page.lights.length > 1 ? "dial" : given.get("by") === "sliders" ? "sliders" : next.by;
  if (hand) next.hand = hand;
  if (given.has("off")) { const off = given.getAll("off"); next.nodes.forEach((node) => { node.on = !off.includes(node.light); }); }
  for (const node of next.nodes) node.place = pair(`node.${node.light}`) ?? node.place;
  const m = +(next.by === "dial");
  next.master[m] = number("master", next.master[m]);
  if (given.has("keep")) next.keep[m] = given.get("keep") === "true";
  next.stops = clamp(number("stops", 0), -4, 4);
  if (given.has("adapt")) next.adapt = given.get("adapt") === "true";
  if (given.get("observer") === "1931" || given.get("observer") === "1964") next.observer = given.get("observer");
  next.vision = page.deficiencies.find(({ name }) => name === given.get("vision"))?.name ?? "";
  next.view = clamp(floor(number("view", next.view)), 0, page.views - 1);
  next.solo = next.by === "dial" ? -1 : clamp(floor(number("solo", -1)), -1, page.lights.length - 1);
  for (const key of MARCHED) next[key] = given.get(key) ?? "";
  if (pixel) next.pixel = pixel.map((part, axis) => clamp(floor(part), 0, page.size[axis] - 1));
  page.lights.forEach(({ name }, i) => {
    const light = next.lights[i], value = given.get(`light.${name}`), source = given.get(`spectrum.${name}`) ?? "";
    if (value) { light.on = value !== "off"; if (light.on && Number.isFinite(+value)) light.value = clamp(+value, 0, 1e9); }
    const curve = source.split(" ").map(Number);
    if (standard(page, source)) light.source = source;
    else if (curve.length === BANDS && curve.every(Number.isFinite)) { light.source = "drawn"; light.curve = curve.map((part) => clamp(part / 99, 0, 1)); }
    else if (+source >= 100 && Number.isFinite(+source)) { light.source = "black body"; light.kelvin = +source; }
  });
  return next;
}

/** The command of Relume for a state of the page, whose `mix` has the lights with their weights. */
function commandOf(page, state, dial, mix) {
  // The dial of the film, where only its hand was moved and nodes switched off; otherwise the lights themselves.
  const isOfFilm = state.by === "dial" && state.keep[1] === dial.normalise && state.master[1] === dial.master
    && state.lights.every(({ source }) => !source)
    && state.nodes.every((node, n) => node.on <= dial.nodes[n].on && String(node.place) === String(dial.nodes[n].place));
  const lights = isOfFilm
    ? ` --dial ${state.hand.map(digits)}${state.nodes.filter((node) => !node.on).map((node) => ` --nodes-off ${quoted(node.light)}`).join("")}`
    : mix.map(({ index, weight, position }) => {
      const { source, kelvin } = state.lights[index], { name, weight: stated } = page.lights[index];
      const other = source === "black body" ? `blackbody ${kelvin}` : source === "drawn" ? `drawn${index + 1}.csv` : source;
      return ` --light ${quoted(other ? `${other}@${page.positions[position]}=${digits(weight)}` : `${name}=${digits(weight / stated)}`)}`;
    }).join("");
  const seen = state.observer === page.observer ? "" : ` --observer ${state.observer}`;
  return `relume relight film.exr${lights}${seen} -o picture.png`;
}

/**
 * Builds the page in `root`. `bytes(view)` returns a packed view as a Uint8Array. Options: `draw` ("gl", "cpu"),
 * `address` (keeps the state in the page's address), `changed(state)`, `hint` (what a drag of the picture does). Returns the
 * state, the mix, `set`, `replace(page, bytes)` for other views of the same lights, and `end`.
 */
export function mount(root, page, bytes, options = {}) {
  if (page.format !== 2) throw new Error(`format ${page.format}, not 2`);
  const id = `relume-${++roots}`, columns = page.columns;
  const many = page.lights.length > 1, still = matchMedia("(prefers-reduced-motion: reduce)");
  const corner = (i, n) => [Math.sin(2 * Math.PI * i / n), Math.cos(2 * Math.PI * i / n)];
  const dial = page.dial ?? { normalise: true, master: 1, presets: [], nodes: page.lights.map((light, i) => ({ light: light.name, place: corner(i, page.lights.length), on: true })) };
  const opened = () => ({
    by: page.dial?.hand && many ? "dial" : "sliders", hand: [...dial.hand ?? [0, 0]],
    nodes: dial.nodes.map((node) => ({ ...node, place: [...node.place] })), keep: [false, dial.normalise], master: [1, dial.master], solo: -1,
    lights: page.lights.map((light) => ({ on: light.shown !== 0, value: light.weight && light.shown ? light.shown / light.weight : 1, source: "", kelvin: 3000, curve: null })),
    stops: 0, adapt: page.adapt, observer: page.observer, vision: "", view: page.first, pixel: null, ...LIVE ? { seen: "", cut: "", dense: "" } : {},
  });
  let state = opened();
  const onDial = () => state.by === "dial", mode = () => +onDial();

  // Lights as they are mixed now.
  const made = new Map();
  const remembered = (key, make) => { if (!made.has(key)) { if (made.size > 200) made.clear(); made.set(key, make()); } return made.get(key); };
  const sourceOf = (i) => {
    const { source, kelvin, curve } = state.lights[i];
    if (source === "black body") return remembered(kelvin, () => lightOf(page, blackBody(kelvin)));
    if (source === "drawn") return remembered(curve.join(), () => lightOf(page, curve));
    return standard(page, source) ?? page.lights[i];
  };
  const shares = () => {
    if (!onDial()) return state.lights.map(({ on, value }, i) => on && (state.solo < 0 || state.solo === i) ? value : 0);
    const weights = dialWeights(state.nodes, state.hand);
    return page.lights.map((light) => state.nodes.reduce((sum, node, n) => sum + (node.light === light.name ? weights[n] : 0), 0));
  };
  const mixed = () => {
    const parts = shares();
    const mix = page.lights.map((light, i) => ({ index: i, position: light.position, weight: light.weight * parts[i], light: sourceOf(i) }));
    return mastered(page, mix.filter((light) => light.weight !== 0), state.keep[mode()], state.master[mode()]);
  };
  const coloursNow = () => matrices(page, mixed(), { ...state, exposure: page.exposure * 2 ** state.stops });
  const inWords = () => shares().map((part, i) => `${isolated(page.lights[i].name)} ${part ? percent(part) : "off"}${state.lights[i].source ? ` as ${state.lights[i].source}` : ""}`).join(", ");

  const label = () => `${isolated(page.title)}. Light: ${inWords()}`;

  // The picture.
  const status = el("p", { class: "status", role: "status" }, ""), live = el("p", { class: "unseen", "aria-live": "polite" });
  const cross = el("span", { class: "cross", hidden: true }), frame = el("div", { class: "frame", tabindex: 0, role: "group", "aria-label": "Picture" }, cross);
  const proportioned = () => frame.style.setProperty("--aspect", page.size[0] / page.size[1]);
  proportioned();
  const lastRow = page.views / columns - 1, rowOf = (view) => floor(view / columns);
  const views = page.views > 1 && slider("View around the volume", 0, columns - 1, 1, () => change({ view: rowOf(state.view) * columns + +views.value }));
  const heights = page.views > columns && slider("Height of the view, in rows from the lowest", 0, lastRow, 1, () => change({ view: state.view % columns + (lastRow - heights.value) * columns }));
  let canvas, drawer, planes, losses = 0, waiting = false, shownView = -1, looking = false, measured = options.draw === "gl", ended = false, next = null, past = () => {};
  const packed = new Map();
  /** Makes canvas and drawer; those before stay until the picture is drawn. */
  const start = (software) => {
    const before = drawer, old = canvas, gone = past;
    past = () => { gone(); before?.end(); old?.remove(); canvas.hidden = false; past = () => {}; };
    const fresh = () => { if (canvas !== old) canvas.remove(); canvas = el("canvas", { width: page.size[0], height: page.size[1], role: "img", "aria-label": label(), hidden: !!old }); frame.prepend(canvas); };
    fresh();
    drawer = software ? null : accelerated(page, canvas, options.draw === "gl");
    if (!drawer) { fresh(); drawer = plain(page, canvas); }
    const mine = canvas;
    listen(mine, "webglcontextlost", (event) => { event.preventDefault(); if (!ended && mine === canvas) start(++losses > 1); });
    shownView = -1;
    look();
  };
  const isSlow = ({ gl, draw }) => {
    if (!gl || measured) return false;
    measured = true;
    const began = performance.now();
    draw(coloursNow());
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    return performance.now() - began > 50;
  };
  /** Shows the view of the state, then unpacks its neighbours; one view at a time, whatever changes meanwhile. */
  const look = async () => {
    if (looking || LIVE && drawer.live) return;
    looking = true;
    try {
      while (!ended && !(LIVE && drawer.live)) {
        if (next) {
          const fresh = next, first = await unpack(fresh.page, state.view, fresh.bytes(state.view));
          if (fresh !== next) continue;
          next = null;
          state.pixel &&= state.pixel.map((at, axis) => floor((at + 0.5) * fresh.page.size[axis] / page.size[axis]));
          const alike = shapeOf(page) === shapeOf(fresh.page);
          ({ page, bytes } = fresh);
          made.clear();
          packed.clear();
          packed.set(state.view, first);
          proportioned();
          rounded();
          shownView = -1;
          if (alike) drawer.takes(page); else start(!drawer.gl);
        }
        const { view } = state, mine = drawer;
        const wanted = view === shownView ? [1, -1].map((step) => turnedBy(view, step)).find((near) => !packed.has(near)) : view;
        if (wanted === undefined) break;
        if (!packed.has(wanted)) packed.set(wanted, await unpack(page, wanted, bytes(wanted)));
        if (next || wanted !== view || view !== state.view || mine !== drawer || ended) continue;
        while (packed.size > 10) packed.delete([...packed.keys()].sort((a, b) => abs(b - view) - abs(a - view))[0]);
        await mine.load(packed.get(view));
        if (mine !== drawer || ended) continue;
        planes = packed.get(view);
        shownView = view;
        if (isSlow(mine)) { start(true); continue; }
        // That of a live page says why its volume cannot be turned.
        if (!LIVE) status.textContent = "";
        drawer.draw(coloursNow());
        past();
        root.dataset.ready = drawer.name;
        draw();
      }
    } catch (error) {
      root.dataset.failed = "";
      status.textContent = `The picture cannot be unpacked: ${error.message}`;
    } finally { looking = false; }
  };
  const turnedBy = (view, step, rows = 0) => {
    const row = clamp(rowOf(view) + rows, 0, lastRow);
    return row * columns + (view % columns + step + columns) % columns;
  };
  const draw = () => {
    if (waiting || shownView < 0) return;
    waiting = true;
    requestAnimationFrame(() => { waiting = false; if (!ended && shownView >= 0) { drawer.draw(coloursNow(), canvas); probe(); } });
  };

  // The dial.
  // Names are below the nodes.
  const SIDE = 320, MIDDLE = SIDE / 2 - 16, places = state.nodes.map((node) => node.place).concat([[0, 0]], dial.presets.map((preset) => preset.hand));
  const span = (axis) => [min(...places.map((place) => place[axis])), max(...places.map((place) => place[axis]))];
  const [[left, right], [bottom, top]] = [span(0), span(1)], size = max(right - left, top - bottom, 1e-6), scale = (SIDE - 110) / size;
  const onScreen = ([x, y]) => [SIDE / 2 + (x - (left + right) / 2) * scale, MIDDLE - (y - (bottom + top) / 2) * scale];
  const onPlane = (event) => {
    const at = placeIn(svg, event).map((part) => clamp(part * SIDE, 8, SIDE - 8));
    return [(at[0] - SIDE / 2) / scale + (left + right) / 2, (MIDDLE - at[1]) / scale + (bottom + top) / 2];
  };
  const rays = el("g"), svg = el("svg", { viewBox: `0 0 ${SIDE} ${SIDE}`, class: "dial", role: "group", "aria-label": "Light dial" }, rays);
  const nodeOf = (light) => state.nodes.find((node) => node.light === light);
  const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
  const step = (event, place) => {
    const arrow = arrows[event.key];
    if (!arrow) return null;
    event.preventDefault();
    return place.map((part, axis) => clamp(part + arrow[axis] * size * (event.shiftKey ? 0.1 : 0.02), [left, bottom][axis] - size / 5, [right, top][axis] + size / 5));
  };
  const marks = state.nodes.map((node, n) => {
    const mark = el("g", { class: "node", role: "checkbox", tabindex: 0, onkeydown: (event) => {
      const here = state.nodes[n], to = step(event, here.place);
      if (to) { here.place = to; change({}); }
      if (event.key === "Enter") { here.on = true; change({ by: "dial", hand: [...here.place] }); }
      if (event.key === " ") { event.preventDefault(); here.on = !here.on; change({ by: "dial" }); }
    } }, el("circle", { r: 24, class: "reach" }), el("circle", { r: 15, class: "disc" }), el("text", { y: 34 }, short(node.light)), el("text", { y: 50, class: "part" }), el("title", {}, `${isolated(node.light)}: click for this light alone, Shift and drag to move it`));
    svg.append(mark);
    return mark;
  });
  const hand = el("g", { class: "hand", role: "slider", tabindex: 0, "aria-label": "Hand of the light dial", "aria-valuemin": 0, "aria-valuemax": 100, onkeydown: (event) => {
    const to = step(event, state.hand) ?? (event.key === "Home" ? [0, 0] : null);
    if (to) { event.preventDefault(); change({ by: "dial", hand: to }); }
  } }, el("circle", { r: 26, class: "halo" }), el("circle", { r: 13, class: "grip" }), el("circle", { r: 4, class: "dot" }));
  svg.append(hand);
  // Lights are moved by Shift and a drag, or by any drag while the button is pressed, as a finger has no Shift.
  let moving = null, arranging = false;
  const arrange = button("Move lights", () => { arranging = !arranging; arrange.setAttribute("aria-pressed", arranging); refresh(); }, { "aria-pressed": "false" });
  listen(svg, "pointerdown", (event) => {
    const n = marks.findIndex((mark) => mark.contains(event.target));
    moving = (event.shiftKey || arranging) && n >= 0 ? state.nodes[n] : state;
    svg.setPointerCapture(event.pointerId);
    if (n >= 0) state.nodes[n].on = true;
    if (moving === state) change({ by: "dial", hand: n >= 0 ? [...state.nodes[n].place] : onPlane(event) });
    moving.from = [event.clientX, event.clientY];
  });
  listen(svg, "pointermove", (event) => {
    if (!moving || hypot(event.clientX - moving.from[0], event.clientY - moving.from[1]) < 3) return;
    const at = onPlane(event);
    if (moving !== state) { moving.place = at; change({}); return; }
    // The hand snaps to a node.
    const near = state.nodes.find((node) => node.on && hypot(node.place[0] - at[0], node.place[1] - at[1]) * scale < 9);
    change({ by: "dial", hand: near ? [...near.place] : at });
  });
  listen(svg, "pointerup pointercancel", () => { moving = null; });
  const isOn = (preset, { light }, n) => (dial.nodes[n].on || !!preset.on?.includes(light)) && !preset.off.includes(light);
  const usePreset = (preset, show) => {
    state.nodes.forEach((node, n) => { node.on = isOn(preset, node, n); });
    show({ by: "dial", hand: [...preset.hand] });
  };
  const presets = dial.presets.map((preset) => button(el("bdi", {}, preset.name), () => usePreset(preset, change), { title: preset.caption }));
  const caption = paragraph("caption");

  // A tour of the presets, or of the nodes.
  let tour = 0;
  const rest = () => { cancelAnimationFrame(tour); tour = 0; touring.textContent = "▶ Tour"; };
  const touring = button("▶ Tour", () => {
    if (tour) return rest();
    const stops = dial.presets.length > 1 ? dial.presets.map((preset) => preset.hand) : state.nodes.filter((node) => node.on).map((node) => node.place);
    if (stops.length < 2) return;
    touring.textContent = "■ Stop";
    let began, last = -1;
    const go = (now) => {
      began ??= now;
      const along = (now - began) / 3000, leg = floor(along), part = still.matches ? 0 : along - leg;
      const from = stops[leg % stops.length], to = stops[(leg + 1) % stops.length];
      if (leg !== last && dial.presets.length > 1) usePreset(dial.presets[leg % stops.length], show);
      if (leg !== last || part) show({ by: "dial", hand: from.map((x, axis) => x + (to[axis] - x) * part * part * (3 - 2 * part)) });
      last = leg;
      tour = requestAnimationFrame(go);
    };
    tour = requestAnimationFrame(go);
  });

  // The lights.
  const area = (spectrum) => `M${spectrum.map((value, i) => `${2 * i},${(42 - 40 * clamp(value / max(...spectrum, 1e-9), 0, 1)).toFixed(1)}`).join("L")}L160,44L0,44Z`;
  const plot = (attributes) => {
    const curve = el("path", { fill: `url(#${id}-hues)` });
    return [el("svg", { viewBox: "0 0 160 44", preserveAspectRatio: "none", class: "curve", ...attributes }, curve), (spectrum) => curve.setAttribute("d", area(spectrum))];
  };
  const hues = el("linearGradient", { id: `${id}-hues` }, ...[380, 440, 490, 510, 580, 620, 780].map((nm, i) => el("stop", { offset: (nm - 380) / 400, "stop-color": ["#40006a", "#3030ff", "#00b0d0", "#20c040", "#e0d000", "#ff4000", "#600000"][i] })));
  const rows = page.lights.map((light, i) => {
    const named = isolated(light.name), here = () => state.lights[i], set = (part) => { Object.assign(here(), part); change({}); };
    const on = el("input", { type: "checkbox", "aria-label": `${named}: on`, onchange: () => {
      if (onDial()) { const node = nodeOf(light.name); if (node) node.on = on.checked; change({}); } else set({ on: on.checked });
    } });
    const value = slider(`${named}: strength`, 0, 3, 0.01, () => { take(); set({ value: +value.value, on: true }); });
    const solo = button("solo", () => {
      const node = onDial() && nodeOf(light.name);
      if (node) { node.on = true; change({ hand: [...node.place] }); }
      else change({ solo: state.solo === i ? -1 : i });
    }, { class: "small", "aria-label": `${named}: solo` });
    const menu = el("select", { "aria-label": `${named}: spectrum`, onchange: () => {
      if (menu.value === "drawn" && !here().curve) here().curve = sourceOf(i).spectrum.map((part, _, all) => part / max(...all));
      set({ source: menu.value });
    } }, el("option", { value: "" }, "as rendered"), ...KINDS.map(([kind, first]) => el("optgroup", { label: kind }, ...page.standards.filter(({ name }) => first.test(name)).map(({ name }) => el("option", { value: name }, USUAL[name] ? `${name} (${USUAL[name]})` : name)))), el("option", {}, "black body"), el("option", { value: "drawn" }, "draw a curve"));
    const kelvin = slider(`${named}: temperature in kelvin`, 1500, 12000, 50, () => set({ kelvin: +kelvin.value }));
    let band = 40;
    const [drawing, plotted] = plot();
    const point = (at, height) => { const all = [...here().curve]; all[at] = clamp(height, 0, 1); set({ curve: all }); };
    listen(drawing, "keydown", (event) => {
      const arrow = here().source === "drawn" && arrows[event.key];
      if (!arrow) return;
      event.preventDefault();
      band = clamp(band + arrow[0], 0, 80);
      point(band, here().curve[band] + 0.05 * arrow[1]);
    });
    let before = null;
    listen(drawing, "pointerdown", (event) => { if (here().source === "drawn") { drawing.setPointerCapture(event.pointerId); before = -1; drawn(event); } });
    listen(drawing, "pointermove", (event) => { if (before !== null) drawn(event); });
    listen(drawing, "pointerup", () => { before = null; });
    const drawn = (event) => {
      const [across, down] = placeIn(drawing, event), at = clamp(round(across * 80), 0, 80);
      for (let b = before < 0 ? at : before; ; b += Math.sign(at - b)) { point(b, 1 - down); if (b === at) break; }
      before = at;
    };
    const disc = el("span", { class: "swatch" }), part = el("output"), note = paragraph("note");
    const update = (share) => {
      const now = sourceOf(i), { source } = here(), node = nodeOf(light.name);
      on.checked = onDial() ? !!node?.on : here().on;
      on.disabled = onDial() && !node;
      value.value = onDial() ? share : here().value;
      solo.setAttribute("aria-pressed", onDial() ? share === 1 : state.solo === i);
      kelvin.hidden = source !== "black body";
      kelvin.value = here().kelvin;
      menu.value = source;
      disc.style.background = swatch(page, now);
      part.textContent = !onDial() && state.solo >= 0 && state.solo !== i ? "off (solo)" : percent(share);
      plotted(now.spectrum);
      for (const [name, text] of Object.entries(source === "drawn" ? { role: "slider", tabindex: 0, "aria-label": `${named}: drawn spectrum`, "aria-valuemin": 0, "aria-valuemax": 100, "aria-valuenow": round(100 * here().curve[band]), "aria-valuetext": `${380 + 5 * band} nm: ${percent(here().curve[band])}` } : { role: "img", "aria-label": `Spectrum of ${named}, 380 to 780 nm` })) drawing.setAttribute(name, text);
      if (source !== "drawn") for (const { name } of [...drawing.attributes]) if (/^(tab|aria-v)/.test(name)) drawing.removeAttribute(name);
      drawing.classList.toggle("open", source === "drawn");
      const foreign = !page.model ? "" : now.matrices ? now.error > 0.1 ? `Colours under ${source || named} are within ΔE00 ${now.error.toFixed(2)}.` : "" : `From ${page.model.k} numbers a pixel: an estimate, within about ΔE00 ${page.model.error.toFixed(1)} for smooth spectra.`;
      note.textContent = (source === "black body" ? `${here().kelvin} K${foreign && ". "}` : source === "drawn" ? "Draw on the curve. " : "") + foreign;
    };
    return { row: el("li", {}, el("div", { class: "head" }, on, disc, el("bdi", { title: light.name }, short(light.name, 24)), part, solo), value, el("div", { class: "source" }, menu, drawing), kelvin, note), update };
  });
  /** Takes the mix of the dial over to the sliders. */
  const take = () => {
    if (!onDial()) return;
    shares().forEach((value, i) => { state.lights[i].value = value; state.lights[i].on = value > 0; });
    Object.assign(state, { by: "sliders", keep: [state.keep[1], state.keep[1]], master: [state.master[1], state.master[1]] });
  };

  // Display and the rest.
  const check = (label, get, set) => { const input = el("input", { type: "checkbox", onchange: () => { set(input.checked); change({}); } }); return { node: el("label", { class: "row" }, input, label), update: () => { input.checked = get(); } }; };
  const range = (label, low, high, by, get, set, words) => { const input = slider(null, low, high, by, () => { set(+input.value); change({}); }), out = el("output"); return { node: el("label", { class: "row" }, el("span", {}, label), input, out), update: () => { input.value = get(); out.textContent = words(get()); } }; };
  const choice = (label, entries, get, set) => { const input = el("select", { onchange: () => { set(input.value); change({}); } }, ...entries.map(([value, text]) => el("option", { value }, text))); return { node: el("label", { class: "row" }, el("span", {}, label), input), update: () => { input.value = get(); } }; };
  const controls = [
    range("Exposure", -4, 4, 0.1, () => state.stops, (v) => { state.stops = v; }, (v) => `${v > 0 ? "+" : ""}${v.toFixed(1)} EV`),
    range("Strength of all lights", 0, 4, 0.05, () => state.master[mode()], (v) => { state.master[mode()] = v; }, percent),
    check("Keep a white surface equally bright", () => state.keep[mode()], (v) => { state.keep[mode()] = v; }),
    check("White balance: the lights look white", () => state.adapt, (v) => { state.adapt = v; }),
    choice("Observer", [["1931", "CIE 1931, 2°"], ["1964", "CIE 1964, 10°"]], () => state.observer, (v) => { state.observer = v; }),
    choice("Colour vision", [["", "normal"], ...page.deficiencies.map(({ name }) => [name, `${name} (simulated)`])], () => state.vision, (v) => { state.vision = v; }),
  ];
  const zoom = button("Actual pixels", () => { zoom.textContent = frame.classList.toggle("whole") ? "Fit" : "Actual pixels"; });
  const [command, setCommand] = copyable("Command of Relume for this mix");
  const keep = (blob, name) => {
    const url = URL.createObjectURL(blob);
    el("a", { href: url, download: name }).click();
    setTimeout(() => URL.revokeObjectURL(url), 1e4);
  };
  const save = () => { drawer.draw(coloursNow(), canvas); canvas.toBlob((blob) => keep(blob, "picture.png")); };
  // Curves that were drawn, as the files that the command names.
  const curves = button("Save drawn curves", () => state.lights.forEach(({ source, curve }, i) => {
    if (source === "drawn") keep(new Blob([curve.map((power, band) => `${380 + 5 * band},${power.toFixed(4)}\n`).join("")]), `drawn${i + 1}.csv`);
  }));

  // The probe.
  const ticks = () => el("p", { class: "ticks", "aria-hidden": "true" }, ...[380, 480, 580, 680, "780 nm"].map((nm) => el("span", {}, nm)));
  const told = el("div", { class: "probe", hidden: true });
  /** Numbers of a pixel of a view. */
  const valuesAt = (at) => {
    const roots = page.channels.map(({ zero }, c) => planes[c][at] - zero);
    for (const { first, matrix } of page.groups) {
      const back = matrix.map((_, j) => matrix.reduce((sum, row, i) => sum + row[j] * roots[first + i], 0));
      back.forEach((root, j) => { roots[first + j] = root; });
    }
    return roots.map((root, c) => root * abs(root) * page.channels[c].scale);
  };
  const probe = () => {
    told.hidden = cross.hidden = !state.pixel;
    if (!state.pixel || !planes) return;
    const [x, y] = state.pixel, [width, height] = page.size, values = LIVE && drawer.live ? drawer.values(state.pixel) : valuesAt(y * width + x), colours = coloursNow();
    if (LIVE && !values) return;
    const rgb = [0, 1, 2].map((axis) => values.reduce((sum, value, c) => sum + value * colours[c][axis], 0));
    const { spectra } = page.model ?? { spectra: page.components.map((one) => one.spectrum) }, k = spectra.length;
    const sum = new Array(BANDS).fill(0), behind = values.slice(k * page.positions.length);
    for (const { position, weight, light } of mixed()) {
      for (let b = 0; b < BANDS; b++) {
        let part = page.background && !page.behind ? behind[0] * page.background[b] : 0;
        spectra.forEach((spectrum, i) => { part += (values[position * k + i] + (page.behind ? page.behind[i] * behind[i] : 0)) * spectrum[b]; });
        sum[b] += part * light.spectrum[b] * weight;
      }
    }
    const weights = page.model ? [] : page.components.map(({ name }, i) => [name, page.positions.reduce((all, _, p) => all + values[p * k + i], 0)]).filter(([, weight]) => weight > 5e-4).sort((a, b) => b[1] - a[1]);
    cross.style.left = `${100 * (x + 0.5) / width}%`;
    cross.style.top = `${100 * (y + 0.5) / height}%`;
    const disc = el("span", { class: "swatch" }), [chart, plotted] = plot({ role: "img", "aria-label": "Spectrum of the pixel, 380 to 780 nm" });
    plotted(sum);
    disc.style.background = css(rgb);
    told.replaceChildren(el("h2", {}, disc, ` Pixel ${x}, ${y}`), chart, ticks(),
      paragraph("hint", `sRGB ${codes(rgb).join(", ")}; relative spectrum`),
      weights.length ? el("h3", {}, "Material along the ray") : "", 
      ...weights.slice(0, 6).map(([name, weight]) => el("div", { class: "head" }, el("bdi", {}, short(name.replaceAll("_", " "), 24)), el("output", {}, weight.toFixed(3)))),
      ...page.model || weights.length ? [] : ["Background only."]);
  };
  const pick = (event) => {
    const at = placeIn(canvas, event).map((part, axis) => floor(part * page.size[axis]));
    change({ pixel: at.every((part, axis) => part >= 0 && part < page.size[axis]) ? at : null });
  };
  let grabbed = null;
  listen(frame, "pointerdown", (event) => { grabbed = { x: event.clientX, y: event.clientY, view: state.view, moved: false }; });
  listen(frame, "pointermove", (event) => {
    if (!grabbed || !event.buttons) return;
    const across = event.clientX - grabbed.x, down = event.clientY - grabbed.y;
    grabbed.moved ||= hypot(across, down) > 4;
    if (views && !(LIVE && drawer.live) && grabbed.moved) change({ view: turnedBy(grabbed.view, -round(across / frame.clientWidth * columns) % columns, round(down / 120)) });
  });
  listen(frame, "pointerup", (event) => { if (grabbed && !grabbed.moved) pick(event); grabbed = null; });
  listen(frame, "keydown", (event) => {
    const arrow = arrows[event.key], turn = { ",": -1, ".": 1 }[event.key];
    if (event.key === "p" || event.key === "P") change({ pixel: state.pixel ? null : page.size.map((side) => side >> 1) });
    if (arrow && state.pixel) change({ pixel: state.pixel.map((part, axis) => clamp(part + arrow[axis] * (axis ? -1 : 1) * (event.shiftKey ? 10 : 1), 0, page.size[axis] - 1)) });
    else if (views && !(LIVE && drawer.live) && (arrow || turn)) change({ view: turnedBy(state.view, turn ?? arrow[0], turn ? 0 : -arrow[1]) });
    if (arrow) event.preventDefault();
  });

  const address = () => addressOf(page, state, opened());
  let later = 0;
  /** Every change by hand ends a tour. */
  const change = (part) => { if (tour) rest(); show(part); };
  const show = (part) => {
    Object.assign(state, part);
    if (part.by === "dial") state.solo = -1;
    refresh();
    if (LIVE) drawer?.changed?.(state);
    if (state.view !== shownView && !(LIVE && drawer.live)) look(); else draw();
    clearTimeout(later);
    later = setTimeout(() => {
      live.textContent = inWords();
      if (options.address) try { history.replaceState(null, "", `#${address()}`); } catch { /* A frame without an address. */ }
    }, 400);
    options.changed?.(state);
  };
  const refresh = () => {
    const parts = shares(), at = onScreen(state.hand), weights = dialWeights(state.nodes, state.hand);
    rows.forEach((row, i) => row.update(parts[i]));
    controls.forEach((control) => control.update());
    rays.replaceChildren(...state.nodes.flatMap((node, n) => {
      const to = onScreen(node.place), ray = onDial() && weights[n] > 0 && el("line", { x1: at[0], y1: at[1], x2: to[0], y2: to[1], "stroke-width": 1 + 7 * weights[n] });
      if (ray) ray.style.opacity = 0.25 + 0.75 * weights[n];
      return ray ? [ray] : [];
    }));
    state.nodes.forEach((node, n) => {
      const i = page.lights.findIndex((light) => light.name === node.light), mark = marks[n];
      mark.setAttribute("transform", `translate(${onScreen(node.place)})`);
      const told = node.on || !onDial() ? percent(onDial() ? weights[n] : parts[i]) : "off";
      mark.setAttribute("aria-checked", node.on);
      mark.ariaLabel = `${isolated(node.light)}, ${told}`;
      mark.querySelector(".disc").style.fill = swatch(page, sourceOf(i));
      mark.querySelector(".part").textContent = told;
    });
    hand.setAttribute("transform", `translate(${at})`);
    hand.ariaValueNow = round(100 * max(...weights, 0));
    hand.ariaValueText = inWords();
    root.classList.toggle("by-dial", onDial());
    hint.textContent = arranging ? "Drag a light to another place." : onDial() ? "Drag the white hand: the nearer a light, the stronger it shines. The lights share 100 %." : "The sliders mix the lights. Drag the white hand to mix them here.";
    // A caption holds for the lights as they were rendered.
    const now = dial.presets.findIndex((preset) => onDial() && `${preset.hand.map(digits)}` === `${state.hand.map(digits)}` && state.nodes.every((node, n) => node.on === isOn(preset, node, n)) && state.lights.every(({ source }) => !source));
    presets.forEach((one, i) => one.setAttribute("aria-pressed", i === now));
    caption.textContent = dial.presets[now]?.caption ?? "";
    if (canvas) canvas.ariaLabel = label();
    words.replaceChildren(`Light: ${inWords()}. Display: `, settings);
    settings.textContent = [
      state.stops ? `exposure ${state.stops > 0 ? "+" : ""}${state.stops.toFixed(1)} EV` : "", `observer CIE ${state.observer}`,
      state.adapt ? "white balance" : "", state.vision && `colour vision: ${state.vision}, simulated`,
    ].filter(Boolean).join(", ");
    setCommand(commandOf(page, state, dial, mixed()));
    curves.hidden = state.lights.every(({ source }) => source !== "drawn");
    if (views) { views.value = state.view % columns; views.ariaValueText = `${round(360 * (state.view % columns) / columns)}°`; }
    if (heights) heights.value = lastRow - rowOf(state.view);
  };

  const about = el("p"), rounded = () => { if (page.largest_error != null) about.textContent = `Written by ${page.software}. The file holds ${LIVE ? "the volume, and its picture for every light" : "the picture for every light, not the volume"}. Rounding changes no colour by more than ΔE00 ${page.largest_error} (1 is just visible) under each light alone, each standard light, and the presets of the dial. The page loads and sends nothing.`; };
  rounded();
  const words = paragraph("words"), settings = el("span"), hint = paragraph("hint");
  root.classList.add("relume");
  root.replaceChildren(
    el("main", {}, el("h1", {}, el("bdi", {}, page.title)), el("div", { class: "surround" }, frame), views || "", heights || "", paragraph("hint", `${options.hint ?? (views ? "Drag to turn. " : "")}Click the picture for the spectrum of a pixel.`), status, words, live),
    el("aside", { "aria-label": "Light and display" },
      el("svg", { width: 0, height: 0, class: "unseen", "aria-hidden": "true" }, hues),
      el("section", { "aria-label": "Light" }, el("h2", {}, "Light"),
        many ? el("div", { class: "of-dial" }, svg, hint, el("div", { class: "buttons" }, ...presets, touring, arrange), caption) : "",
        told,
        el("ul", {}, ...rows.map(({ row }) => row))),
      el("section", { "aria-label": "Display" }, el("h2", {}, "Display"), ...controls.map(({ node }) => node), el("div", { class: "buttons" }, zoom, button("Reset all", () => { if (arranging) arrange.click(); if (zoom.textContent === "Fit") zoom.click(); change(opened()); }))),
      el("section", { "aria-label": "Save and share" }, el("h2", {}, "Save and share"),
        el("div", { class: "buttons" }, button("Save PNG", save), button("Print", () => print()), curves),
        options.address ? paragraph("hint", LIVE ? "The address of this page holds light, display, view, cuts and densities: send what follows # with the file." : "The address of this page holds light and display: send it with the file.") : "",
        paragraph("hint", "The same light by Relume, from its film (without exposure, white balance and colour vision):"),
        command),
      el("details", {}, el("summary", {}, "Keys and about"), el("p", {}, HELP + (views ? TURNING : "")), about)));
  listen(root, "keydown", (event) => { if (event.key === "Escape") change({ pixel: null }); });
  listen(hand, "pointerdown", () => svg.classList.add("used"));
  if (options.address && location.hash.length > 1) state = stateOf(page, location.hash.slice(1), opened());
  const heard = () => { const text = location.hash.slice(1); if (text !== address()) change(stateOf(page, text, opened())); };
  if (options.address) addEventListener("hashchange", heard);
  refresh();
  live.textContent = inWords();
  start(options.draw === "cpu");
  return {
    get state() { return state; }, get drawer() { return drawer?.name; }, get colours() { return coloursNow(); },
    get mix() { return mixed(); },
    set: change,
    replace(page, bytes) { next = { page, bytes }; look(); },
    ...LIVE ? {
      draw, frame, page,
      get ended() { return ended; },
      /** Draws by `painter`, whose film is that of a march, in place of the views; without one, by the views again. */
      adopt(painter) {
        frame.classList.toggle("live", !!painter);
        for (const control of [views, heights]) if (control) control.hidden = !!painter;
        if (!painter) { drawer = null; return start(false); }
        const [before, old] = [drawer, canvas];
        past();
        canvas = el("canvas", { width: page.size[0], height: page.size[1], role: "img", "aria-label": label() });
        frame.prepend(canvas);
        old.remove();
        before.end();
        drawer = painter;
        shownView = state.view;
        painter.changed(state);
        drawer.draw(coloursNow(), canvas);
        root.dataset.ready = drawer.name;
        draw();
      },
    } : {},
    end() { ended = true; rest(); clearTimeout(later); removeEventListener("hashchange", heard); past(); drawer?.end(); root.replaceChildren(); },
  };
}

/** Opens the page of this document: its data blocks, in place of the picture without JavaScript. */
function openPage() {
  const text = (name) => document.getElementById(name).textContent, page = JSON.parse(text("relume-page"));
  const bytes = (view) => fromBase64(text(`relume-view-${view}`));
  const draw = /^#draw=(gl|cpu)/.exec(location.hash)?.[1];
  globalThis.relume = mount(document.getElementById("relume"), page, bytes, { address: true, draw });
}

export { breath, button, clamp, copyable, css, el, fromBase64, inflated, listen, paragraph, pauses, slider };

// In a page, and not in a notebook; once.
if (document.querySelector("#relume-page") && !globalThis.relume?.set) openPage();
