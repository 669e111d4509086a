// Colour maps as tables of 256 colours, colours of light, and those of curves.

const ANCHORS = {
  grey: ["000000", "ffffff"],
  viridis: ["440154", "482878", "3e4989", "31688e", "26828e", "1f9e89", "35b779", "6ece58", "b5de2b", "fde725"],
  magma: ["000004", "180f3d", "440f76", "721f81", "9e2f7f", "cd4071", "f1605d", "fd9668", "feca8d", "fcfdbf"],
  cividis: ["00224e", "123570", "3b496c", "575d6d", "707173", "8a8678", "a59c74", "c3b369", "e1cc55", "fee838"],
  "blue–red": ["2166ac", "4393c3", "92c5de", "d1e5f0", "f7f7f7", "fddbc7", "f4a582", "d6604d", "b2182b"],
  turbo: ["30123b", "4145ab", "4675ed", "39a2fc", "1bcfd4", "24eca6", "61fc6c", "a4fc3b", "d1e834", "f3c63a", "fe9b2d", "f36315", "d93806", "b11901", "7a0402"],
};
export const MAPS = Object.keys(ANCHORS);
export const USUAL = {
  values: "grey", level: "grey", binary: "grey", signed: "blue–red", deviation: "magma", error: "magma", depth: "turbo", norm: "viridis",
};
// Kept places first differ from files: a curve of each may stand in one plot.
export const PLACES = ["#ffb454", "#7fd962", "#e6e04f", "#ff8fd0", "#59e0c0", "#c9a27a", "#c792ea", "#f07178"];
export const ITEMS = ["#4fb3f6", "#f07178", "#c792ea", "#59e0c0", "#ff8fd0", "#e6e04f"];

const parts = (hex) => [0, 2, 4].map((at) => parseInt(hex.slice(at, at + 2), 16));

export function table(name) {
  const anchors = (ANCHORS[name] ?? ANCHORS.grey).map(parts);
  const made = new Uint8Array(256 * 4);
  for (let at = 0; at < 256; at++) {
    const place = (at / 255) * (anchors.length - 1);
    const left = Math.min(Math.floor(place), anchors.length - 2);
    for (let part = 0; part < 3; part++) {
      made[4 * at + part] = Math.round(anchors[left][part] + (place - left) * (anchors[left + 1][part] - anchors[left][part]));
    }
    made[4 * at + 3] = 255;
  }
  return made;
}

export function gradient(context, name, x, top, bottom) {
  const made = context.createLinearGradient(x, bottom, x, top);
  const colours = table(name);
  for (let at = 0; at <= 32; at++) {
    const place = 4 * Math.round((at / 32) * 255);
    made.addColorStop(at / 32, `rgb(${colours[place]} ${colours[place + 1]} ${colours[place + 2]})`);
  }
  return made;
}

// About the colour of light of a wavelength; grey beyond what an eye sees.
export function ofLight(nm) {
  const ramp = (from, to) => Math.min(Math.max((nm - from) / (to - from), 0), 1);
  if (!(nm >= 390 && nm <= 770)) return "#6d737c";
  const red = nm < 440 ? 0.6 * (1 - ramp(390, 440)) : ramp(510, 580);
  const green = nm < 510 ? ramp(440, 490) : 1 - ramp(580, 645);
  const blue = 1 - ramp(490, 510);
  const fade = nm < 420 ? 0.4 + 0.6 * ramp(390, 420) : 1 - 0.65 * ramp(680, 770);
  return `rgb(${[red, green, blue].map((part) => Math.round(225 * (part * fade) ** 0.8 + 18)).join(" ")})`;
}
