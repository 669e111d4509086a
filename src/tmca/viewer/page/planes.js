// Where planes come from, a server or the page itself, and those that are kept.

export class Served {
  constructor(token) {
    this.token = token;
  }

  async ask(path, given = {}) {
    const query = new URLSearchParams({ ...given, token: this.token });
    const answer = await fetch(`${path}?${query}`).catch(() => null);
    if (answer === null) throw new Error("The viewer has been closed. Start it again to read more.");
    if (answer.ok) return answer;
    const said = answer.headers.get("Content-Type")?.startsWith("application/json") ? (await answer.json()).error : "";
    throw new Error(said || `The viewer refused to answer (${answer.status}).`);
  }

  async about() {
    return (await this.ask("about")).json();
  }

  async newest(after) {
    return (await this.ask("newest", { after })).json();
  }

  async part(item, layer, index, step, y0, y1, x0, x1) {
    const answer = await this.ask("plane", { item, layer: layer.name, index, step, y0, y1, x0, x1 });
    const bytes = await answer.arrayBuffer();
    return layer.colours === "picture" ? new Uint8Array(bytes) : new Float32Array(bytes);
  }

  async profile(item, layer, [y0, y1, x0, x1]) {
    return (await this.ask("profile", { item, layer: layer.name, y0, y1, x0, x1 })).json();
  }
}

// Of a page without a server: planes are whole numbers between a lowest and a highest value, compressed.
export class Embedded {
  constructor(held) {
    this.held = held;
  }

  async about() {
    return this.held.about;
  }

  async part(item, layer, index) {
    const held = this.held.planes[`${item}/${layer.name}/${index}`];
    const packed = Uint8Array.from(atob(held.data), (letter) => letter.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
    const bytes = await new Response(stream).arrayBuffer();
    if (layer.colours === "picture") return new Uint8Array(bytes);
    const whole = held.bits === 16 ? new Uint16Array(bytes) : new Uint8Array(bytes);
    const most = held.bits === 16 ? 65535 : 255;
    const unit = (held.high - held.low) / (most - 1);
    return Float32Array.from(whole, (value) => (value === most ? NaN : held.low + value * unit));
  }
}

const BUDGET = 900e6;

// Planes that were asked for, the least recently used of which go first.
export class Planes {
  constructor(source, changed, failed) {
    Object.assign(this, { source, changed, failed, kept: new Map(), asked: new Map(), bytes: 0, queue: [], busy: 0 });
  }

  key(item, layer, index) {
    return `${item}/${layer.name}/${index}`;
  }

  // What is there of a plane now: { data, rows, columns, step, y0, x0 }; null without.
  now(item, layer, index) {
    const key = this.key(item, layer, index);
    const held = this.kept.get(key) ?? null;
    if (held) {
      this.kept.delete(key);
      this.kept.set(key, held);
    }
    return held;
  }

  async get(item, layer, index) {
    const key = this.key(item, layer, index);
    const held = this.now(item, layer, index);
    if (held) return held;
    if (!this.asked.has(key)) this.asked.set(key, this.#load(key, item, layer, index));
    return this.asked.get(key);
  }

  async #load(key, item, layer, index) {
    try {
      const [rows, columns] = layer.size;
      const data = await this.source.part(item, layer, index, layer.step, 0, rows, 0, columns);
      const plane = { key, data, step: layer.step, y0: 0, x0: 0, rows: Math.ceil(rows / layer.step), columns: Math.ceil(columns / layer.step) };
      this.kept.set(key, plane);
      this.bytes += data.byteLength;
      for (const [old, one] of this.kept) {
        if (this.bytes <= BUDGET || old === key) break;
        this.kept.delete(old);
        this.bytes -= one.data.byteLength;
      }
      this.changed();
      return plane;
    } catch (error) {
      this.failed(error);
      throw error;
    } finally {
      this.asked.delete(key);
    }
  }

  // Read all planes anew when they are shown next.
  forget() {
    this.kept.clear();
    this.bytes = 0;
  }

  // All that was asked for is here, or will not come.
  async rest() {
    while (this.asked.size) await Promise.allSettled([...this.asked.values()]);
  }

  // Load all planes of a layer, those near one first, where they fit beside the others.
  prefetch(item, layer, from) {
    const bytes = layer.planes * Math.ceil(layer.size[0] / layer.step) * Math.ceil(layer.size[1] / layer.step) * 4;
    if (bytes > BUDGET / 3) return;
    const order = Array.from({ length: layer.planes }, (_, at) => at).sort((a, b) => Math.abs(a - from) - Math.abs(b - from));
    this.queue.push(...order.filter((at) => !this.kept.has(this.key(item, layer, at))).map((at) => [item, layer, at]));
    this.#next();
  }

  #next() {
    while (this.busy < 4 && this.queue.length) {
      const [item, layer, index] = this.queue.shift();
      this.busy++;
      this.get(item, layer, index).catch(() => (this.queue = [])).finally(() => {
        this.busy--;
        this.#next();
      });
    }
  }

  whole(item, layer) {
    if (layer.step > 1) return false;
    for (let at = 0; at < layer.planes; at++) if (!this.kept.has(this.key(item, layer, at))) return false;
    return true;
  }

  // Mean and deviation of a region (y0, y1, x0, x1) of all planes, at once where they are all here, else null.
  profileNow(item, layer, [y0, y1, x0, x1]) {
    if (!this.whole(item, layer)) return null;
    const mean = [], deviation = [];
    for (let at = 0; at < layer.planes; at++) {
      const { data, columns } = this.kept.get(this.key(item, layer, at));
      let count = 0, sum = 0, squares = 0;
      for (let y = y0; y < y1; y++) {
        for (let x = x0; x < x1; x++) {
          const value = data[y * columns + x];
          if (Number.isFinite(value)) (count++, (sum += value), (squares += value * value));
        }
      }
      mean.push(count ? sum / count : NaN);
      deviation.push(count ? Math.sqrt(Math.max(squares / count - (sum / count) ** 2, 0)) : NaN);
    }
    return { mean, deviation };
  }

  async profile(item, layer, region) {
    const here = this.profileNow(item, layer, region);
    if (here) return here;
    if (this.source.profile) return this.source.profile(item, layer, region);
    await Promise.all(Array.from({ length: layer.planes }, (_, at) => this.get(item, layer, at)));
    const thinned = region.map((place, at) => (at % 2 ? Math.max(Math.ceil(place / layer.step), Math.floor(region[at - 1] / layer.step) + 1) : Math.floor(place / layer.step)));
    return this.profileNow(item, { ...layer, step: 1 }, thinned);
  }
}
