// Planes through colour maps into rectangles of one canvas, by WebGL.
import { table } from "./colours.js";
import { program } from "./programs.js";
import { Refocusing } from "./refocusing.js";
import { ink } from "./theme.js";

const CORNERS = `#version 300 es
precision highp float;
in vec2 corner;
uniform vec4 place; // left, top, right, bottom in clip coordinates
out vec2 at;
void main() {
  at = corner;
  gl_Position = vec4(mix(place.xy, place.zw, corner), 0.0, 1.0);
}`;
const PIXELS = `#version 300 es
precision highp float;
precision highp sampler2D;
in vec2 at;
uniform sampler2D plane, other, map;
uniform int mode; // 0 values, 1 colours, 2 difference
uniform vec2 span;
uniform float power;
out vec4 shown;
void main() {
  ivec2 size = textureSize(plane, 0);
  vec4 found = texelFetch(plane, min(ivec2(at * vec2(size)), size - 1), 0);
  if (mode == 1) { shown = vec4(found.rgb, 1.0); return; }
  float value = found.r;
  if (mode == 2) {
    ivec2 beside = textureSize(other, 0);
    value -= texelFetch(other, min(ivec2(at * vec2(beside)), beside - 1), 0).r;
  }
  if (!(abs(value) < 3.0e38)) {
    float stripe = mod(floor((gl_FragCoord.x + gl_FragCoord.y) / 4.0), 2.0);
    shown = vec4(mix(vec3(0.22, 0.13, 0.2), vec3(0.3, 0.18, 0.27), stripe), 1.0);
    return;
  }
  float level = clamp((value - span.x) / (span.y - span.x), 0.0, 1.0);
  if (power != 1.0) level = pow(level, power);
  shown = texelFetch(map, ivec2(int(level * 255.0 + 0.5), 0), 0);
}`;
const MOST_BYTES = 500e6;

export class Painter {
  constructor(canvas) {
    this.canvas = canvas;
    this.gl = canvas.getContext("webgl2", { antialias: false, alpha: false, depth: false });
    if (!this.gl) throw new Error("This browser has no WebGL 2, which the pictures need. Use a recent Firefox, Chrome, Edge or Safari.");
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => (this.#begin(), this.restored?.()));
    this.#begin();
  }

  #begin() {
    const gl = this.gl;
    this.textures = new Map();
    this.maps = new Map();
    this.bytes = 0;
    this.refocusing = null;
    this.program = program(gl, CORNERS, PIXELS);
    this.at = Object.fromEntries(["place", "plane", "other", "map", "mode", "span", "power"].map((name) => [name, gl.getUniformLocation(this.program, name)]));
    this.corners = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.corners);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([0, 0, 1, 0, 0, 1, 1, 1]), gl.STATIC_DRAW);
  }

  // Make the canvas as large as it is on the screen, and empty.
  clear() {
    const { canvas, gl } = this;
    this.ratio = window.devicePixelRatio || 1;
    const width = Math.round(canvas.clientWidth * this.ratio), height = Math.round(canvas.clientHeight * this.ratio);
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    gl.disable(gl.SCISSOR_TEST);
    gl.viewport(0, 0, width, height);
    gl.clearColor(...ink.ground, 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
  }

  // Draw on a part of the canvas alone: x, y, width, height in CSS pixels.
  clip({ x, y, w, h }) {
    const { gl, ratio, canvas } = this;
    const box = [Math.round(x * ratio), canvas.height - Math.round((y + h) * ratio), Math.round(w * ratio), Math.round(h * ratio)];
    gl.viewport(...box);
    gl.scissor(...box);
    gl.enable(gl.SCISSOR_TEST);
  }

  // A plane into a part of the canvas: `frame` is the part, `box` where the whole plane would lie, { x, y, w, h }.
  draw(frame, box, { plane, minus = null, picture = false, map = "grey", span = [0, 1], power = 1 }) {
    const gl = this.gl;
    this.clip(frame);
    gl.useProgram(this.program);
    gl.disable(gl.DEPTH_TEST);
    this.square();
    const across = (value) => ((value - frame.x) / frame.w) * 2 - 1, down = (value) => 1 - ((value - frame.y) / frame.h) * 2;
    gl.uniform4f(this.at.place, across(box.x), down(box.y), across(box.x + box.w), down(box.y + box.h));
    const textures = [this.texture(plane, picture), this.texture(minus ?? plane, picture), this.map(map)]; // all made before any is bound
    [this.at.plane, this.at.other, this.at.map].forEach((place, unit) => this.bind(unit, place, textures[unit]));
    gl.uniform1i(this.at.mode, picture ? 1 : minus ? 2 : 0);
    gl.uniform2f(this.at.span, ...(span[1] > span[0] ? span : [span[0], span[0] + 1e-9]));
    gl.uniform1f(this.at.power, power);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  }

  square() {
    const gl = this.gl;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.corners);
    gl.enableVertexAttribArray(0);
    gl.disableVertexAttribArray(1);
    gl.vertexAttribPointer(0, 2, gl.FLOAT, false, 0, 0);
  }

  // The views { plane, v, u } of a light field, focused on a disparity, or on that of every pixel of a plane.
  refocus(key, views, [rows, columns], disparity) {
    this.refocusing ??= new Refocusing(this.gl);
    const size = [views[0].plane.rows, views[0].plane.columns], thinned = views[0].plane.step;
    const shift = typeof disparity === "number" ? disparity / thinned : disparity;
    return { key, data: this.refocusing.mean(this, key, views, size, shift), rows: size[0], columns: size[1], step: thinned, whole: [rows, columns] };
  }

  bind(unit, place, texture) {
    this.gl.activeTexture(this.gl.TEXTURE0 + unit);
    this.gl.bindTexture(this.gl.TEXTURE_2D, texture);
    this.gl.uniform1i(place, unit);
  }

  map(name) {
    if (!this.maps.has(name)) this.maps.set(name, this.#made(256, 1, table(name), "RGBA8", "RGBA", "UNSIGNED_BYTE"));
    return this.maps.get(name);
  }

  texture(plane, picture) {
    let held = this.textures.get(plane.key);
    if (held?.data !== plane.data) {
      if (held) this.#drop(plane.key, held);
      const kind = picture ? ["RGB8", "RGB", "UNSIGNED_BYTE"] : ["R32F", "RED", "FLOAT"];
      held = { data: plane.data, texture: this.#made(plane.columns, plane.rows, plane.data, ...kind) };
      this.bytes += plane.data.byteLength;
    }
    this.textures.delete(plane.key);
    this.textures.set(plane.key, held);
    for (const [key, old] of this.textures) {
      if (this.bytes <= MOST_BYTES || key === plane.key) break;
      this.#drop(key, old);
    }
    return held.texture;
  }

  #drop(key, held) {
    this.textures.delete(key);
    this.gl.deleteTexture(held.texture);
    this.bytes -= held.data.byteLength;
  }

  #made(columns, rows, data, inside, format, type) {
    const gl = this.gl, texture = gl.createTexture();
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl[inside], columns, rows, 0, gl[format], gl[type], data);
    for (const side of ["MIN_FILTER", "MAG_FILTER"]) gl.texParameteri(gl.TEXTURE_2D, gl[`TEXTURE_${side}`], gl.NEAREST);
    for (const side of ["S", "T"]) gl.texParameteri(gl.TEXTURE_2D, gl[`TEXTURE_WRAP_${side}`], gl.CLAMP_TO_EDGE);
    return texture;
  }
}
