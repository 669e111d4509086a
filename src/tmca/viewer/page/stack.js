// Stacks of planes side by side: cubes and their bands, with differences from one of them; snapshots; arrays.
import { USUAL } from "./colours.js";
import { DASHES, Desk } from "./desk.js";
import { element, nearest, shown } from "./numbers.js";
import { ink } from "./theme.js";
import { Looks, Slider } from "./tools.js";

const SECONDS_A_FRAME = 0.12;

export class Stack extends Desk {
  constructor(app, items) {
    super(app, items);
    this.looks = new Looks(() => this.redraw());
    this.axis = items[0].layers[0].axis;
    this.index = this.axis.label === "wavelength" ? nearest(this.axis.values, 550) : 0;
    this.coloured = this.axis.label === "wavelength" && this.axis.values.length > 2;
    this.extra = { difference: false, error: false, deviation: false };
    this.against = items.find((item) => item.role === "truth") ?? this.#other();
    this.maps = new Map();
    this.details = new Map();
    const meant = this.against?.role === "truth" || this.axis.label === "wavelength";
    if (this.against && items.length < 4 && meant) this.extra.error = true;
    this.build();
    if (this.plot) this.cursor = this.size.map((length) => length >> 1);
  }

  // Of two files of one shape the second, as an estimate and its scene are named.
  #other() {
    const [one, other] = this.items, alike = this.items.length === 2 && this.main(one).size.join() === this.main(other).size.join();
    return alike && this.main(other).axis.label === this.axis.label && this.axis.values.length > 1 ? other : null;
  }

  main(item) {
    return item.layers[0];
  }

  // The plane of an item that is at the same position as the slider.
  indexOf(item) {
    const { values } = this.main(item).axis;
    return values === this.axis.values ? this.index : nearest(values, this.axis.values[this.index]);
  }

  build() {
    const { axis } = this, hasColour = this.items.some((item) => item.layers.some((layer) => layer.name === "colour"));
    const mode = (text, title, coloured) => element("button", { className: "small", textContent: text, title, onclick: () => this.showColour(coloured) });
    this.modes = hasColour ? [mode("Colour", "Red, green and blue from the bands (C)", true), mode(axis.label === "view" ? "View" : "Band", "One plane (B)", false)] : [];
    this.play = element("button", { className: "small", textContent: "▶", title: "Run through the planes (space)", onclick: () => this.run() });
    this.play.setAttribute("aria-label", "Run through the planes");
    this.slider = new Slider({ label: axis.label || "plane", values: axis.values, unit: axis.unit, names: axis.names ?? [], index: this.index, light: axis.unit === "nm", modes: [...this.modes, this.play], moved: (index) => this.move(index) });
    this.slider.root.hidden = axis.values.length < 2;
    const heading = axis.label === "wavelength" ? "Spectrum" : `Over ${axis.label || "planes"}`;
    const curved = axis.values.length > 1 && !axis.names?.length;
    const curve = curved ? [this.plotGroup(heading, (x) => this.move(nearest(axis.values, x)))] : [this.placesGroup()];
    this.sideParts = [...curve, this.looks.root, ...this.compareGroup(), this.factsGroup()];
    this.sliderParts = [this.slider.root];
    this.showColour(this.coloured);
  }

  placesGroup() {
    this.placeList = element("ul", { className: "places" });
    this.valueList = element("dl");
    return element("section", { className: "group" }, element("h2", {}, "At the cursor"), this.valueList, this.placeList);
  }

  compareGroup() {
    const toggle = (name, text, title) => element("button", { className: "small", textContent: text, title, onclick: () => ((this.extra[name] = !this.extra[name]), this.showToggles(), this.redraw()) });
    this.toggles = {};
    const alike = this.items.filter((item) => this.main(item).size.join() === this.main(this.items[0]).size.join());
    const parts = [];
    if (this.items.some((item) => item.layers.some((layer) => layer.name === "deviation"))) {
      this.toggles.deviation = toggle("deviation", "Deviation", "The standard deviation that the decoder predicts");
    }
    if (alike.length > 1) {
      this.select = element("select", { onchange: () => ((this.against = this.items[Number(this.select.value)] ?? null), this.showToggles(), this.redraw()) }, element("option", { value: -1 }, "nothing"), ...alike.map((item) => element("option", { value: this.items.indexOf(item) }, item.title)));
      this.select.setAttribute("aria-label", "Compare with");
      this.select.value = this.items.indexOf(this.against);
      parts.push(element("div", { className: "row" }, element("label", {}, "with"), this.select));
      this.toggles.difference = toggle("difference", "Difference", "What is shown minus what it is compared with, at this plane (D)");
      this.toggles.error = toggle("error", "Error map", "Root mean square of the difference over all planes (E)");
    }
    this.showToggles();
    if (!Object.keys(this.toggles).length) return [];
    parts.push(element("div", { className: "row" }, ...Object.values(this.toggles)));
    return [element("section", { className: "group" }, element("h2", {}, alike.length > 1 ? "Compare" : "Also show"), ...parts)];
  }

  showToggles() {
    for (const [name, button] of Object.entries(this.toggles)) {
      button.setAttribute("aria-pressed", this.extra[name]);
      button.disabled = name !== "deviation" && !this.against;
    }
    if (this.select) this.select.value = this.items.indexOf(this.against);
  }

  factsGroup() {
    const one = (item) => [element("h3", {}, item.title), element("dl", {}, ...Object.entries(item.facts).flatMap(([name, value]) => [element("dt", {}, name), element("dd", {}, String(value))]))];
    return element("section", { className: "group facts" }, element("h2", {}, this.items.length > 1 ? "Files" : "File"), ...this.items.flatMap(one));
  }

  showColour(coloured) {
    this.coloured = coloured && this.modes.length > 0;
    this.modes.forEach((button, at) => button.setAttribute("aria-pressed", this.coloured === (at === 0)));
    this.redraw();
  }

  move(index) {
    const next = Math.min(Math.max(index, 0), this.axis.values.length - 1);
    this.index = next;
    this.slider.set(next);
    if (this.coloured) this.showColour(false);
    if (this.view.zoom > 1) this.closer();
    this.redraw();
  }

  run() {
    clearInterval(this.running);
    this.running = this.running ? 0 : setInterval(() => this.move((this.index + 1) % this.axis.values.length), 1000 * SECONDS_A_FRAME);
    this.play.textContent = this.running ? "❚❚" : "▶";
  }

  begin() {
    for (const item of this.items) this.planes.prefetch(item.number, this.main(item), this.index);
  }

  specs() {
    const found = this.items.map((item, column) => ({ ...this.spec(item), cell: [0, column] }));
    this.rows().forEach((name, row) => {
      this.items.forEach((item, column) => {
        const spec = this[name](item);
        if (spec) found.push({ ...spec, cell: [row + 1, column] });
      });
    });
    return found;
  }

  // What is shown of every item below its picture.
  rows() {
    return ["deviation", "difference", "error"].filter((name) => this.extra[name] && (name === "deviation" || this.against));
  }

  // Whether a picture can be compared, pixel by pixel, with the one that is compared with.
  comparable(item) {
    return item !== this.against && this.main(item).size.join() === this.main(this.against).size.join();
  }

  deviation(item) {
    const layer = item.layers.find((one) => one.name === "deviation");
    return layer ? this.one(item, layer, `${item.title}: deviation`) : null;
  }

  spec(item) {
    const colour = this.coloured && item.layers.find((layer) => layer.name === "colour");
    if (!colour) return this.one(item, this.main(item), item.title);
    const plane = this.plane(`${item.number}/colour`, item, colour, 0);
    const note = colour.bands?.length ? `RGB ${colour.bands.map((band) => parseInt(band)).join(", ")} nm` : "colour";
    return { key: `${item.number}/main`, title: item.title, note, size: colour.size, item, layer: colour, index: 0, details: this.detailsOf(`${item.number}/main`, colour, 0), paint: { plane, picture: true, map: "grey" }, bar: null };
  }

  one(item, layer, title, index = this.indexOf(item)) {
    const key = `${item.number}/${layer.name === "deviation" ? "deviation" : "main"}`;
    const plane = this.plane(key + layer.name, item, layer, index);
    const look = this.lookOf(layer.name, layer.label, USUAL[layer.colours] ?? "grey", layer.span);
    const paint = { plane, map: look.map, span: look.span, power: look.power };
    const spec = { key, title, size: layer.size, item, layer, index, paint, look: layer.name, details: this.detailsOf(key, layer, index), bar: { map: look.map, span: look.span, label: layer.unit ? `${layer.label} (${layer.unit})` : layer.label } };
    if (layer.extents) Object.assign(spec, { extents: layer.extents, xlabel: layer.xlabel, ylabel: layer.ylabel, points: layer.points });
    spec.note = [this.positionOf(layer, index), this.cursor ? this.valueAt(plane, spec) : ""].filter(Boolean).join("  ·  ");
    return spec;
  }

  // Of planes that are thinned out, read what is on the screen as fine as the screen is.
  lookCloser() {
    if (!this.planes.source.profile) return;
    for (const panel of this.panels.values()) {
      const { spec } = panel, { layer, index } = spec, part = layer?.step > 1 && !spec.paint.minus && panel.inner ? this.visible(panel, layer) : null;
      if (!part) continue;
      const key = `${this.planes.key(spec.item.number, layer, index)}@${Object.values(part)}`;
      if (this.details.get(spec.key)?.key === key) continue;
      this.planes.source.part(spec.item.number, layer, index, part.step, part.y0, part.y1, part.x0, part.x1).then((data) => {
        const high = part.y1 - part.y0, wide = part.x1 - part.x0;
        this.details.set(spec.key, { ...part, key, index, layer, data, high, wide, rows: Math.ceil(high / part.step), columns: Math.ceil(wide / part.step) });
        this.app.redraw();
      }, () => {});
    }
  }

  // Rows and columns of a picture on the screen, and how far apart those that can be told apart are; null if all are there.
  visible(panel, layer) {
    const box = panel.box(), { inner } = panel, [rows, columns] = layer.size;
    const step = Math.max(1, Math.floor(columns / (box.w * this.app.painter.ratio)));
    if (step >= layer.step) return null;
    const grid = 64 * step, from = (share, length) => Math.max(Math.floor((share * length) / grid) * grid, 0), to = (share, length) => Math.min(Math.ceil((share * length) / grid) * grid, length);
    const part = { step, y0: from((inner.y - box.y) / box.h, rows), y1: to((inner.y + inner.h - box.y) / box.h, rows), x0: from((inner.x - box.x) / box.w, columns), x1: to((inner.x + inner.w - box.x) / box.w, columns) };
    return part.y1 > part.y0 && part.x1 > part.x0 ? part : null;
  }

  detailsOf(key, layer, index) {
    const part = this.details.get(key);
    return part && part.layer === layer && part.index === index ? [part] : [];
  }

  // How a kind of picture is shown; all items of a name are shown alike.
  lookOf(name, label, map, span) {
    if (!this.looks.known.has(name)) {
      const spans = this.items.flatMap((item) => item.layers.filter((layer) => layer.name === name).map((layer) => layer.span));
      const all = spans.length ? [Math.min(...spans.map(([low]) => low)), Math.max(...spans.map(([, high]) => high))] : span;
      const unit = this.items.flatMap((item) => item.layers).find((layer) => layer.name === name)?.unit;
      const look = this.looks.of(name, label, map, all, unit);
      if (this.looks.wanted?.[name]) look.span = this.looks.wanted[name];
    }
    return this.looks.known.get(name);
  }

  positionOf(layer, index) {
    const { axis } = layer;
    if (axis.names?.length) return axis.names[index];
    return axis.values.length > 1 ? `${shown(axis.values[index], 5)} ${axis.unit}` : "";
  }

  difference(item) {
    if (!this.comparable(item)) return null;
    const spec = this.one(item, this.main(item), `${item.title} − ${this.against.title}`), other = this.main(this.against);
    const [low, high] = this.main(item).span, reach = 0.2 * Math.max(Math.abs(low), Math.abs(high));
    const look = this.lookOf("difference", "difference", "blue–red", [-reach, reach]);
    const minus = this.plane(`${item.number}/minus`, this.against, other, this.indexOf(this.against));
    const plane = minus ? spec.paint.plane : null;
    const bar = { map: look.map, span: look.span, label: "difference" };
    return { ...spec, key: `${item.number}/difference`, look: "difference", details: [], paint: { plane, minus, map: look.map, span: look.span, power: 1 }, bar, note: this.positionOf(other, this.index) };
  }

  error(item) {
    if (!this.comparable(item)) return null;
    const plane = this.errorMap(item), label = `RMS error over all ${this.axis.unit === "nm" ? "bands" : "planes"}`;
    const [low, high] = this.main(item).span;
    const look = this.lookOf("error", "RMS error", "magma", plane?.span ?? [0, 0.2 * Math.max(Math.abs(low), Math.abs(high))]);
    const paint = { plane, map: look.map, span: look.span, power: look.power };
    const spec = { key: `${item.number}/error`, title: `${item.title}: error`, size: this.main(item).size, item, layer: this.main(item), index: 0, paint, look: "error", bar: { map: look.map, span: look.span, label } };
    spec.note = plane ? `RMS ${shown(plane.total, 3)}${this.cursor ? `  ·  ${this.valueAt(plane, spec, 3)}` : ""}` : "";
    return spec;
  }

  // Root mean square over all planes of the difference from what is compared with; null while it is computed.
  errorMap(item) {
    const key = `error/${item.number}/${this.against.number}`;
    if (!this.maps.has(key)) {
      this.maps.set(key, null);
      this.computeError(item, this.against, key).catch(() => this.maps.delete(key));
    }
    return this.maps.get(key);
  }

  async computeError(item, against, key) {
    const layer = this.main(item), other = this.main(against);
    let sum = null, first = null;
    for (let index = 0; index < layer.planes; index++) {
      const one = await this.planes.get(item.number, layer, index);
      const two = await this.planes.get(against.number, other, nearest(other.axis.values, layer.axis.values[index]));
      sum ??= new Float32Array(one.data.length);
      first ??= one;
      for (let at = 0; at < sum.length; at++) sum[at] += (one.data[at] - two.data[at]) ** 2;
    }
    const total = Math.sqrt(sum.reduce((all, value) => all + value, 0) / sum.length / layer.planes);
    const data = sum.map((value) => Math.sqrt(value / layer.planes)), sorted = data.filter(Number.isFinite).sort();
    const high = sorted[Math.floor(0.995 * (sorted.length - 1))] || 1e-6;
    this.maps.set(key, { ...first, key, data, total, span: [0, high] });
    this.looks.known.delete("error");
    this.redraw();
  }

  drawSide() {
    this.slider.drawScale();
    const specs = [...this.panels.values()].map((panel) => panel.spec), named = specs.filter((spec) => spec.look);
    this.looks.draw([...new Set(named.map((spec) => spec.look))], (name) => {
      const spec = named.find((one) => one.look === name), { plane, minus } = spec.paint;
      return plane && minus ? this.subtracted(plane, minus) : plane?.data;
    });
    if (this.plot) this.drawPlot();
    else this.listValues(named);
  }

  subtracted(plane, minus) {
    if (this.last?.plane !== plane || this.last?.minus !== minus) this.last = { plane, minus, data: plane.data.map((value, at) => value - minus.data[at]) };
    return this.last.data;
  }

  listValues(specs) {
    const place = this.cursor ? this.nameOf(this.cursor) : "move over a picture";
    this.valueList.replaceChildren(element("dt", {}, "pixel"), element("dd", {}, place), ...specs.filter((spec) => !spec.paint.minus).flatMap((spec) => [element("dt", {}, spec.title), element("dd", {}, this.valueAt(spec.paint.plane, spec) || "–")]));
  }

  drawPlot() {
    const lines = this.curves((item) => this.main(item), (item) => item.layers.find((layer) => layer.name === "deviation"));
    this.lines = lines;
    const { axis } = this, layer = this.main(this.items[0]);
    const xlabel = axis.unit ? `${axis.label} (${axis.unit})` : axis.label;
    this.plot.draw({ lines, xlabel, ylabel: layer.unit ? `${layer.label} (${layer.unit})` : layer.label, mark: axis.values[this.index], domain: [axis.values[0], axis.values[axis.values.length - 1]], whole: Boolean(layer.steps), span: this.fit && lines.length ? [] : layer.span });
    this.plotHint.replaceChildren(...this.legend(lines));
  }

  legend(lines) {
    const hint = "Move over a picture for its curve. Click keeps one, Shift and drag takes the mean of a region.";
    if (!lines.length) return [hint];
    const parts = [];
    if (this.cursor) parts.push(`cursor: ${this.nameOf(this.cursor)}`);
    if (this.items.length > 1) {
      if (this.cursor) parts.push(element("br"), ...this.items.map((item) => this.sample(item, this.colourOf(item), item.role === "truth" ? [5, 3] : [])));
      if (this.places.length) parts.push(parts.length ? element("br") : "", "kept: ", ...this.items.map((item, number) => this.sample(item, ink.quiet, DASHES[number % DASHES.length])));
    }
    const bands = lines.some((line) => line.band && line.name.startsWith("row ")) ? ["pixels: ±1 predicted standard deviation"] : [];
    if (lines.some((line) => line.band && line.name.startsWith("rows"))) bands.push("regions: ±1 standard deviation of their pixels");
    if (bands.length) parts.push(element("br"), bands.join("; "));
    if (!this.places.length) parts.push(element("br"), hint);
    return parts;
  }

  // A piece of an item's line before its name.
  sample(item, colour, dash) {
    const piece = element("canvas", { width: 22, height: 3 }), context = piece.getContext("2d");
    Object.assign(context, { strokeStyle: colour, lineWidth: 4 });
    context.setLineDash(dash);
    context.moveTo(0, 1), context.lineTo(22, 1), context.stroke();
    return element("span", { "data-item": "" }, piece, ` ${item.title}  `);
  }

  tableLines() {
    return this.lines;
  }

  tableAxis() {
    return this.axis.unit ? `${this.axis.label} (${this.axis.unit})` : this.axis.label;
  }

  key(event) {
    const move = { ",": -1, ".": 1, PageUp: -10, PageDown: 10 }[event.key];
    if (move) this.move(this.index + move);
    else if (event.key === " " && this.axis.values.length > 1) this.run();
    else if (event.key === "c") this.showColour(true);
    else if (event.key === "b") this.showColour(false);
    else if (event.key === "d" && this.against) ((this.extra.difference = !this.extra.difference), this.showToggles(), this.redraw());
    else if (event.key === "e" && this.against) ((this.extra.error = !this.extra.error), this.showToggles(), this.redraw());
    else return false;
    return true;
  }

  state() {
    const extra = Object.keys(this.extra).filter((name) => this.extra[name]).join();
    return { ...super.state(), plane: this.index, colour: this.modes.length ? Number(this.coloured) : null, show: extra, against: this.select ? this.items.indexOf(this.against) : null, spans: this.looks.state() };
  }

  restore(given) {
    super.restore(given);
    if (this.places.length) this.cursor = null; // kept curves are there to look at
    this.looks.restore(given.spans);
    const index = Number(given.plane);
    if (given.plane !== undefined && Number.isInteger(index)) this.slider.set((this.index = Math.min(Math.max(index, 0), this.axis.values.length - 1)));
    if (given.colour !== undefined) this.showColour(given.colour === "1");
    if (given.show !== undefined) for (const name of Object.keys(this.extra)) this.extra[name] = given.show.split(",").includes(name);
    if (given.against !== undefined) this.against = this.items[Number(given.against)] ?? null;
    this.showToggles();
    this.listPlaces();
  }
}
