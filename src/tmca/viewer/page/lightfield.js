// Light fields: views under the hand, refocused, all in focus, epipolar lines, disparity.
import { USUAL } from "./colours.js";
import { Desk } from "./desk.js";
import { clamp, element, later, shown } from "./numbers.js";
import { Looks, Slider } from "./tools.js";

const STEP = 28; // pixels of the hand from one view to the next
const MODES = { view: "View", focus: "Refocus", sharp: "All in focus" };
const STEPS = 80; // of the focus slider
const SLOW = 1.5; // milliseconds a view, from which few views are added up until the slider rests

export class LightField extends Desk {
  constructor(app, items) {
    super(app, items);
    const { grid, reach } = items[0];
    Object.assign(this, { grid_: grid, v: grid[0] >> 1, u: grid[1] >> 1, mode: "view", focus: 0, looks: new Looks(() => this.redraw()) });
    this.finish = later((wanted) => ((this.settled = wanted), this.app.redraw()), 350);
    this.cursor = [this.size[0] >> 1, this.size[1] >> 1];
    this.refocused = new Map();
    const values = Array.from({ length: STEPS + 1 }, (_, at) => reach[0] + (at / STEPS) * (reach[1] - reach[0]));
    this.slider = new Slider({ label: "focus at disparity", values, unit: "px per view step", counted: false, index: Math.round(STEPS / 2), moved: (at) => ((this.focus = values[at]), this.choose("focus")) });
    this.focus = values[Math.round(STEPS / 2)];
    const known = items.some((item) => item.layers.length > 1);
    this.buttons = Object.entries(MODES).filter(([name]) => name !== "sharp" || known).map(([name, text]) => element("button", { className: "small", textContent: text, title: `${text} (${text[0]})`, onclick: () => this.choose(name) }));
    this.hint = element("p", { className: "hint" });
    const group = element("section", { className: "group" }, element("h2", {}, "Picture"), element("div", { className: "row" }, ...this.buttons), this.hint);
    this.sideParts = [group, this.looks.root, this.factsGroup()];
    this.sliderParts = [this.slider.root];
    this.choose("view");
  }

  factsGroup() {
    const one = (item) => [element("h3", {}, item.title), element("dl", {}, ...Object.entries(item.facts).flatMap(([name, value]) => [element("dt", {}, name), element("dd", {}, String(value))]))];
    return element("section", { className: "group facts" }, element("h2", {}, "File"), ...this.items.flatMap(one));
  }

  begin() {
    for (const item of this.items) this.planes.prefetch(item.number, item.layers[0], this.index(item));
  }

  choose(mode) {
    this.mode = mode;
    this.slider.root.hidden = mode !== "focus"; // nothing else is focused by hand
    if (this.slider.root.parentNode) this.slider.root.parentNode.hidden = mode !== "focus";
    const names = Object.keys(MODES);
    this.buttons.forEach((button) => button.setAttribute("aria-pressed", button.textContent === MODES[mode]));
    const hints = { view: "Drag over the picture, or use the arrow keys on it, to walk through the views.", focus: "What has this disparity is sharp. Positive is nearer than the plane in focus.", sharp: "The mean of all views along the disparity of every pixel." };
    this.hint.textContent = `${hints[names.find((name) => name === mode)]} Move over it to choose the epipolar lines.`;
    this.redraw();
  }

  index(item, v = this.v, u = this.u) {
    return clamp(v, 0, item.grid[0] - 1) * item.grid[1] + clamp(u, 0, item.grid[1] - 1);
  }

  grid(specs) {
    if (this.items.length > 1) return super.grid(specs);
    if (specs.length > 4) return { columns: "repeat(3, minmax(0, 1fr))", rows: "minmax(0, 1.5fr) minmax(0, 1fr)" };
    return { columns: "minmax(0, 1fr) minmax(0, 1fr)", rows: specs.length > 3 ? "minmax(0, 1.5fr) minmax(0, 1fr)" : "minmax(0, 2.2fr) minmax(0, 1fr)" };
  }

  viewOf(spec) {
    return spec?.lines ? { fx: 0.5, fy: 0.5, zoom: 1 } : this.view;
  }

