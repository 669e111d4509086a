// Settings of how values are shown, sliders, and files that are saved.
import { MAPS, ofLight, table } from "./colours.js";
import { clamp, element, histogram, later, nearest, quantiles, shown, ticks } from "./numbers.js";
import { fitted, Histogram } from "./plot.js";
import { ink } from "./theme.js";

export function save(name, blob) {
  const link = element("a", { href: URL.createObjectURL(blob), download: name.replace(/[/\\:*?"<>|\s]+/g, "_") });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

const quoted = (text) => `"${String(text).replaceAll('"', '""')}"`;

// Curves { x, y, band, name, item } over one axis as a table: a row a plane, a column a curve, and one of its deviation.
export function saveTable(lines, axis, name) {
  const longest = lines.reduce((best, line) => (line.x.length > best.x.length ? line : best));
  const columns = [[axis, longest.x]];
  for (const line of lines) {
    const at = (values) => longest.x.map((x, number) => (line.x[number] === x ? values[number] : values[nearest(line.x, x)]));
    columns.push([`${line.item}, ${line.name}`, at(line.y)]);
    if (line.band) columns.push([`${line.item}, ${line.name}, standard deviation`, at(line.band)]);
  }
  const rows = longest.x.map((_, number) => columns.map(([, values]) => (Number.isFinite(values[number]) ? values[number] : "")).join(","));
  save(name, new Blob([[columns.map(([head]) => quoted(head)).join(","), ...rows].join("\n"), "\n"], { type: "text/csv" }));
}

// A picture with a pixel for every one of its plane, through its colour map.
export function saveCanvas(painter, spec, name) {
  const { plane, minus, picture, map, span, power = 1 } = spec.paint ?? {};
  if (!plane) return;
  const canvas = element("canvas", { width: plane.columns, height: plane.rows });
  const context = canvas.getContext("2d"), image = context.createImageData(plane.columns, plane.rows), colours = table(map);
  for (let at = 0; at < plane.rows * plane.columns; at++) {
    if (picture) image.data.set([plane.data[3 * at], plane.data[3 * at + 1], plane.data[3 * at + 2], 255], 4 * at);
    else {
      const value = plane.data[at] - (minus ? minus.data[at] : 0);
      const level = Math.round(255 * clamp((value - span[0]) / (span[1] - span[0]), 0, 1) ** power);
      image.data.set(Number.isFinite(value) ? colours.subarray(4 * level, 4 * level + 4) : [0, 0, 0, 0], 4 * at);
    }
  }
  context.putImageData(image, 0, 0);
  canvas.toBlob((blob) => save(name, blob));
}

// The whole stage as it is on the screen: pictures below, rulers and marks above.
export function saveStage(paint, panels, name) {
  const canvas = element("canvas", { width: paint.width, height: paint.height }), context = canvas.getContext("2d");
  context.drawImage(paint, 0, 0);
  const ratio = paint.width / paint.clientWidth, outer = paint.getBoundingClientRect();
  for (const panel of panels) {
    const own = panel.root.getBoundingClientRect();
    context.font = `${12 * ratio}px system-ui, sans-serif`;
    context.fillStyle = ink.text;
    context.fillText(`${panel.spec.title}   ${panel.spec.note ?? ""}`, (own.left - outer.left + 50) * ratio, (own.top - outer.top + 16) * ratio);
    context.drawImage(panel.overlay, (own.left - outer.left) * ratio, (own.top - outer.top) * ratio, own.width * ratio, own.height * ratio);
  }
  canvas.toBlob((blob) => save(name, blob));
}

// A slider over the planes of an axis, with its positions below it.
export class Slider {
  constructor({ label, values, unit, names = [], index, moved, light = false, counted = true, modes = [] }) {
    Object.assign(this, { label, values, unit, names, light, counted, index, whole: values.every(Number.isInteger) });
    this.input = element("input", { type: "range", min: 0, max: values.length - 1, step: 1, value: index, oninput: () => (this.set(Number(this.input.value)), moved(this.index)) });
    this.input.setAttribute("aria-label", label);
    this.output = element("output");
    this.scale = element("canvas", { className: "scale" });
    this.scale.setAttribute("aria-hidden", "true");
    this.root = element("div", { className: "slider" }, element("div", { className: "modes" }, ...(modes.length ? modes : [element("label", {}, label)])), this.input, this.output, this.scale);
    this.set(index);
  }

  set(index) {
    this.index = clamp(index, 0, this.values.length - 1);
    this.input.value = this.index;
    const unit = this.unit ? ` ${this.unit}` : "", count = `${this.index + 1} of ${this.values.length}`;
    const text = this.names[this.index] || `${shown(this.values[this.index], 5)}${unit}`;
    this.output.textContent = this.names.length || !this.counted ? text : this.unit ? `${text} · ${count}` : `${this.label} ${count}`;
    this.input.setAttribute("aria-valuetext", `${text}, ${count}`);
  }

  drawScale() {
    const width = this.scale.clientWidth || 300;
    const drawn = `${width} ${ink.name}`;
    if (this.drawn === drawn) return;
    this.drawn = drawn;
    const context = fitted(this.scale, width, 16), count = this.values.length;
    const at = (index) => 8 + (index / Math.max(count - 1, 1)) * (width - 16);
    if (this.light) {
      const made = context.createLinearGradient(at(0), 0, at(count - 1), 0);
      for (let part = 0; part <= 24; part++) made.addColorStop(part / 24, ofLight(this.values[Math.round((part / 24) * (count - 1))]));
      context.fillStyle = made;
      context.fillRect(at(0), 0, at(count - 1) - at(0), 3);
    }
    context.fillStyle = ink.quiet;
    context.textAlign = "center";
    context.textBaseline = "bottom";
    if (this.names.length) return this.#drawNames(context, at, width);
    for (const value of ticks(this.values[0], this.values[count - 1], Math.min(10, width / 90))) {
      if (this.whole && value % 1) continue;
      const left = this.values.findLastIndex((one) => one <= value), next = Math.min(left + 1, count - 1);
      const share = next > left ? (value - this.values[left]) / (this.values[next] - this.values[left]) : 0;
      context.fillText(shown(value), clamp(at(left + share), 12, width - 12), 16);
    }
  }

  // Names of the planes, where there is room for all.
  #drawNames(context, at, width) {
    const count = this.names.length, wide = Math.max(...this.names.map((name) => context.measureText(name).width));
    if ((wide + 12) * count > width) return;
    this.names.forEach((name, index) => context.fillText(name, clamp(at(index), wide / 2, width - wide / 2), 16));
  }
}

// Colour map and span of what is shown, with the histogram of one plane.
export class Looks {
  constructor(changed) {
    Object.assign(this, { changed, known: new Map(), chosen: null });
    this.settle = later(() => this.values && this.#count(this.values), 90);
    this.which = element("select", { onchange: () => ((this.chosen = this.which.value), changed()) });
    this.which.setAttribute("aria-label", "Which pictures");
    this.maps = element("select", { onchange: () => ((this.now.map = this.maps.value), changed()) }, ...MAPS.map((name) => element("option", { value: name }, name)));
    this.maps.setAttribute("aria-label", "Colour map");
    this.canvas = element("canvas", { className: "side-canvas" });
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", "Histogram; drag the ends of the range that is shown");
    this.histogram = new Histogram(this.canvas, (span) => ((this.now.span = span), changed()));
    const number = (end, label) => {
      const input = element("input", { type: "number", step: "any", onchange: () => this.#typed(end, Number(input.value)) });
      input.setAttribute("aria-label", label);
      return input;
    };
    this.unit = element("span", { className: "hint" });
    this.ends = [number(0, "Darkest value"), number(1, "Brightest value")];
    const stretch = (text, title, shares) => element("button", { className: "small", textContent: text, title, onclick: () => this.#stretch(shares) });
    this.power = element("button", { className: "small", textContent: "γ 2.2", title: "Brighten dark values (gamma 2.2)", onclick: () => ((this.now.power = this.now.power === 1 ? 1 / 2.2 : 1), changed()) });
    this.root = element(
      "section", { className: "group" }, element("h2", {}, "Display"),
      element("div", { className: "row" }, this.which, this.maps, this.power), element("div", { className: "row" }, this.canvas),
      element("div", { className: "row" }, this.ends[0], "to", this.ends[1], this.unit),
      element("div", { className: "row" }, element("label", {}, "stretch"), stretch("full", "Smallest to largest value of this plane", [0, 1]), stretch("99 %", "All but half a per cent at either end", [0.005, 0.995]), stretch("95 %", "All but 2.5 per cent at either end", [0.025, 0.975]), element("button", { className: "small", textContent: "reset", title: "As at the beginning", onclick: () => ((this.now.span = this.now.usual), (this.now.power = 1), changed()) })),
    );
  }

  // How a kind of picture is shown: { map, span, power }, made with what is usual at first.
  of(name, label, map, span, unit = "") {
    if (!this.known.has(name)) this.known.set(name, { label, map, span, usual: span, power: 1, unit });
    return this.known.get(name);
  }

  get now() {
    return this.known.get(this.chosen);
  }

  #typed(end, value) {
    const span = [...this.now.span];
    span[end] = value;
    if (Number.isFinite(value) && span[1] > span[0]) this.now.span = span;
    this.changed();
  }

  #stretch(shares) {
    if (!this.values) return;
    const [low, high] = quantiles(this.values, shares);
    if (high > low) this.now.span = [low, high];
    this.changed();
  }

  // Show the settings of one of these kinds; `valuesOf` gives the values of one by its name.
  draw(names, valuesOf) {
    if (!names.includes(this.chosen)) this.chosen = names[0];
    this.root.hidden = !names.length;
    if (!names.length) return;
    if (this.which.children.length !== names.length || [...this.which.children].some((option, at) => option.value !== names[at])) {
      this.which.replaceChildren(...names.map((name) => element("option", { value: name }, this.known.get(name).label)));
    }
    this.which.value = this.chosen;
    this.maps.value = this.now.map;
    if (this.unit.textContent !== this.now.unit) this.unit.textContent = this.now.unit;
    this.power.setAttribute("aria-pressed", this.now.power !== 1);
    this.ends.forEach((input, end) => input.getRootNode().activeElement !== input && (input.value = Number(this.now.span[end].toPrecision(4))));
    const values = valuesOf(this.chosen);
    if (!values) return;
    this.values = values;
    if (this.counted !== values && this.counts) {
      this.settle();
      return;
    }
    this.#count(values);
  }

  // The histogram follows once the slider rests.
  #count(values) {
    const { span, usual } = this.now, low = Math.min(span[0], usual[0]), high = Math.max(span[1], usual[1]), room = (high - low) * 0.08;
    if (this.counted !== values || this.between?.join() !== [low, high].join()) {
      this.counts = histogram(values, low - room, high + room, 96);
      Object.assign(this, { counted: values, between: [low, high] });
    }
    this.histogram.draw(this.counts, low - room, high + room, span);
  }

  state() {
    return [...this.known].filter(([, look]) => look.span !== look.usual).map(([name, look]) => [name, ...look.span.map((end) => Number(end.toPrecision(5)))].join(":")).join(";");
  }

  restore(text) {
    this.wanted = Object.fromEntries((text ?? "").split(";").map((part) => part.split(":")).filter((part) => part.length === 3).map(([name, low, high]) => [name, [Number(low), Number(high)]]));
  }
}
