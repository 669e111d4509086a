// A bench that runs: the newest estimate and its spectra, the histogram of its snapshot, how long every stage took.
import { element, shown } from "./numbers.js";
import { Histogram } from "./plot.js";
import { Stack } from "./stack.js";

const PATIENCE = 10000; // milliseconds without an answer after which the loop is taken to have ended
const PAUSE = 1000; // milliseconds to the next try

export class Live extends Stack {
  build() {
    if (this.axis.label === "view") this.index = this.axis.values.length >> 1;
    super.build();
    this.cursor = [this.size[0] >> 1, this.size[1] >> 1];
    this.table = element("dl", { className: "numbers" });
    this.counts = element("canvas", { className: "side-canvas" });
    this.counts.setAttribute("role", "img");
    this.counts.setAttribute("aria-label", "Histogram of the snapshot");
    this.histogramOfAll = new Histogram(this.counts, () => {});
    const group = (heading, part) => element("section", { className: "group" }, element("h2", {}, heading), part);
    this.sideParts.splice(1, 0, group("Loop", this.table), group("Pixels of the snapshot by value", this.counts));
  }

  begin() {} // planes are read when they are shown: soon there are newer ones

  drawSide() {
    super.drawSide();
    const { newest } = this.app;
    if (!newest || newest === this.told) return;
    this.told = newest;
    const percent = (share) => (share === null ? "–" : `${shown(100 * share, 3)} %`);
    const rows = [
      ["estimates a second", shown(newest.rate, 3)], ["exposure", newest.exposure], ["exposures dropped", newest.dropped],
      ["pixels saturated", percent(newest.saturated)], ["residual ‖A x̂ − y‖ / ‖y‖", percent(newest.residual)],
      ...Object.entries(newest.ms).map(([stage, value]) => [`time: ${stage}`, `${shown(value, 3)} ms`]),
    ];
    this.table.replaceChildren(...rows.flatMap(([name, text]) => [element("dt", {}, name), element("dd", {}, String(text))]));
    this.histogramOfAll.draw(newest.histogram, ...newest.range, newest.range);
  }
}

const wait = (milliseconds) => new Promise((done) => setTimeout(done, milliseconds));

// Until there is a first exposure: what is shown, or null where the loop ended before.
export async function firstOf(app) {
  for (let about = await app.source.about(); ; about = await app.source.about()) {
    if (!about.live || about.items.length) return about;
    app.name("tmca live: waiting for the first exposure");
    if ((await app.source.newest(-1)).ended) return null;
  }
}

// Ask for the newest exposure again and again, each time when all that is shown of the one before is here. Reading and
// drawing take a third of the time at most: the loop computes on the same machine.
export async function follow(app) {
  for (let last = -1, answered = Date.now(); ; ) {
    const newest = await app.source.newest(last).catch(() => null);
    if (newest && newest.exposure !== last) app.renew(newest);
    if (newest?.ended || (!newest && Date.now() - answered > PATIENCE)) return app.name("tmca live: ended");
    app.name(newest ? "tmca live" : "tmca live: no answer");
    if (newest) [last, answered] = [newest.exposure, Date.now()];
    await (newest ? app.settled() : wait(PAUSE));
    if (newest) await wait(Math.min(2 * (Date.now() - answered), PAUSE / 2));
  }
}
