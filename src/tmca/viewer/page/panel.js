// One picture with rulers, colour bar, cursor and marks; zoomed, moved and marked by mouse and keys.
import { gradient, PLACES } from "./colours.js";
import { ink } from "./theme.js";
import { clamp, element, shown, ticks } from "./numbers.js";
import { fitted } from "./plot.js";

const MARGIN = { left: 50, top: 25, bottom: 35, right: 12, bar: 66 };
const SMALL = { left: 36, top: 25, bottom: 20, right: 8, bar: 50 }; // without names of axes
const NARROW = 290;
const CLICK = 4; // pixels that a hand may move within a click
const FASTEST = 200; // zoom at most

export class Panel {
  constructor(desk, key) {
    Object.assign(this, { desk, key, spec: null });
    this.overlay = element("canvas");
    this.title = element("b");
    this.note = element("span");
    this.caption = element("p", { className: "caption" }, this.title, this.note);
    const save = element("button", { className: "save small", title: "Save this picture, a pixel of the file a pixel of the picture", textContent: "⤓", onclick: () => desk.savePanel(this) });
    save.setAttribute("aria-label", "Save this picture");
    this.save = save;
    this.root = element("div", { className: "panel", tabIndex: 0 }, this.overlay, this.caption, save);
    this.root.setAttribute("role", "img");
    this.#listen();
  }

  // Where the panel and its picture lie on the stage, CSS pixels.
  measure(stage) {
    const outer = stage.getBoundingClientRect(), own = this.root.getBoundingClientRect();
    this.width = own.width;
    this.height = own.height;
    this.margin = Math.min(own.width, own.height) < NARROW ? SMALL : MARGIN;
    const { left, top, bottom, right, bar } = this.margin, taken = this.spec.bar ? bar : right;
    this.inner = { x: left, y: top, w: Math.max(own.width - left - taken, 10), h: Math.max(own.height - top - bottom, 10) };
    this.frame = { ...this.inner, x: own.left - outer.left + this.inner.x, y: own.top - outer.top + this.inner.y };
  }

  // Where the whole picture would lie, within the panel: { x, y, w, h }.
  box() {
    const { spec, inner } = this, view = this.desk.viewOf(spec), [rows, columns] = spec.size;
    const fit = Math.min(inner.w / columns, inner.h / rows);
    const w = (spec.stretch ? inner.w : columns * fit) * view.zoom, h = (spec.stretch ? inner.h : rows * fit) * view.zoom;
    return { x: inner.x + inner.w / 2 - view.fx * w, y: inner.y + inner.h / 2 - view.fy * h, w, h };
  }

  draw(painter) {
    const box = this.box(), { spec, frame, inner } = this;
    const moved = { ...box, x: box.x + frame.x - inner.x, y: box.y + frame.y - inner.y };
    if (spec.custom) spec.custom(painter, frame, moved);
    else if (spec.paint.plane) {
      painter.draw(frame, moved, spec.paint);
      for (const part of spec.details ?? []) {
        const [rows, columns] = spec.size;
        const place = { x: moved.x + (part.x0 / columns) * moved.w, y: moved.y + (part.y0 / rows) * moved.h, w: (part.wide / columns) * moved.w, h: (part.high / rows) * moved.h };
        painter.draw(frame, place, { ...spec.paint, plane: part });
      }
    }
    this.save.hidden = Boolean(spec.solid);
    this.#say(spec.title, spec.note ?? "");
    const lasting = JSON.stringify([ink.name, box, inner, this.width, this.height, spec.bar, spec.extents, spec.signature, this.desk.cursor, this.desk.places, this.dragged?.region, !spec.paint?.plane]);
    if (lasting === this.lasting) return;
    this.lasting = lasting;
    this.#drawOver(box);
  }