  specs() {
    const pictures = this.items.map((item) => [this.picture(item), ...item.layers.slice(1).map((map) => this.map(item, map))]);
    const found = this.items.map((item, row) => ({ maps: pictures[row], lines: [this.lines(item, true), this.lines(item, false)] }));
    if (found.length > 1) this.place(found);
    return found.flatMap(({ maps, lines }) => [...maps, ...lines]);
  }

  // Each file in a row of its own, with its epipolar lines where they fit into it, else below all.
  place(found) {
    const widest = Math.max(...found.map(({ maps }) => maps.length)), below = widest > 2;
    found.forEach(({ maps, lines }, row) => {
      maps.forEach((spec, column) => (spec.cell = [row, column]));
      lines.forEach((spec, second) => (spec.cell = below ? [found.length + (row >> 1), 2 * (row % 2) + second] : [row, widest + second]));
    });
  }

  // The disparity, its confidence, or its error.
  map(item, layer) {
    const { name, label, unit, size } = layer, key = `${item.number}/${name}`, plane = this.plane(key, item, layer, 0);
    const look = this.looks.of(name, label, name === "disparity" ? USUAL.depth : USUAL.deviation, layer.span, unit);
    const spec = { key, title: this.named(item, label), size, item, layer, index: 0, paint: { plane, map: look.map, span: look.span, power: look.power }, look: name, bar: { map: look.map, span: look.span, label: unit ? `${label} (${unit})` : label } };
    return { ...spec, note: this.valueAt(plane, spec) };
  }

  named(item, text) {
    return this.items.length > 1 ? `${item.title}: ${text}` : text;
  }

  picture(item) {
    const layer = item.layers[0], spec = { key: `${item.number}/picture`, title: item.title, size: layer.size, item, layer, index: 0, bar: null, wide: this.items.length === 1 && !item.layers[1] };
    if (this.mode !== "view") {
      const plane = this.focused(item);
      const note = this.mode === "focus" ? `focus at ${shown(this.focus, 3)} px` : "all in focus";
      return { ...spec, note, paint: { plane, picture: true, map: "grey" } };
    }
    const index = this.index(item);
    const start = () => (this.held = [this.v, this.u]);
    const walk = (down, across) => {
      const next = [clamp(this.held[0] + down, 0, item.grid[0] - 1), clamp(this.held[1] + across, 0, item.grid[1] - 1)];
      if (next[0] === this.v && next[1] === this.u) return;
      [this.v, this.u] = next;
      this.redraw();
    };
    return {
      ...spec, index, note: layer.axis.names[index], paint: { plane: this.plane(spec.key, item, layer, index), picture: true, map: "grey" },
      dragStart: start, drag: (dx, dy) => walk(Math.round(dy / STEP), Math.round(dx / STEP)), steer: (down, across) => (start(), walk(down, across)),
      over: (context, at) => this.drawGrid(context, at, item), signature: `${this.v},${this.u}`,
    };
  }

  // Where the view lies among all, as dots in a corner.
  drawGrid(context, at, item) {
    const [rows, columns] = item.grid, [right, top] = at(this.size[1], 0), gap = clamp(Math.floor(70 / Math.max(rows, columns)), 3, 9);
    const left = Math.min(right, context.canvas.clientWidth - 30) - columns * gap - 8, first = Math.max(top, 25) + 8;
    context.fillStyle = "#0008";
    context.fillRect(left - 5, first - 5, columns * gap + 8, rows * gap + 8);
    for (let v = 0; v < rows; v++) {
      for (let u = 0; u < columns; u++) {
        context.fillStyle = v === this.v && u === this.u ? "#4fb3f6" : "#ffffff70";
        context.fillRect(left + u * gap, first + v * gap, gap - 1.5, gap - 1.5);
      }
    }
  }

