// Views of a light field, shifted and added up, into a texture.
import { program } from "./programs.js";

const WHOLE = `#version 300 es
in vec2 corner;
out vec2 at;
void main() { at = corner; gl_Position = vec4(corner * 2.0 - 1.0, 0.0, 1.0); }`;
const SHIFTED = `#version 300 es
precision highp float;
precision highp sampler2D;
in vec2 at;
uniform sampler2D view, map;
uniform bool mapped;
uniform vec2 place, size; // of the view among all: column, row; columns and rows of a picture
uniform float disparity, share;
out vec4 added;
void main() {
  float shift = mapped ? texture(map, at).r : disparity;
  if (!(abs(shift) < 1.0e4)) shift = 0.0;
  vec2 from = at - place * shift / size;
  if (any(lessThan(from, vec2(0.0))) || any(greaterThan(from, vec2(1.0)))) discard; // views that do not reach a border do not count
  added = vec4(texture(view, from).rgb * share, share);
}`;

export class Refocusing {
  constructor(gl) {
    this.gl = gl;
    gl.getExtension("EXT_color_buffer_float");
    gl.getExtension("EXT_color_buffer_half_float");
    this.program = program(gl, WHOLE, SHIFTED);
    this.at = Object.fromEntries(["view", "map", "mapped", "place", "size", "disparity", "share"].map((name) => [name, gl.getUniformLocation(this.program, name)]));
    this.frame = gl.createFramebuffer();
    this.made = new Map();
  }

  // The mean of views { plane, v, u } at a disparity, or at that of every pixel of a plane; 8 bits a colour.
  mean(painter, key, views, [rows, columns], disparity) {
    const gl = this.gl, target = this.#target(key, columns, rows), map = typeof disparity === "number" ? null : painter.texture(disparity, false);
    const textures = views.map((view) => painter.texture(view.plane, true));
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, target, 0);
    gl.disable(gl.SCISSOR_TEST);
    gl.viewport(0, 0, columns, rows);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.useProgram(this.program);
    painter.square();
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE);
    gl.uniform2f(this.at.size, columns, rows);
    gl.uniform1i(this.at.mapped, map ? 1 : 0);
    gl.uniform1f(this.at.share, 1 / views.length);
    if (!map) gl.uniform1f(this.at.disparity, disparity);
    painter.bind(1, this.at.map, map ?? textures[0]);
    views.forEach(({ v, u }, number) => {
      gl.uniform2f(this.at.place, u, v);
      painter.bind(0, this.at.view, textures[number]);
      for (const side of ["MIN_FILTER", "MAG_FILTER"]) gl.texParameteri(gl.TEXTURE_2D, gl[`TEXTURE_${side}`], gl.LINEAR);
      gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
      for (const side of ["MIN_FILTER", "MAG_FILTER"]) gl.texParameteri(gl.TEXTURE_2D, gl[`TEXTURE_${side}`], gl.NEAREST);
    });
    gl.disable(gl.BLEND);
    const data = new Float32Array(columns * rows * 4), kept = new Uint8Array(columns * rows * 3);
    gl.readPixels(0, 0, columns, rows, gl.RGBA, gl.FLOAT, data);
    for (let from = 0, to = 0; from < data.length; from += 4) {
      const scale = 255 / (data[from + 3] || 1);
      for (let part = 0; part < 3; part++) kept[to++] = Math.min(data[from + part] * scale + 0.5, 255);
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    return kept;
  }

  #target(key, columns, rows) {
    const gl = this.gl, wanted = `${key}/${columns}/${rows}`;
    if (!this.made.has(wanted)) {
      const texture = gl.createTexture();
      gl.activeTexture(gl.TEXTURE0);
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA16F, columns, rows);
      this.made.set(wanted, texture);
    }
    return this.made.get(wanted);
  }
}
