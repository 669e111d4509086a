// Numbers as people read them, and small functions of arrays.

export const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

export function shown(value, digits = 4) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e5 || size < 1e-3) return value.toExponential(digits - 2).replace(/\.?0+e/, "e").replace("-", "−");
  return String(Number(value.toPrecision(digits))).replace("-", "−");
}

// Round positions for about `count` ticks between two values.
export function ticks(low, high, count) {
  const span = high - low;
  if (!(span > 0) || !Number.isFinite(span)) return [];
  const rough = span / Math.max(count, 1);
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].find((part) => part * power >= rough) * power;
  const found = [];
  for (let at = Math.ceil(low / step - 1e-9); at * step <= high + 1e-9 * span; at++) found.push(Number((at * step).toPrecision(12)));
  return found;
}

export function nearest(values, wanted) {
  let best = 0;
  for (let at = 1; at < values.length; at++) if (Math.abs(values[at] - wanted) < Math.abs(values[best] - wanted)) best = at;
  return best;
}

// Counts of values in equal parts of a span; at most some 200 000 values are looked at.
export function histogram(values, low, high, bins) {
  const counts = new Float64Array(bins);
  const step = Math.max(1, Math.floor(values.length / 200000));
  for (let at = 0; at < values.length; at += step) {
    const place = Math.floor(((values[at] - low) / (high - low)) * bins);
    if (place >= 0 && place < bins) counts[place]++;
    else if (values[at] === high) counts[bins - 1]++;
  }
  return counts;
}

// Values below which these shares of all finite ones lie.
export function quantiles(values, shares) {
  const step = Math.max(1, Math.floor(values.length / 100000));
  const few = [];
  for (let at = 0; at < values.length; at += step) if (Number.isFinite(values[at])) few.push(values[at]);
  const sorted = Float32Array.from(few).sort();
  return shares.map((share) => (sorted.length ? sorted[Math.round(share * (sorted.length - 1))] : 0));
}

export function later(action, milliseconds) {
  let timer = 0;
  return (...given) => {
    clearTimeout(timer);
    timer = setTimeout(() => action(...given), milliseconds);
  };
}

// An element with attributes, listeners (onclick: …) and children.
export function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
    else if (key in made && key !== "list") made[key] = value;
    else made.setAttribute(key, value);
  }
  made.append(...children.filter((child) => child !== null));
  return made;
}
