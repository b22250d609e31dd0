// Shows pictures of half floats with WebGL: tone mapping, layers, and comparison with another picture.

const VERTEX = `#version 300 es
void main() {
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0;
  gl_Position = vec4(corner, 0, 1);
}`;

const FRAGMENT = `#version 300 es
precision highp float;
precision highp int;
uniform sampler2D picture, other;
uniform vec2 size;          // of the canvas, in pixels
uniform vec3 placement;     // left upper corner of the film on the canvas, and pixels of it for one of the film
uniform vec2 film;          // width and height
uniform vec4 part, otherPart; // left, top, width and height of what the pictures show, in pixels of the film
uniform float exposure;     // factor
uniform int curve;
uniform vec2 limits, otherLimits; // of layers; equal: it is light
uniform int comparison;     // 0: off, 1: split, 2: other, 3: difference
uniform float split;
uniform vec3 outside;       // colour beside the film
out vec4 colour;

vec3 encoded(vec3 c) { // sRGB, IEC 61966-2-1
  c = clamp(c, 0.0, 1.0);
  return mix(12.92 * c, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c));
}

vec3 hable(vec3 x) { // Hable 2010, "Uncharted 2: HDR Lighting"
  return (x * (0.15 * x + 0.05) + 0.004) / (x * (0.15 * x + 0.5) + 0.06) - 0.02 / 0.3;
}

vec3 aces(vec3 x) { // Narkowicz 2015, "ACES Filmic Tone Mapping Curve"
  return clamp(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 0.0, 1.0);
}

vec3 agx(vec3 c) { // Sobotka's AgX, as Wrensch approximates it (2023, "Minimal AgX Implementation")
  const mat3 inset = mat3(0.842479062253094, 0.0423282422610123, 0.0423756549057051,
                          0.0784335999999992, 0.878468636469772, 0.0784336,
                          0.0792237451477643, 0.0791661274605434, 0.879142973793104);
  const mat3 outset = mat3(1.19687900512017, -0.0528968517574562, -0.0529716355144438,
                           -0.0980208811401368, 1.15190312990417, -0.0980434501171241,
                           -0.0990297440797205, -0.0989611768448433, 1.15107367264116);
  vec3 x = clamp((log2(max(inset * c, 1e-10)) + 12.47393) / 16.5, 0.0, 1.0);
  vec3 y = ((((15.5 * x - 40.14) * x + 31.96) * x - 6.868) * x + 0.4298) * x * x + 0.1191 * x - 0.00232;
  return outset * y;
}

vec3 falseColour(float x) { // Mikhailov 2019, "Turbo, An Improved Rainbow Colormap"
  x = clamp(x, 0.0, 1.0);
  vec4 low = vec4(1, x, x * x, x * x * x);
  vec2 high = low.zw * low.z;
  float red = dot(low, vec4(0.13572138, 4.61539260, -42.66032258, 132.13108234));
  float green = dot(low, vec4(0.09140261, 2.19418839, 4.84296658, -14.18503333));
  float blue = dot(low, vec4(0.10667330, 12.64194608, -60.58204836, 110.36276771));
  return vec3(red + dot(high, vec2(-152.94239396, 59.28637943)),
              green + dot(high, vec2(4.27729857, 2.82956604)),
              blue + dot(high, vec2(-89.90310912, 27.34824973)));
}

float luminance(vec3 c) { return dot(c, vec3(0.2126, 0.7152, 0.0722)); }

vec3 shown(vec3 value, vec2 range) {
  if (range.y > range.x) {
    vec3 x = (value - range.x) / (range.y - range.x);
    return curve == 5 ? falseColour(x.x) : clamp(x, 0.0, 1.0);
  }
  vec3 c = max(value, 0.0) * exposure;
  if (curve == 1) return clamp(c, 0.0, 1.0);
  if (curve == 2) return encoded(hable(2.0 * c) / hable(vec3(11.2)));
  if (curve == 3) return encoded(aces(0.6 * c));
  if (curve == 4) return clamp(agx(c), 0.0, 1.0);
  if (curve == 5) return falseColour((log2(max(luminance(c), 1e-9)) + 8.0) / 12.0); // 2^-8 to 2^4
  return encoded(c);
}

vec3 read(sampler2D from, vec4 of, vec2 at) { return texture(from, (at - of.xy) / of.zw).rgb; }

bool within(vec2 at, vec4 of) { return all(greaterThanEqual(at, of.xy)) && all(lessThan(at, of.xy + of.zw)); }

void main() {
  vec2 pixel = vec2(gl_FragCoord.x, size.y - gl_FragCoord.y);
  vec2 at = (pixel - placement.xy) / placement.z;
  bool second = comparison == 2 || (comparison == 1 && pixel.x > split * size.x);
  vec4 of = second ? otherPart : part;
  if (!within(at, of)) {
    bool onFilm = within(at, vec4(0, 0, film));
    colour = vec4(onFilm ? outside * 0.7 : outside, 1);
    return;
  }
  vec3 a = second ? read(other, otherPart, at) : read(picture, part, at);
  if (comparison == 3) {
    vec3 d = (a - read(other, otherPart, at)) * exposure;
    float m = clamp(dot(d, vec3(1)) / 3.0, -1.0, 1.0); // red: brighter than the other picture, blue: darker
    colour = vec4(mix(vec3(1), m > 0.0 ? vec3(0.8, 0.1, 0.05) : vec3(0.05, 0.2, 0.8), sqrt(abs(m))), 1);
  } else colour = vec4(shown(a, second ? otherLimits : limits), 1);
  if (comparison == 1 && abs(pixel.x - split * size.x) < 1.0) colour = vec4(1);
}`;