  #say(title, note) {
    const said = note ? `${title}, ${note}` : title;
    this.caption.classList.toggle("small", this.margin === SMALL);
    if (this.said === said) return;
    this.said = said;
    this.title.textContent = title;
    this.note.textContent = note;
    this.caption.title = said; // where there is no room for all of it
    this.root.setAttribute("aria-label", said);
  }

  #drawOver(box) {
    const { spec, inner } = this;
    const context = fitted(this.overlay, this.width, this.height);
    this.overlay.style.height = "100%";
    context.textBaseline = "middle";
    context.font = "11px system-ui, 'Liberation Sans', Arial, sans-serif";
    context.fillStyle = ink.quiet;
    const small = this.margin === SMALL;
    if (!spec.plain) rulers(context, inner, box, spec, small);
    const top = Math.max(box.y, inner.y), tall = Math.min(box.y + box.h, inner.y + inner.h) - top;
    if (spec.bar && tall > 0) bar(context, this.width - this.margin.bar + 10, top, tall, small ? { ...spec.bar, label: "" } : spec.bar);
    context.save();
    context.beginPath();
    context.rect(inner.x, inner.y, inner.w, inner.h);
    context.clip();
    if (spec.points) crosses(context, box, spec.points);
    if (!spec.unmarked && !spec.pick) this.#drawMarks(context, box);
    spec.over?.(context, (x, y) => [box.x + (x / spec.size[1]) * box.w, box.y + (y / spec.size[0]) * box.h]);
    context.restore();
    if (!spec.paint?.plane && !spec.custom) {
      context.textAlign = "center";
      context.fillText("reading …", inner.x + inner.w / 2, inner.y + inner.h / 2);
    }
  }

  #drawMarks(context, box) {
    const { desk, spec } = this, [rows, columns] = spec.size;
    const at = (y, x) => [box.x + (x / columns) * box.w, box.y + (y / rows) * box.h];
    context.lineWidth = 2;
    desk.places.forEach((place, number) => {
      const [y0, y1, x0, x1] = desk.placed(place, spec.size);
      context.strokeStyle = PLACES[number % PLACES.length];
      const [left, top] = at(y0, x0), [right, bottom] = at(y1, x1);
      if (place.length === 4) context.strokeRect(left, top, right - left, bottom - top);
      else {
        const [x, y] = at((y0 + y1) / 2, (x0 + x1) / 2);
        context.beginPath();
        context.arc(x, y, 6, 0, 7);
        context.moveTo(x - 10, y), context.lineTo(x - 3, y), context.moveTo(x + 3, y), context.lineTo(x + 10, y);
        context.moveTo(x, y - 10), context.lineTo(x, y - 3), context.moveTo(x, y + 3), context.lineTo(x, y + 10);
        context.stroke();
      }
    });
    if (this.dragged?.region) {
      const [y0, y1, x0, x1] = this.dragged.region, [left, top] = at(y0, x0), [right, bottom] = at(y1, x1);
      context.strokeStyle = "#ffffff";
      context.setLineDash([4, 3]);
      context.strokeRect(left, top, right - left, bottom - top);
      context.setLineDash([]);
    }
    if (!desk.cursor) return;
    const [y0, y1, x0, x1] = desk.placed(desk.cursor, spec.size);
    const [x, y] = at((y0 + y1) / 2, (x0 + x1) / 2);
    context.lineWidth = 1;
    for (const [colour, off] of [["#000a", 1], ["#ffffffc8", 0]]) {
      context.strokeStyle = colour;
      context.beginPath();
      context.moveTo(x - 9, y + off), context.lineTo(x + 9, y + off), context.moveTo(x + off, y - 9), context.lineTo(x + off, y + 9);
      context.stroke();
    }
  }

  // Row and column below a pointer, as parts of the whole; whether they lie on the picture.
  #under(event) {
    const own = this.root.getBoundingClientRect(), box = this.box();
    const fx = (event.clientX - own.left - box.x) / box.w, fy = (event.clientY - own.top - box.y) / box.h;
    const px = (event.clientX - own.left - this.inner.x) / this.inner.w, py = (event.clientY - own.top - this.inner.y) / this.inner.h;
    if (this.spec.pick) return { fx, fy, px, py, inside: px >= 0 && px < 1 && py >= 0 && py < 1 };
    return { fx, fy, inside: fx >= 0 && fx < 1 && fy >= 0 && fy < 1 };
  }

  #pixel({ fx, fy, px, py }) {
    if (this.spec.pick) return this.spec.pick({ px, py });
    const [rows, columns] = this.spec.size;
    return [clamp(Math.floor(fy * rows), 0, rows - 1), clamp(Math.floor(fx * columns), 0, columns - 1)];
  }

  #listen() {
    const { root } = this;
    root.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.#zoom(Math.exp(-clamp(event.deltaY, -120, 120) * 0.0022), this.#under(event));
    }, { passive: false });
    root.addEventListener("pointerdown", (event) => {
      if (event.target !== this.overlay || event.button) return;
      root.setPointerCapture(event.pointerId);
      root.focus({ preventScroll: true, focusVisible: false });
      const view = this.desk.viewOf(this.spec);
      this.dragged = { x: event.clientX, y: event.clientY, view: { ...view }, from: this.spec.pick ? null : this.#pixel(this.#under(event)), moved: false, region: null };
      this.spec.dragStart?.();
    });
    root.addEventListener("pointermove", (event) => this.#move(event));
    root.addEventListener("pointerup", (event) => this.#end(event));
    root.addEventListener("pointercancel", () => (this.dragged = null));
    root.addEventListener("pointerleave", () => this.desk.left?.());
    root.addEventListener("dblclick", () => this.desk.look(this.spec, { fx: 0.5, fy: 0.5, zoom: 1 }));
    root.addEventListener("keydown", (event) => this.#key(event));
  }

  #move(event) {
    const under = this.#under(event);
    if (!this.dragged) {
      const pixel = under.inside ? this.#pixel(under) : null;
      if (pixel) this.desk.point(this.spec, pixel);
      return;
    }
    const dx = event.clientX - this.dragged.x, dy = event.clientY - this.dragged.y;
    if (Math.hypot(dx, dy) > CLICK) this.dragged.moved = true;
    if (!this.dragged.moved) return;
    if (event.shiftKey && !this.spec.unmarked && !this.spec.pick) {
      const [y0, x0] = this.dragged.from, [y1, x1] = this.#pixel(under);
      this.dragged.region = [Math.min(y0, y1), Math.max(y0, y1) + 1, Math.min(x0, x1), Math.max(x0, x1) + 1];
      this.desk.redraw();
    } else if (this.spec.drag) this.spec.drag(dx, dy, event);
    else {
      const box = this.box(), { view } = this.dragged;
      this.desk.look(this.spec, { ...view, fx: view.fx - dx / box.w, fy: view.fy - dy / box.h });
    }
  }

  #end(event) {
    const held = this.dragged;
    this.dragged = null;
    if (!held) return;
    if (held.region) this.desk.mark(this.spec, held.region);
    else if (!held.moved && !this.spec.unmarked && this.#under(event).inside) {
      const pixel = this.#pixel(this.#under(event));
      if (pixel) this.desk.mark(this.spec, pixel);
    }
  }

  #zoom(factor, { fx, fy }) {
    const view = this.desk.viewOf(this.spec), zoom = clamp(view.zoom * factor, this.spec.pick ? 0.5 : 1, FASTEST), change = view.zoom / zoom;
    this.desk.look(this.spec, { zoom, fx: zoom === 1 ? 0.5 : fx + (view.fx - fx) * change, fy: zoom === 1 ? 0.5 : fy + (view.fy - fy) * change });
  }

  #key(event) {
    const steps = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] }[event.key];
    if (steps && !event.ctrlKey && !event.metaKey) {
      const [rows, columns] = this.spec.size, far = event.shiftKey ? 10 : 1;
      const [y0, , x0] = this.desk.cursor ? this.desk.placed(this.desk.cursor, this.spec.size) : [rows >> 1, 0, columns >> 1];
      if (this.spec.steer) this.spec.steer(...steps);
      else this.desk.point(this.spec, [clamp(y0 + far * steps[0], 0, rows - 1), clamp(x0 + far * steps[1], 0, columns - 1)]);
    } else if (event.key === "Enter" && this.desk.cursor && !this.spec.unmarked && event.target === this.root) {
      const [y, , x] = this.desk.placed(this.desk.cursor, this.spec.size);
      this.desk.mark(this.spec, [y, x]);
    } else if (event.key === "+" || event.key === "=") this.#zoom(1.4, this.desk.viewOf(this.spec));
    else if (event.key === "-") this.#zoom(1 / 1.4, this.desk.viewOf(this.spec));
    else return;
    event.preventDefault();
    event.stopPropagation();
  }
}

