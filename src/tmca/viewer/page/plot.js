// Curves with axes on a canvas of two dimensions.
import { clamp, shown, ticks } from "./numbers.js";
import { ink } from "./theme.js";

const FONT = "11px system-ui, 'Liberation Sans', Arial, sans-serif";

export function fitted(canvas, width, height) {
  const ratio = window.devicePixelRatio || 1;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    Object.assign(canvas, { width: Math.round(width * ratio), height: Math.round(height * ratio) });
    canvas.style.height = `${height}px`;
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  context.font = FONT;
  return context;
}

// Lines { x, y, band (± around y), colour, dash, steps } over one axis each way; `mark` is a place on the x axis, `domain`
// all positions on it, `span` the values that the y axis has room for at least.
export class Plot {
  constructor(canvas, picked) {
    this.canvas = canvas;
    this.frame = null;
    const pick = (event) => {
      if (!this.frame || !picked) return;
      const { left, width, low, high } = this.frame;
      const share = (event.clientX - canvas.getBoundingClientRect().left - left) / width;
      picked(low + clamp(share, 0, 1) * (high - low));
    };
    canvas.addEventListener("pointerdown", (event) => (canvas.setPointerCapture(event.pointerId), pick(event)));
    canvas.addEventListener("pointermove", (event) => event.buttons && pick(event));
  }

  draw({ lines, xlabel, ylabel, domain, mark = null, span = [], whole = false, height = 232 }) {
    const width = this.canvas.clientWidth || 320;
    const context = fitted(this.canvas, width, height);
    const left = 52, top = 8, right = width - 10, bottom = height - 36;
    const half = whole ? 0.5 : 0; // a slot is as wide as one step
    const [first, last] = extent([...domain, ...lines.flatMap((line) => [line.x[0], line.x[line.x.length - 1]])]);
    const [low, high] = widened([first - half, last + half], 0);
    const reach = lines.flatMap(around), usual = span.length ? widened(span, 0.06) : null; // it stays while curves are within
    const [floor, ceiling] = usual && reach.every((y) => !(y < usual[0] || y > usual[1])) ? usual : widened(extent([...span, ...reach]) ?? [0, 1], 0.06);
    this.frame = { left, width: right - left, low, high, floor, ceiling };
    const across = (x) => left + ((x - low) / (high - low)) * (right - left);
    const up = (y) => bottom - ((y - floor) / (ceiling - floor)) * (bottom - top);
    axes(context, { left, top, right, bottom, low, high, floor, ceiling, across, up, xlabel, ylabel, whole });
    context.save();
    context.beginPath();
    context.rect(left, top - 1, right - left, bottom - top + 2);
    context.clip();
    if (mark !== null) stroke(context, [[across(mark), top], [across(mark), bottom]], ink.quiet, [2, 3], 1);
    for (const line of lines) curve(context, line, across, up);
    context.restore();
  }
}

const around = (line) => Array.from(line.y, (y, at) => (line.band ? [y - (line.band[at] || 0), y + (line.band[at] || 0)] : y)).flat();

export function extent(values) {
  let low = Infinity, high = -Infinity;
  for (const value of values) if (Number.isFinite(value)) ((low = Math.min(low, value)), (high = Math.max(high, value)));
  return low <= high ? [low, high] : null;
}

function widened([low, high], share) {
  if (!(high > low)) return [low - Math.max(Math.abs(low), 1) * 0.05, high + Math.max(Math.abs(high), 1) * 0.05];
  const more = (high - low) * share;
  return [low >= 0 && share && low < 0.3 * high ? 0 : low - more, high + more];
}

function axes(context, { left, top, right, bottom, low, high, floor, ceiling, across, up, xlabel, ylabel, whole }) {
  context.fillStyle = ink.quiet;
  context.textBaseline = "middle";
  context.textAlign = "right";
  for (const y of ticks(floor, ceiling, 5)) {
    stroke(context, [[left, up(y)], [right, up(y)]], ink.line, [], 1);
    context.fillText(shown(y), left - 6, up(y));
  }
  context.textAlign = "center";
  for (const x of ticks(low, high, 6)) {
    if (whole && x % 1) continue;
    stroke(context, [[across(x), bottom], [across(x), bottom + 4]], ink.quiet, [], 1);
    context.fillText(shown(x), clamp(across(x), left, right - 8), bottom + 12);
  }
  context.fillText(xlabel, (left + right) / 2, bottom + 28);
  context.save();
  context.translate(9, (top + bottom) / 2);
  context.rotate(-Math.PI / 2);
  context.fillText(ylabel, 0, 0);
  context.restore();
  stroke(context, [[left, top], [left, bottom], [right, bottom]], ink.quiet, [], 1);
}

