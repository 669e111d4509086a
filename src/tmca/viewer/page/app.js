// The page: what is shown is asked for, grouped by kind, and drawn once a frame where something changed.
import { element } from "./numbers.js";
import { Depth } from "./depth.js";
import { LightField } from "./lightfield.js";
import { Painter } from "./painter.js";
import { Planes } from "./planes.js";
import { Codes } from "./codes.js";
import { firstOf, follow, Live } from "./live.js";
import { Stack } from "./stack.js";
import { ink, useGround } from "./theme.js";
import { saveStage } from "./tools.js";

const KINDS = { live: ["Live", Live], cube: ["Cube", Stack], snapshot: ["Snapshot", Stack], codes: ["Codes", Codes], "light field": ["Light field", LightField], depth: ["Scene with depth", Depth], array: ["Array", Stack] };
const HELP = [
  ["move over a picture", "curve and values at the cursor"],
  ["click", "keep the curve of a pixel"],
  ["Shift + drag", "mean curve of a region, ± its spread"],
  ["wheel, + and −", "zoom; drag moves, double click shows all"],
  ["Tab, arrows, Enter", "choose a picture, move its cursor (Shift: by 10), keep the curve"],
  [", and .", "plane before and after; Page up and down by 10; space runs"],
  ["C, B", "colours, one band"],
  ["D, E", "difference, error map"],
  ["1 … 9", "page"],
  ["T", "dark or light ground; a saved picture has it too"],
  ["L, S", "copy a link that keeps this view, save the pictures"],
  ["?", "this help"],
];

export class App {
  // `root` is the document, or the shadow root that holds the page in a notebook.
  constructor(root, source, address) {
    const find = (name) => root.getElementById(name);
    this.page = root.querySelector(".page");
    this.address = address;
    Object.assign(this, { root, stage: find("stage"), panelsRoot: find("panels"), side: find("side"), sliders: find("sliders"), tabs: find("tabs"), message: find("message"), help: find("help") });
    this.source = source;
    this.planes = new Planes(this.source, () => this.redraw(), (error) => this.say(error.message, true));
    this.frames = 0;
  }

  async begin() {
    this.painter = new Painter(this.root.getElementById("paint"));
    this.painter.restored = () => this.redraw();
    const about = await firstOf(this);
    if (!about) return this.name("tmca live: ended");
    const { items } = about;
    items.forEach((item, number) => (item.number = number));
    this.title = [...new Set(items.map((item) => item.title))].join(", ");
    const kinds = [...new Set(items.map((item) => item.kind))];
    this.desks = kinds.map((kind) => new KINDS[kind][1](this, items.filter((item) => item.kind === kind)));
    this.tabs.replaceChildren(...kinds.map((kind, at) => {
      const count = this.desks[at].items.length;
      const tab = element("button", { textContent: count > 1 ? `${KINDS[kind][0]} (${count})` : KINDS[kind][0], onclick: () => this.choose(at) });
      tab.setAttribute("role", "tab");
      return tab;
    }));
    this.#listen();
    this.choose(0, this.address.read());
    if (about.live) follow(this);
  }

  // What stands at the top.
  name(text) {
    const heading = this.root.querySelector("h1");
    if (heading.textContent !== text) heading.textContent = text;
  }

  // Another exposure is the newest.
  renew(newest) {
    this.newest = newest;
    this.planes.forget();
    for (const desk of this.desks) desk.forget();
    this.redraw();
  }

  // What is shown is drawn, and all that it needs is here; a page that nobody sees waits.
  async settled() {
    const drawn = () => new Promise(requestAnimationFrame);
    await drawn();
    await this.planes.rest();
    await drawn();
  }

  choose(number, given = null) {
    const at = given?.page ? Math.min(Math.max(Number(given.page) - 1 || 0, 0), this.desks.length - 1) : number;
    this.desk?.end?.();
    this.desk = this.desks[at];
    [...this.tabs.children].forEach((tab, place) => tab.setAttribute("aria-selected", place === at));
    this.side.replaceChildren(...this.desk.sideParts);
    this.sliders.replaceChildren(...this.desk.sliderParts);
    this.sliders.hidden = this.desk.sliderParts.every((part) => part.hidden);
    if (given) useGround(given.ground === "light" ? "light" : "dark", this.page);
    if (given) this.desk.restore(given);
    this.desk.arranged = null;
    this.desk.begin?.();
    this.redraw();
  }

  redraw() {
    if (this.waiting || !this.desk) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.draw();
    });
  }

  draw() {
    this.desk.draw();
    this.frames++;
  }

  saveState() {
    if (!this.desk) return;
    const page = this.desks.length > 1 ? this.desks.indexOf(this.desk) + 1 : null;
    this.address.write({ page, ground: ink.name === "light" ? "light" : null, ...this.desk.state() });
  }

  say(text, wrong = false) {
    this.message.textContent = text;
    this.message.className = wrong ? "shown wrong" : "shown";
    clearTimeout(this.saying);
    this.saying = setTimeout(() => (this.message.className = ""), wrong ? 8000 : 2500);
  }

  async copyLink() {
    this.saveState();
    const copied = await navigator.clipboard?.writeText(location.href).then(() => true, () => false);
    this.say(copied ? "The link is copied: it keeps this view." : "The address of this page keeps this view: copy it from there.");
  }

  savePictures() {
    this.desk.draw();
    saveStage(this.root.getElementById("paint"), this.desk.arrange(), `${this.desk.items[0].title}.png`);
  }

  #listen() {
    const on = (name, action) => this.root.getElementById(name).addEventListener("click", action);
    on("link", () => this.copyLink());
    on("png", () => this.savePictures());
    on("csv", () => this.desk.saveTable());
    on("ground", () => this.turnGround());
    on("ask", () => this.showHelp());
    new ResizeObserver(() => ((this.desk.arranged = null), this.draw())).observe(this.stage); // before the new size is seen
    this.address.listen(this);
  }

  key(event) {
    const typing = event.target.matches?.("input[type=number], select");
    if (typing || event.ctrlKey || event.metaKey || event.altKey || this.help.open) return;
    if (event.key === " " && event.target.matches?.("button")) return;
    const number = Number(event.key);
    if (event.key === "?") this.showHelp();
    else if (event.key === "l" && !this.root.getElementById("link").hidden) this.copyLink();
    else if (event.key === "s") this.savePictures();
    else if (event.key === "t") this.turnGround();
    else if (number >= 1 && number <= this.desks.length) this.choose(number - 1);
    else if (!this.desk.key(event)) return;
    event.preventDefault();
  }

  turnGround() {
    useGround(ink.name === "dark" ? "light" : "dark", this.page);
    this.desk?.listPlaces();
    this.redraw();
    this.saveState();
  }

  showHelp() {
    const close = element("button", { textContent: "Close", onclick: () => this.help.close() });
    const rows = HELP.flatMap(([keys, text]) => [element("dt", {}, keys), element("dd", {}, text)]);
    const about = "Your files are read on this machine alone and never written. All pictures of a page share zoom and cursor.";
    this.help.replaceChildren(element("h2", {}, "How to look around"), element("dl", {}, ...rows), element("p", { className: "hint" }, about), close);
    this.help.showModal();
  }
}

