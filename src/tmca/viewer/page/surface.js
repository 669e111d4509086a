// A depth map as a surface with the colours of its scene, turned by hand; which pixel lies below a pointer.
import { program } from "./programs.js";

const RAISED = `#version 300 es
precision highp float;
precision highp sampler2D;
uniform sampler2D depth, colours;
uniform ivec2 mesh; // columns and rows of its points
uniform vec2 turn, span, aspect; // radians; nearest and farthest; columns and rows of the picture over the longer
uniform float zoom, relief, shape; // width of the panel over its height
out vec2 at;
out float known;
void main() {
  int cell = gl_VertexID / 6, corner = gl_VertexID - 6 * cell;
  ivec2 step = ivec2(corner == 1 || corner == 4 || corner == 5 ? 1 : 0, corner == 2 || corner == 3 || corner == 5 ? 1 : 0);
  ivec2 place = ivec2(cell % (mesh.x - 1), cell / (mesh.x - 1)) + step;
  at = vec2(place) / vec2(mesh - 1);
  ivec2 size = textureSize(depth, 0);
  float found = texelFetch(depth, min(ivec2(at * vec2(size)), size - 1), 0).r;
  known = found > 0.0 && found < 3.0e38 ? 1.0 : 0.0;
  float deep = clamp((found - span.x) / (span.y - span.x), -0.2, 1.2) - 0.5;
  vec3 point = vec3((at - 0.5) * aspect * vec2(1.0, -1.0), -relief * (known > 0.0 ? deep : 0.0));
  float cx = cos(turn.x), sx = sin(turn.x), cy = cos(turn.y), sy = sin(turn.y);
  point = vec3(cy * point.x + sy * point.z, point.y, cy * point.z - sy * point.x);
  point = vec3(point.x, cx * point.y - sx * point.z, cx * point.z + sx * point.y);
  float far = 2.4 - point.z;
  vec2 shown = point.xy * 4.4 * zoom / far;
  gl_Position = vec4(shape > 1.0 ? vec2(shown.x / shape, shown.y) : vec2(shown.x, shown.y * shape), (far - 2.4) / 3.0, 1.0);
}`;
const TEXTURED = `#version 300 es
precision highp float;
precision highp sampler2D;
in vec2 at;
in float known;
uniform sampler2D colours, map, depth;
uniform int mode; // 0 colours, 1 depth through a map, 2 the place itself
uniform vec2 span;
out vec4 shown;
void main() {
  if (known < 0.999) discard;
  if (mode == 2) {
    vec2 place = floor(at * 65535.0);
    shown = vec4(floor(place / 256.0), mod(place, 256.0)).xzyw / 255.0;
    return;
  }
  ivec2 size = mode == 0 ? textureSize(colours, 0) : textureSize(depth, 0);
  ivec2 pixel = min(ivec2(at * vec2(size)), size - 1);
  if (mode == 0) shown = vec4(texelFetch(colours, pixel, 0).rgb, 1.0);
  else shown = texelFetch(map, ivec2(int(clamp((texelFetch(depth, pixel, 0).r - span.x) / (span.y - span.x), 0.0, 1.0) * 255.0), 0), 0);
}`;
const MOST = 400; // points of a side of the mesh

export class Surface {
  constructor(gl) {
    this.gl = gl;
    this.program = program(gl, RAISED, TEXTURED);
    const names = ["depth", "colours", "map", "mesh", "turn", "span", "aspect", "zoom", "relief", "shape", "mode"];
    this.at = Object.fromEntries(names.map((name) => [name, gl.getUniformLocation(this.program, name)]));
    this.frame = gl.createFramebuffer();
    [this.colour, this.deep] = [gl.createRenderbuffer(), gl.createRenderbuffer()];
  }

  #target(width, height) {
    const gl = this.gl;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
    if (this.width === width && this.height === height) return;
    Object.assign(this, { width, height });
    for (const [buffer, format, place] of [[this.colour, gl.RGBA8, gl.COLOR_ATTACHMENT0], [this.deep, gl.DEPTH_COMPONENT16, gl.DEPTH_ATTACHMENT]]) {
      gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
      gl.renderbufferStorage(gl.RENDERBUFFER, format, width, height);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, place, gl.RENDERBUFFER, buffer);
    }
  }

  #render(painter, frame, { depth, colours, map, span, turn, zoom, relief }, mode) {
    const gl = this.gl, width = Math.max(Math.round(frame.w * painter.ratio), 1), height = Math.max(Math.round(frame.h * painter.ratio), 1);
    const textures = [painter.texture(depth, false), colours ? painter.texture(colours, true) : painter.map(map), painter.map(map)];
    this.#target(width, height);
    gl.viewport(0, 0, width, height);
    gl.disable(gl.SCISSOR_TEST);
    gl.clearColor(...(mode === 2 ? [0, 0, 0, 0] : [0.078, 0.082, 0.09, 1]));
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.useProgram(this.program);
    gl.disableVertexAttribArray(0);
    [this.at.depth, this.at.colours, this.at.map].forEach((place, unit) => painter.bind(unit, place, textures[unit]));
    const scale = Math.max(1, Math.max(depth.columns, depth.rows) / MOST), mesh = [Math.floor(depth.columns / scale), Math.floor(depth.rows / scale)], longer = Math.max(depth.columns, depth.rows);
    gl.uniform2i(this.at.mesh, ...mesh);
    gl.uniform2f(this.at.turn, ...turn);
    gl.uniform2f(this.at.span, ...span);
    gl.uniform2f(this.at.aspect, depth.columns / longer, depth.rows / longer);
    gl.uniform1f(this.at.zoom, zoom);
    gl.uniform1f(this.at.relief, relief);
    gl.uniform1f(this.at.shape, width / height);
    gl.uniform1i(this.at.mode, mode);
    gl.drawArrays(gl.TRIANGLES, 0, 6 * (mesh[0] - 1) * (mesh[1] - 1));
    gl.disable(gl.DEPTH_TEST);
  }

  draw(painter, frame, what) {
    const gl = this.gl;
    this.#render(painter, frame, what, what.colours ? 0 : 1);
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, this.frame);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, null);
    const left = Math.round(frame.x * painter.ratio), bottom = painter.canvas.height - Math.round(frame.y * painter.ratio) - this.height;
    gl.blitFramebuffer(0, 0, this.width, this.height, left, bottom, left + this.width, bottom + this.height, gl.COLOR_BUFFER_BIT, gl.NEAREST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  // The place of the picture, as shares of its width and height, at shares of the panel's; null beside the surface.
  pick(painter, frame, what, fx, fy) {
    const gl = this.gl, found = new Uint8Array(4);
    this.#render(painter, frame, what, 2);
    gl.readPixels(Math.floor(fx * this.width), Math.floor((1 - fy) * this.height), 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, found);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    const [x, y] = [found[0] * 256 + found[1], found[2] * 256 + found[3]];
    return x || y ? [x / 65535, y / 65535] : null;
  }
}
