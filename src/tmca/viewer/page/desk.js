// What every page of the viewer has: panels side by side, one view and cursor for all, marked places, their curves.
import { ITEMS, PLACES } from "./colours.js";
import { ink, onGround } from "./theme.js";
import { element, later, shown } from "./numbers.js";
import { Panel } from "./panel.js";
import { Plot } from "./plot.js";
import { groupsOf, numbersOf } from "./hash.js";
import { saveCanvas, saveTable } from "./tools.js";

export const DASHES = [[], [6, 4], [2, 3], [9, 3, 2, 3], [4, 2], [1, 2]];

export class Desk {
  constructor(app, items) {
    Object.assign(this, { app, items, planes: app.planes, panels: new Map(), view: { fx: 0.5, fy: 0.5, zoom: 1 }, cursor: null, places: [] });
    this.size = items[0].layers[0].size;
    this.profiles = new Map();
    this.lasting = new Map();
    this.saveState = later(() => app.saveState(), 250);
    this.closer = later(() => this.lookCloser(), 180);
  }

  // The view of a panel; pages may keep more than one.
  viewOf() {
    return this.view;
  }

  look(spec, view) {
    const within = (part) => Math.min(Math.max(part, 0), 1);
    Object.assign(this.viewOf(spec), { ...view, fx: within(view.fx), fy: within(view.fy) });
    this.closer();
    this.redraw();
  }

  redraw() {
    this.app.redraw();
    this.saveState();
  }

  // Place [y, x] or [y0, y1, x0, x1] in pixels of the first item, as a region in those of a picture of another size.
  placed(place, [rows, columns]) {
    const [y0, y1, x0, x1] = place.length === 4 ? place : [place[0], place[0] + 1, place[1], place[1] + 1];
    const [allRows, allColumns] = this.size;
    if (rows === allRows && columns === allColumns) return [y0, y1, x0, x1];
    const down = (y) => Math.floor((y / allRows) * rows), across = (x) => Math.floor((x / allColumns) * columns);
    const top = down(y0 + 0.5), left = across(x0 + 0.5);
    return [top, Math.max(down(y1), top + 1), left, Math.max(across(x1), left + 1)];
  }

