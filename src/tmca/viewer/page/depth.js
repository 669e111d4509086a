// Scenes with depth: the map, and the surface with the scene's colours and spectra, turned by hand; its points as PLY.
import { USUAL } from "./colours.js";
import { clamp, element } from "./numbers.js";
import { Stack } from "./stack.js";
import { Surface } from "./surface.js";
import { save } from "./tools.js";

const START = { turn: [0.35, -0.55], zoom: 1, relief: 0.6 };

export class Depth extends Stack {
  build() {
    this.solid = structuredClone(START);
    super.build();
    const relief = element("input", { type: "range", min: 0.05, max: 1.5, step: 0.05, value: this.solid.relief, oninput: () => ((this.solid.relief = Number(relief.value)), this.redraw()) });
    relief.setAttribute("aria-label", "Relief of the surface");
    this.relief = relief;
    const group = element("section", { className: "group" }, element("h2", {}, "Surface"), element("div", { className: "row" }, element("label", {}, "relief"), relief), element("div", { className: "row" }, element("button", { className: "small", textContent: "as at the beginning", onclick: () => (Object.assign(this.solid, structuredClone(START)), (relief.value = START.relief), this.redraw()) }), element("button", { className: "small", textContent: "Points (PLY)", title: "Save the surface as coloured points", onclick: () => this.savePoints(this.items[0]) })), element("p", { className: "hint" }, "Drag the surface, or use the arrow keys on it, to turn it; the wheel zooms."));
    this.sideParts.splice(1, 0, group);
  }

  begin() {
    super.begin();
    for (const item of this.items) for (const layer of item.layers.slice(1)) this.planes.get(item.number, layer, 0).catch(() => {});
  }

  spec(item) {
    if (this.main(item).name !== "depth") return super.spec(item);
    this.coloured = true;
    return { ...super.spec(item), note: "" };
  }

  rows() {
    return ["depth", "confidence", "surface", ...super.rows()];
  }

  // Of one file the surface below all maps, else what belongs to a file below it.
  grid(specs) {
    const above = specs.filter((spec) => !spec.wide).length;
    return this.items.length > 1 ? super.grid(specs) : { columns: `repeat(${Math.min(above, 3)}, minmax(0, 1fr))`, rows: `minmax(0, 1fr) ${above > 3 ? "minmax(0, 1fr) " : ""}minmax(0, 1.25fr)` };
  }

  confidence(item) {
    return this.map(item, "confidence");
  }

  map(item, name) {
    const layer = item.layers.find((one) => one.name === name), key = `${item.number}/${name}`;
    if (!layer) return null;
    const plane = this.plane(key, item, layer, 0), look = this.lookOf(name, layer.label, USUAL[layer.colours], layer.span);
    const spec = { key, title: `${this.items.length > 1 ? `${item.title}: ` : ""}${layer.label}${layer.unit ? ` (${layer.unit})` : ""}`, size: layer.size, item, layer, index: 0, paint: { plane, map: look.map, span: look.span, power: look.power }, look: name, bar: { map: look.map, span: look.span, label: layer.unit ? `${layer.label} (${layer.unit})` : layer.label } };
    return { ...spec, note: this.valueAt(plane, spec) };
  }

  depth(item) {
    return this.map(item, "depth");
  }

  what(item) {
    const layer = item.layers.find((one) => one.name === "depth"), colour = item.layers.find((one) => one.name === "colour"), look = this.lookOf("depth", layer.label, USUAL.depth, layer.span);
    return { depth: this.plane(`${item.number}/depth`, item, layer, 0), colours: colour ? this.plane(`${item.number}/colour`, item, colour, 0) : null, map: look.map, span: look.span, ...this.solid };
  }

  surface(item) {
    const what = this.what(item), size = this.main(item).size, { painter } = this.app;
    const panel = () => this.panels.get(`${item.number}/surface`);
    const start = () => (this.held = [...this.solid.turn]);
    const rotate = (down, across) => ((this.solid.turn = [clamp(this.held[0] + down, -1.5, 1.5), this.held[1] + across]), this.redraw());
    const solid = () => (painter.surface ??= new Surface(painter.gl));
    return {
      key: `${item.number}/surface`, title: "surface", note: "drag to turn", wide: true, size, item, layer: null, plain: true, bar: null, solid: true, paint: { plane: what.depth, map: "grey", span: what.span },
      custom: (_, frame) => what.depth && solid().draw(painter, frame, what),
      dragStart: start, drag: (dx, dy) => rotate(dy * 0.008, dx * 0.008), steer: (down, across) => (start(), rotate(0.1 * down, 0.1 * across)),
      pick: ({ px, py }) => {
        const place = what.depth && solid().pick(painter, panel().frame, what, px, py);
        return place ? [clamp(Math.floor(place[1] * size[0]), 0, size[0] - 1), clamp(Math.floor(place[0] * size[1]), 0, size[1] - 1)] : null;
      },
    };
  }

  viewOf(spec) {
    return spec?.solid ? { fx: 0.5, fy: 0.5, zoom: this.solid.zoom } : this.view;
  }

  look(spec, view) {
    if (!spec.solid) return super.look(spec, view);
    this.solid.zoom = clamp(view.zoom, 0.5, 20);
    return this.redraw();
  }

  // Points in metres before a pinhole camera, as `tmca point-cloud` writes them; focal: in widths of the picture.
  savePoints(item) {
    const { depth, colours } = this.what(item);
    if (!depth) return;
    const { data, rows, columns } = depth, lines = [], along = columns * (item.focal ?? 1);
    for (let y = 0; y < rows; y++) {
      for (let x = 0; x < columns; x++) {
        const at = y * columns + x, z = data[at];
        if (!(z > 0)) continue;
        const colour = colours ? colours.data.subarray(3 * at, 3 * at + 3) : [200, 200, 200];
        const place = [((x + 0.5 - columns / 2) / along) * z, (-(y + 0.5 - rows / 2) / along) * z, -z];
        lines.push(`${place.map((part) => part.toPrecision(6)).join(" ")} ${colour.join(" ")}`);
      }
    }
    const head = ["ply", "format ascii 1.0", `comment points in metres, camera at the origin, x to the right, y up, the scene at negative z; pinhole camera, focal length ${along.toPrecision(6)} pixels`, `element vertex ${lines.length}`, ...["x", "y", "z"].map((name) => `property float ${name}`), ...["red", "green", "blue"].map((name) => `property uchar ${name}`), "end_header"];
    save(`${item.title}.ply`, new Blob([[...head, ...lines].join("\n"), "\n"], { type: "application/octet-stream" }));
  }

  state() {
    const { turn, zoom, relief } = this.solid;
    return { ...super.state(), solid: [...turn, zoom, relief].map((value) => Number(value.toFixed(3))).join() };
  }

  restore(given) {
    super.restore(given);
    const [down, across, zoom, relief] = (given.solid ?? "").split(",").map(Number);
    if ([down, across, zoom, relief].every(Number.isFinite) && zoom >= 0.5 && relief > 0) (Object.assign(this.solid, { turn: [clamp(down, -1.5, 1.5), across], zoom: clamp(zoom, 0.5, 20), relief: clamp(relief, 0.05, 1.5) }), (this.relief.value = relief));
  }
}