  // The mean of all views, shifted by the focus, or by the disparity of every pixel.
  focused(item) {
    const layer = item.layers[0], map = this.mode === "sharp" ? item.layers[1] : null, disparity = map ? this.planes.now(item.number, map, 0) : null;
    const views = item.places.map(([v, u], at) => ({ v, u, plane: this.planes.now(item.number, layer, at) })).filter((view) => view.plane);
    if (views.length < item.places.length || (this.mode === "sharp" && !disparity)) return this.plane(`${item.number}/middle`, item, layer, this.index(item)); // until all are here
    const wanted = `${this.mode}/${this.mode === "focus" ? this.focus : ""}`;
    const few = this.slow && this.settled !== wanted ? views.filter(({ v, u }) => (Math.floor(v) + Math.floor(u)) % 2 === 0 && Math.abs(v % 2) < 1) : views;
    if (few.length < views.length) this.finish(wanted);
    const key = `${wanted}/${few.length}`, held = this.refocused.get(item.number);
    if (held?.made === key) return held.plane;
    const began = performance.now();
    const plane = this.app.painter.refocus(`${item.number}/refocused`, few, layer.size, disparity ?? this.focus);
    this.slow = (performance.now() - began) / few.length > SLOW;
    this.refocused.set(item.number, { made: key, plane });
    return plane;
  }

  // A row of the pixels of the cursor in the views from left to right, or a column in those from top to bottom.
  lines(item, across) {
    const layer = item.layers[0], [rows, columns] = item.grid, [y, , x] = this.placed(this.cursor, layer.size), step = layer.step;
    const count = across ? columns : rows, views = Array.from({ length: count }, (_, at) => this.planes.now(item.number, layer, across ? this.index(item, this.v, at) : this.index(item, at, this.u)));
    const place = across ? `row ${y}` : `column ${x}`, title = this.items.length > 1 ? this.named(item, `epipolar, ${place}`) : `epipolar lines of ${place}`, length = layer.size[across ? 1 : 0];
    const spec = { key: `${item.number}/${across ? "across" : "down"}`, title, note: `↕ view ${across ? "column" : "row"}`, size: [count, Math.ceil(length / step)], lines: true, stretch: true, unmarked: true, bar: null, xlabel: across ? "column (px)" : "row (px)", ylabel: across ? "view column" : "view row", extents: { x: [0, length], y: [-count / 2, count / 2] } };
    const data = views.every(Boolean) ? this.linesOf(views, across, Math.floor(y / step), Math.floor(x / step)) : null;
    const plane = data && { key: spec.key, data, rows: count, columns: data.length / count / 3, step: 1 };
    return { ...spec, paint: { plane, picture: true, map: "grey" } };
  }

  linesOf(views, across, y, x) {
    const length = across ? views[0].columns : views[0].rows, made = new Uint8Array(views.length * length * 3);
    views.forEach(({ data, columns }, number) => {
      for (let at = 0; at < length; at++) {
        const from = 3 * (across ? y * columns + at : at * columns + x), to = 3 * (number * length + at);
        made[to] = data[from], made[to + 1] = data[from + 1], made[to + 2] = data[from + 2];
      }
    });
    return made;
  }

  drawSide() {
    this.slider.drawScale();
    const maps = [...this.panels.values()].map((panel) => panel.spec).filter((spec) => spec.look);
    this.looks.draw([...new Set(maps.map((spec) => spec.look))], (name) => maps.find((spec) => spec.look === name).paint.plane?.data);
  }

  key(event) {
    const mode = { v: "view", r: "focus", a: "sharp" }[event.key], move = { ",": -1, ".": 1 }[event.key];
    if (mode && this.buttons.some((button) => button.textContent === MODES[mode])) this.choose(mode);
    else if (move) (this.slider.set(this.slider.index + move), (this.focus = this.slider.values[this.slider.index]), this.choose("focus"));
    else return false;
    return true;
  }

  state() {
    return { ...super.state(), mode: this.mode, grid: `${this.v},${this.u}`, focus: Number(this.focus.toFixed(3)), cursor: this.cursor?.join() };
  }

  restore(given) {
    super.restore(given);
    const [v, u] = (given.grid ?? "").split(",").map(Number), focus = Number(given.focus), cursor = (given.cursor ?? "").split(",").map(Number);
    if (v >= 0 && v < this.grid_[0] && u >= 0 && u < this.grid_[1]) Object.assign(this, { v, u });
    if (given.focus && Number.isFinite(focus)) (this.slider.set(this.slider.values.findLastIndex((value) => value <= focus + 1e-3)), (this.focus = this.slider.values[this.slider.index]));
    if (cursor.length === 2 && cursor.every((at, axis) => at >= 0 && at < this.size[axis])) this.cursor = cursor;
    if (MODES[given.mode]) this.choose(given.mode);
  }
}