function cut(context, text, width) {
  if (context.measureText(text).width <= width) return text;
  let kept = text;
  while (kept && context.measureText(`${kept}…`).width > width) kept = kept.slice(0, -1);
  return kept ? `${kept}…` : "";
}

function rulers(context, inner, box, spec, small) {
  const [rows, columns] = spec.size, { x: acrossRange = [0, columns], y: downRange = [0, rows] } = spec.extents ?? {};
  const half = spec.extents ? 0 : 0.5; // a number stands at the middle of its pixel
  context.fillStyle = ink.quiet;
  context.strokeStyle = ink.tick;
  context.lineWidth = 1;
  const low = Math.max(box.x, inner.x), high = Math.min(box.x + box.w, inner.x + inner.w);
  const top = Math.max(box.y, inner.y), bottom = Math.min(box.y + box.h, inner.y + inner.h);
  if (high <= low || bottom <= top) return;
  const valueX = (x) => acrossRange[0] + ((x - box.x) / box.w) * (acrossRange[1] - acrossRange[0]);
  const valueY = (y) => downRange[0] + ((y - box.y) / box.h) * (downRange[1] - downRange[0]);
  context.textAlign = "center";
  const between = (a, b) => [Math.min(a, b), Math.max(a, b)];
  for (const value of ticks(...between(valueX(low), valueX(high)), Math.max((high - low) / 64, 2))) {
    const x = box.x + ((value + half - acrossRange[0]) / (acrossRange[1] - acrossRange[0])) * box.w;
    if (x > high || (!spec.extents && value % 1)) continue;
    line(context, x, bottom, x, bottom + 4);
    context.fillText(shown(value), Math.min(x, high - 3), bottom + 11);
  }
  if (!small) context.fillText(spec.xlabel ?? "column (px)", (low + high) / 2, bottom + 26);
  context.textAlign = "right";
  for (const value of ticks(...between(valueY(top), valueY(bottom)), Math.max((bottom - top) / 48, 2))) {
    const y = box.y + ((value + half - downRange[0]) / (downRange[1] - downRange[0])) * box.h;
    if (y > bottom || (!spec.extents && value % 1)) continue;
    line(context, low - 4, y, low, y);
    context.fillText(shown(value), low - 6, y);
  }
  if (small) return;
  context.save();
  context.textAlign = "center";
  context.translate(Math.max(low - 41, 8), (top + bottom) / 2);
  context.rotate(-Math.PI / 2);
  context.fillText(spec.ylabel ?? "row (px)", 0, 0);
  context.restore();
}

