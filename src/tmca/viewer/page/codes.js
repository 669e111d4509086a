// Codes: what aperture and shutter show in a slot, and the code that stands for all slots, with a slider of its own.
import { Slider } from "./tools.js";
import { Stack } from "./stack.js";

export class Codes extends Stack {
  build() {
    this.channel = 0;
    super.build();
    const code = this.items[0].layers.find((layer) => layer.name === "code");
    if (!code) return;
    this.channels = new Slider({ label: code.axis.label, values: code.axis.values, unit: "", names: code.axis.names, index: 0, moved: (index) => ((this.channel = index), this.redraw()) });
    this.channels.root.hidden = code.planes < 2;
    this.sliderParts = [this.slider.root, this.channels.root];
  }

  begin() {
    for (const item of this.items) for (const layer of item.layers) this.planes.prefetch(item.number, layer, 0);
  }

  specs() {
    return this.items.flatMap((item) => item.layers.map((layer) => this.codeSpec(item, layer)));
  }

  codeSpec(item, layer) {
    const index = layer.name === "code" ? this.channel : Math.min(this.index, layer.planes - 1);
    const spec = this.one(item, layer, layer.label, index), key = `${item.number}/${layer.name}`;
    const file = this.items.length > 1 ? item.title : "";
    return { ...spec, key, details: this.detailsOf(key, layer, index), note: [file, spec.note].filter(Boolean).join("  ·  ") };
  }

  positionOf(layer, index) {
    return layer.axis.names?.length ? layer.axis.names[index] : `${layer.axis.label} ${index + 1} of ${layer.planes}`;
  }

  drawSide() {
    super.drawSide();
    this.channels?.drawScale();
  }

  state() {
    return { ...super.state(), channel: this.channel || null };
  }

  restore(given) {
    super.restore(given);
    const channel = Number(given.channel ?? 0);
    if (this.channels && channel >= 0 && channel < this.channels.values.length) this.channels.set((this.channel = channel));
  }
}
