// The page of its own: a server's, or one file; its address keeps the view.
import { App } from "./app.js";
import { readHash, writeHash } from "./hash.js";
import { Embedded, Served } from "./planes.js";

const address = {
  read: readHash,
  write: writeHash,
  listen(app) {
    window.addEventListener("keydown", (event) => app.key(event));
    window.addEventListener("hashchange", () => app.choose(app.desks.indexOf(app.desk), readHash()));
  },
};
const embedded = JSON.parse(document.getElementById("embedded").textContent);
const source = embedded ? new Embedded(embedded) : new Served(new URLSearchParams(location.search).get("token") ?? "");
const app = new App(document, source, address);
window.tmca = app;
app.begin().then(() => (document.title = `${app.title ?? "ended"} – tmca view`), (error) => app.say(error.message, true));
