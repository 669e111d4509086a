// The page in a cell of a notebook: what it asks goes to the kernel, through anywidget.
import { App } from "./app.js";
import { Served } from "./planes.js";

const HEIGHT = 640;

class Kernel extends Served {
  constructor(model) {
    super("");
    Object.assign(this, { model, waiting: new Map(), count: 0 });
    this.hear = (answer, buffers) => {
      this.waiting.get(answer.id)?.(answer, buffers);
      this.waiting.delete(answer.id);
    };
    model.on("msg:custom", this.hear);
  }

  async ask(path, given = {}) {
    const id = `${this.count++}`;
    const answered = new Promise((done) => this.waiting.set(id, (...answer) => done(answer)));
    this.model.send({ id, path, given });
    const [answer, buffers] = await answered;
    if (answer.error) throw new Error(answer.error);
    const bytes = () => {
      const view = buffers[0];
      return view.buffer.slice(view.byteOffset, view.byteOffset + view.byteLength);
    };
    return { json: async () => answer.said, arrayBuffer: async () => bytes() };
  }

  close() {
    this.model.off("msg:custom", this.hear);
  }
}

export default {
  async render({ model, el }) {
    const holder = document.createElement("div"), root = holder.attachShadow({ mode: "open" });
    holder.style.height = `${HEIGHT}px`;
    root.innerHTML = `<style>${model.get("_style")}</style>${model.get("_body")}`;
    el.dataset.lmSuppressShortcuts = "true"; // keys are the page's, not the notebook's
    el.append(holder);
    const kernel = new Kernel(model), page = root.querySelector(".page");
    page.tabIndex = -1;
    let view = {};
    const address = {
      read: () => view,
      write: (now) => (view = now),
      listen(app) {
        page.addEventListener("keydown", (event) => (app.key(event), event.stopPropagation()));
        root.getElementById("link").hidden = true;
      },
    };
    const app = new App(root, kernel, address);
    holder.tmca = app;
    app.begin().catch((error) => app.say(error.message, true));
    return () => kernel.close();
  },
};