export const CURVES = ["srgb", "linear", "filmic", "aces", "agx", "false"];
export const COMPARISONS = ["off", "split", "flip", "difference"];

export class Display {
  // `say` shows a message.
  constructor(canvas, say) {
    this.canvas = canvas;
    this.gl = canvas.getContext("webgl2", { antialias: false, preserveDrawingBuffer: true });
    if (!this.gl) throw new Error("This browser has no WebGL 2, which shows the pictures.");
    this.prepare();
    canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault(); // it may be restored
      say("The browser has lost the graphics context; the picture comes back with it.", true);
    });
    canvas.addEventListener("webglcontextrestored", () => {
      this.prepare();
      for (const [slot, image] of Object.entries(this.pictures))
        if (image) this.set(slot, { ...image, texture: undefined });
      say("");
    });
    this.pictures = { picture: null, other: null };
    this.film = [1, 1];
    this.zoom = null; // canvas pixels for one of the film; null: as large as it fits
    this.centre = [0.5, 0.5]; // of the canvas, in the film's width and height
    this.settings = { exposure: 0, curve: "srgb", comparison: "off", split: 0.5 };
    this.frames = 0;
    new ResizeObserver(() => this.draw()).observe(canvas);
    matchMedia("(prefers-color-scheme: light)").addEventListener("change", () => this.draw());
  }

  prepare() {
    const { gl } = this;
    this.program = linked(gl);
    this.uniforms = {};
    for (let i = 0; i < gl.getProgramParameter(this.program, gl.ACTIVE_UNIFORMS); ++i) {
      const { name } = gl.getActiveUniform(this.program, i);
      this.uniforms[name] = gl.getUniformLocation(this.program, name);
    }
  }

  // Shows pixels { pixels: halves or floats, width, height, window, limits } as "picture" or "other".
  set(slot, image) {
    const gl = this.gl;
    const old = this.pictures[slot]?.texture;
    const texture = old && gl.isTexture(old) ? old : gl.createTexture(); // those of a lost context are none
    const halves = image.pixels instanceof Uint16Array;
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 2);
    gl.texImage2D(
      gl.TEXTURE_2D,
      0,
      gl.RGB16F,
      image.width,
      image.height,
      0,
      gl.RGB,
      halves ? gl.HALF_FLOAT : gl.FLOAT,
      image.pixels,
    );
    for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T])
      gl.texParameteri(gl.TEXTURE_2D, side, gl.CLAMP_TO_EDGE);
    this.pictures[slot] = { ...image, texture };
    this.draw();
  }

  update(settings) {
    Object.assign(this.settings, settings);
    this.draw();
  }

  // Left upper corner of the film on the canvas, and the size of its pixels.
  placement() {
    const { width, height } = this.canvas;
    const fitting = Math.min(width / this.film[0], height / this.film[1]);
    const scale = this.zoom ?? fitting;
    const [x, y] = this.zoom === null ? [0.5, 0.5] : this.centre;
    return [width / 2 - x * scale * this.film[0], height / 2 - y * scale * this.film[1], scale];
  }

  // The pixel of the film at a position in the page; fractions count.
  pixelAt(clientX, clientY) {
    const box = this.canvas.getBoundingClientRect();
    const ratio = this.canvas.width / box.width;
    const [left, top, scale] = this.placement();
    return [((clientX - box.left) * ratio - left) / scale, ((clientY - box.top) * ratio - top) / scale];
  }

  // Magnifies by a factor; the pixel at a position in the page stays there.
  magnify(factor, clientX, clientY) {
    const at = this.pixelAt(clientX, clientY);
    const scale = this.placement()[2];
    this.centre = this.zoom === null ? [0.5, 0.5] : this.centre;
    this.zoom = Math.min(Math.max(scale * factor, 0.05), 128);
    const now = this.pixelAt(clientX, clientY);
    this.centre = this.centre.map((c, i) => c + (at[i] - now[i]) / this.film[i]);
    this.draw();
  }

  draw() {
    if (this.scheduled) return;
    this.scheduled = true;
    requestAnimationFrame(() => {
      this.scheduled = false;
      this.drawNow();
    });
  }

  drawNow() {
    const { gl, canvas, uniforms, settings } = this;
    if (gl.isContextLost()) return;
    const ratio = devicePixelRatio || 1;
    const width = Math.max(1, Math.round(canvas.clientWidth * ratio));
    const height = Math.max(1, Math.round(canvas.clientHeight * ratio));
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    gl.viewport(0, 0, width, height);
    const { picture, other } = this.pictures;
    const outside = getComputedStyle(canvas.parentElement)
      .backgroundColor.match(/\d+/g)
      .slice(0, 3)
      .map((c) => c / 255);
    if (!picture) {
      gl.clearColor(...outside, 1);
      gl.clear(gl.COLOR_BUFFER_BIT);
      return;
    }
    gl.useProgram(this.program);
    const placement = this.placement();
    const compared = other ? COMPARISONS.indexOf(settings.comparison) : 0;
    this.bind(0, picture, placement[2]);
    this.bind(1, other ?? picture, placement[2]);
    gl.uniform1i(uniforms.picture, 0);
    gl.uniform1i(uniforms.other, 1);
    gl.uniform2f(uniforms.size, width, height);
    gl.uniform3f(uniforms.placement, ...placement);
    gl.uniform2f(uniforms.film, ...this.film);
    gl.uniform4f(uniforms.part, ...picture.window);
    gl.uniform4f(uniforms.otherPart, ...(other ?? picture).window);
    gl.uniform1f(uniforms.exposure, 2 ** settings.exposure);
    gl.uniform1i(uniforms.curve, CURVES.indexOf(settings.curve));
    gl.uniform2f(uniforms.limits, ...(picture.limits ?? [0, 0]));
    gl.uniform2f(uniforms.otherLimits, ...((other ?? picture).limits ?? [0, 0]));
    gl.uniform1i(uniforms.comparison, compared);
    gl.uniform1f(uniforms.split, settings.split);
    gl.uniform3f(uniforms.outside, ...outside);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    this.frames++;
  }

  bind(unit, image, scale) {
    const { gl } = this;
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, image.texture);
    const complete = image.width >= image.window[2];
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, complete && scale >= 1.5 ? gl.NEAREST : gl.LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
    gl.activeTexture(gl.TEXTURE0);
  }

  // What the canvas shows of the film, in the film's size, as a PNG.
  png() {
    const { canvas } = this;
    const kept = [this.zoom, this.centre, canvas.style.cssText];
    [this.zoom, this.centre] = [1, [0.5, 0.5]];
    const ratio = devicePixelRatio || 1;
    canvas.style.cssText = `width: ${this.film[0] / ratio}px; height: ${this.film[1] / ratio}px`;
    this.drawNow();
    return new Promise((done) =>
      canvas.toBlob((blob) => {
        [this.zoom, this.centre, canvas.style.cssText] = kept;
        this.drawNow();
        done(blob);
      }),
    );
  }
}

function linked(gl) {
  const program = gl.createProgram();
  for (const [kind, source] of [
    [gl.VERTEX_SHADER, VERTEX],
    [gl.FRAGMENT_SHADER, FRAGMENT],
  ]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  return program;
}