function stroke(context, points, colour, dash, width) {
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.setLineDash(dash);
  context.beginPath();
  points.forEach(([x, y], at) => (at ? context.lineTo(x, y) : context.moveTo(x, y)));
  context.stroke();
  context.setLineDash([]);
}

function curve(context, line, across, up) {
  const shownAt = Array.from(line.x, (x, at) => [across(x), up(line.y[at]), line.band ? up(line.y[at] + line.band[at]) : 0, line.band ? up(line.y[at] - line.band[at]) : 0]);
  const whole = shownAt.filter((point) => point.every(Number.isFinite));
  if (line.band && whole.length > 1) {
    context.globalAlpha = 0.22;
    context.fillStyle = line.colour;
    context.beginPath();
    whole.forEach(([x, , high], at) => (at ? context.lineTo(x, high) : context.moveTo(x, high)));
    whole.toReversed().forEach(([x, , , low]) => context.lineTo(x, low));
    context.fill();
    context.globalAlpha = 1;
  }
  const half = (across(1) - across(0)) / 2;
  const points = whole.flatMap(([x, y]) => (line.steps ? [[x - half, y], [x + half, y]] : [[x, y]]));
  stroke(context, points, line.colour, line.dash ?? [], 1.8);
  if (whole.length > 24 || line.dash?.length || line.steps) return;
  context.fillStyle = line.colour;
  for (const [x, y] of whole) (context.beginPath(), context.arc(x, y, 2.3, 0, 7), context.fill());
}

// A histogram with the two ends of the span that is shown, which can be dragged.
export class Histogram {
  constructor(canvas, moved) {
    this.canvas = canvas;
    let held = null;
    const value = (event) => {
      const { left, width } = canvas.getBoundingClientRect();
      return this.low + clamp((event.clientX - left - 6) / (width - 12), 0, 1) * (this.high - this.low);
    };
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      held = Math.abs(value(event) - this.span[0]) < Math.abs(value(event) - this.span[1]) ? 0 : 1;
    });
    canvas.addEventListener("pointermove", (event) => {
      if (held === null || !event.buttons) return;
      const span = [...this.span];
      span[held] = value(event);
      if (span[1] > span[0]) moved(span);
    });
    canvas.addEventListener("pointerup", () => (held = null));
  }

  draw(counts, low, high, span) {
    Object.assign(this, { low, high, span });
    const width = this.canvas.clientWidth || 320, height = 74;
    const context = fitted(this.canvas, width, height);
    const across = (value) => 6 + clamp((value - low) / (high - low), 0, 1) * (width - 12);
    const top = Math.log1p(Math.max(...counts, 1));
    context.fillStyle = ink.bars;
    counts.forEach((count, at) => {
      const tall = (Math.log1p(count) / top) * (height - 22);
      context.fillRect(6 + (at * (width - 12)) / counts.length, height - 16 - tall, (width - 12) / counts.length + 0.3, tall);
    });
    context.fillStyle = "#4fb3f61c";
    context.fillRect(across(span[0]), 2, across(span[1]) - across(span[0]), height - 18);
    for (const end of span) stroke(context, [[across(end), 2], [across(end), height - 16]], "#4fb3f6", [], 2);
    context.fillStyle = ink.quiet;
    context.textBaseline = "alphabetic";
    [[span[0], "left"], [span[1], "right"]].forEach(([value, align]) => ((context.textAlign = align), context.fillText(shown(value, 3), clamp(across(value), align === "left" ? 0 : width / 2 + 60, align === "left" ? width / 2 - 90 : width), height - 3)));
    context.textAlign = "center";
    context.fillStyle = ink.text;
    context.fillText("pixels (log)", width / 2, height - 3);
  }
}