// What was estimated, at shares of the width and the height.
function crosses(context, box, points) {
  context.lineWidth = 2;
  context.strokeStyle = "#ff5a4d";
  for (const [across, down] of points) {
    const x = box.x + across * box.w, y = box.y + down * box.h;
    line(context, x - 4, y - 4, x + 4, y + 4);
    line(context, x - 4, y + 4, x + 4, y - 4);
  }
}

function line(context, x0, y0, x1, y1) {
  context.beginPath();
  context.moveTo(x0, y0);
  context.lineTo(x1, y1);
  context.stroke();
}

function bar(context, x, y, tall, { map, span, label }) {
  context.fillStyle = gradient(context, map, x, y, y + tall);
  context.fillRect(x, y, 10, tall);
  context.textAlign = "left";
  context.fillStyle = ink.quiet;
  const round = ticks(...span, Math.max(tall / 40, 2));
  for (const value of round.length > 1 ? round : span.map((end) => Number(end.toPrecision(2)))) {
    const at = y + tall - ((value - span[0]) / (span[1] - span[0])) * tall;
    context.fillText(shown(value, 3), x + 14, clamp(at, y + 5, y + tall - 4));
  }
  if (!label) return;
  context.save();
  context.textAlign = "center";
  context.translate(x + 48, y + tall / 2);
  context.rotate(-Math.PI / 2);
  context.fillText(cut(context, label, tall), 0, 0);
  context.restore();
}