  // A pixel or region of a picture in pixels of the first item.
  #common(spec, place) {
    const [rows, columns] = spec.size, [allRows, allColumns] = this.size;
    if (rows === allRows && columns === allColumns) return place;
    const half = place.length === 2 ? 0.5 : 0;
    return place.map((at, number) => Math.floor((at + half) * (number < place.length / 2 ? allRows / rows : allColumns / columns)));
  }

  point(spec, pixel) {
    this.cursor = this.#common(spec, pixel);
    this.app.redraw();
  }

  mark(spec, place) {
    const common = this.#common(spec, place);
    this.places = [...this.places, common].slice(-PLACES.length);
    this.listPlaces();
    this.redraw();
  }

  // Panels for the specs of this moment; kept as long as their keys are the same.
  arrange() {
    const specs = this.specs(), keys = specs.map((spec) => spec.key);
    const root = this.app.panelsRoot;
    if (keys.join() !== this.arranged || root.firstChild?.desk !== this) {
      this.arranged = keys.join();
      for (const key of this.panels.keys()) if (!keys.includes(key)) this.panels.delete(key);
      for (const key of keys) if (!this.panels.has(key)) this.panels.set(key, new Panel(this, key));
      root.replaceChildren(...keys.map((key) => this.panels.get(key).root));
      root.firstChild.desk = this;
      const { columns, rows } = this.grid(specs);
      Object.assign(root.style, { gridTemplateColumns: columns, gridTemplateRows: rows });
      const placed = this.inCells(specs);
      specs.forEach(({ key, cell, wide }) => (this.panels.get(key).root.style.gridArea = placed ? `${cell[0] + 1} / ${cell[1] + 1}` : wide ? "auto / 1 / auto / -1" : ""));
    }
    specs.forEach((spec) => (this.panels.get(spec.key).spec = spec));
    return specs.map((spec) => this.panels.get(spec.key));
  }

  // Whether panels lie in the rows and columns that their specs name: what belongs to a file below it.
  inCells(specs) {
    return specs.every((spec) => spec.cell) && specs.some(({ cell: [row, column] }) => row && column);
  }

  grid(specs) {
    if (this.inCells(specs)) {
      const [rows, columns] = [0, 1].map((axis) => Math.max(...specs.map((spec) => spec.cell[axis])) + 1);
      return { columns: `repeat(${columns}, minmax(0, 1fr))`, rows: `repeat(${rows}, minmax(0, 1fr))` };
    }
    const { clientWidth, clientHeight } = this.app.panelsRoot;
    const shape = specs[0].size[1] / specs[0].size[0];
    let best = { size: 0, columns: 1 };
    for (let columns = 1; columns <= specs.length; columns++) {
      const rows = Math.ceil(specs.length / columns);
      const size = Math.min((clientWidth / columns - 125) / shape, clientHeight / rows - 70);
      if (size > best.size + 1) best = { size, columns };
    }
    return { columns: `repeat(${best.columns}, minmax(0, 1fr))`, rows: `repeat(${Math.ceil(specs.length / best.columns)}, minmax(0, 1fr))` };
  }

  draw() {
    const panels = this.arrange(), { painter, stage } = this.app;
    painter.clear();
    for (const panel of panels) panel.measure(stage);
    for (const panel of panels) panel.draw(painter);
    this.drawSide?.();
  }

  // The plane that is there, or the one shown before while this one is read.
  plane(slot, item, layer, index) {
    const now = this.planes.now(item.number, layer, index);
    if (!now) this.planes.get(item.number, layer, index).catch(() => {});
    if (now) this.lasting.set(slot, now);
    return now ?? this.lasting.get(slot) ?? null;
  }

  lookCloser() {}

  // Curves of all planes of a layer at a place, in the cache, at once, or asked for and drawn when they come.
  profile(item, layer, place) {
    const region = this.placed(place, layer.size), key = `${item.number}/${layer.name}/${region}`;
    if (this.profiles.has(key)) return this.profiles.get(key);
    const here = this.planes.profileNow(item.number, layer, region);
    if (here) this.#keep(key, here);
    else {
      this.#keep(key, this.older?.get(key) ?? null);
      this.planes.profile(item.number, layer, region).then((found) => (this.#keep(key, found), this.app.redraw()), () => this.profiles.delete(key));
    }
    return this.profiles.get(key);
  }

  // Values are others now; curves stay until newer ones are here.
  forget() {
    this.older = this.profiles;
    this.profiles = new Map();
  }

  #keep(key, found) {
    this.profiles.set(key, found);
    if (this.profiles.size > 400) this.profiles.delete(this.profiles.keys().next().value);
  }

  colourOf(item) {
    if (item.role === "truth") return ink.truth;
    return onGround(ITEMS[this.items.filter((one) => one.role !== "truth").indexOf(item) % ITEMS.length]);
  }

  // Curves of the cursor and of all places, of every item.
  curves(layerOf, moreOf = () => null) {
    const lines = [];
    const add = (place, colour, name) => {
      this.items.forEach((item, number) => {
        const layer = layerOf(item), found = layer && this.profile(item, layer, place);
        if (!found) return;
        const more = moreOf(item), spread = more && place.length === 2 ? this.profile(item, more, place)?.mean : place.length === 4 ? found.deviation : null;
        const dash = colour ? DASHES[number % DASHES.length] : item.role === "truth" ? [5, 3] : [];
        lines.push({ x: layer.axis.values, y: found.mean, band: spread, colour: colour ?? this.colourOf(item), dash, steps: layer.steps, name, item: item.title });
      });
    };
    this.places.forEach((place, number) => add(place, onGround(PLACES[number % PLACES.length]), this.nameOf(place)));
    if (this.cursor) add(this.cursor, null, this.nameOf(this.cursor));
    return lines;
  }

  nameOf(place) {
    if (place.length === 2) return `row ${place[0]}, column ${place[1]}`;
    return `rows ${place[0]}–${place[1] - 1}, columns ${place[2]}–${place[3] - 1}`;
  }

  // A group for the side: heading, plot, list of places.
  plotGroup(heading, pick) {
    this.plotCanvas = element("canvas", { className: "side-canvas" });
    this.plotCanvas.setAttribute("role", "img");
    this.plotCanvas.setAttribute("aria-label", heading);
    this.plot = new Plot(this.plotCanvas, pick);
    this.fitButton = element("button", { className: "small", textContent: "fit", title: "Fit the vertical axis to the curves, instead of the range of all values", onclick: () => ((this.fit = !this.fit), this.fitButton.setAttribute("aria-pressed", this.fit), this.redraw()) });
    this.placeList = element("ul", { className: "places" });
    this.plotHint = element("p", { className: "hint" });
    this.listPlaces();
    return element("section", { className: "group" }, element("h2", {}, heading, this.fitButton), this.plotCanvas, this.plotHint, this.placeList);
  }

  listPlaces() {
    if (!this.placeList) return;
    const entry = (place, number) => {
      const mark = element("i");
      mark.style.background = onGround(PLACES[number % PLACES.length]);
      const gone = element("button", { className: "small", textContent: "×", title: "Remove", onclick: () => ((this.places = this.places.filter((one) => one !== place)), this.listPlaces(), this.redraw()) });
      gone.setAttribute("aria-label", `Remove ${this.nameOf(place)}`);
      return element("li", {}, mark, this.nameOf(place), gone);
    };
    this.placeList.replaceChildren(...this.places.map(entry));
  }

  key() {
    return false;
  }

  state() {
    const { fx, fy, zoom } = this.view, round = (value) => Number(value.toFixed(4));
    const points = this.places.filter((place) => place.length === 2), regions = this.places.filter((place) => place.length === 4);
    return { view: zoom === 1 ? null : [round(fx), round(fy), round(zoom)].join(), points: points.join(";"), regions: regions.join(";") };
  }

  restore(given) {
    const [fx, fy, zoom] = numbersOf(given.view);
    if (zoom >= 1) Object.assign(this.view, { fx, fy, zoom });
    const inside = ([y, x], last) => y >= 0 && x >= 0 && (last ?? [y + 1, x + 1]).every((end, axis) => end > [y, x][axis] && end <= this.size[axis]);
    const points = groupsOf(given.points, 2).filter((place) => inside(place));
    const regions = groupsOf(given.regions, 4).filter(([y0, y1, x0, x1]) => inside([y0, x0], [y1, x1]));
    this.places = [...points, ...regions].map((place) => place.map(Math.floor)).slice(0, PLACES.length);
  }

  // Values below the cursor, for the captions.
  valueAt(plane, spec, digits = 4) {
    if (!this.cursor || !plane) return "";
    const [y, , x] = this.placed(this.cursor, spec.size);
    const close = spec.details?.find((part) => y >= part.y0 && y < part.y0 + part.high && x >= part.x0 && x < part.x0 + part.wide);
    if (close) return shown(close.data[Math.floor((y - close.y0) / close.step) * close.columns + Math.floor((x - close.x0) / close.step)], digits);
    const column = Math.min(Math.floor(x / plane.step), plane.columns - 1), row = Math.min(Math.floor(y / plane.step), plane.rows - 1);
    return shown(plane.data[row * plane.columns + column], digits);
  }

  saveTable() {
    const lines = this.tableLines?.() ?? [];
    if (!lines.length) return this.app.say("Click a pixel, or drag a region with Shift, to have a curve to save.", true);
    saveTable(lines, this.tableAxis(), `${this.items[0].title}-curves.csv`);
  }

  savePanel(panel) {
    saveCanvas(this.app.painter, panel.spec, `${this.items[0].title}-${panel.spec.title}.png`);
  }
}
