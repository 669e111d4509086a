"""The viewer in Chromium without a window: how soon a cube of 512×512×31 is shown, and how many bands a second pass.

``python benchmarks/viewer.py [FILE…]``; a cube of noise without a file. The processor computes the graphics
(SwiftShader), so that a graphics card is faster, and what else it does counts: the load stands beside.
"""

from __future__ import annotations

import json
import os
import shutil
import statistics
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from playwright.sync_api import Browser, sync_playwright

import tmca

_SCRUB = """async () => {
  const desk = tmca.desk, count = desk.axis.values.length, start = performance.now(), before = tmca.frames;
  const draw = desk.draw.bind(desk);
  let busy = 0;
  desk.draw = () => {
    const began = performance.now();
    draw();
    busy += performance.now() - began;
  };
  await new Promise((done) => {
    const next = () => {
      if (performance.now() - start > 3000) return done();
      desk.move((desk.index + 1) % count);
      requestAnimationFrame(next);
    };
    next();
  });
  const frames = tmca.frames - before;
  return [frames / ((performance.now() - start) / 1000), busy / frames];
}"""


def measured(file: str, browser: Browser) -> tuple[float, float, float, float]:
    """Seconds to the first band, those of the page alone, bands a second, milliseconds of script a band."""
    start = time.perf_counter()
    with tmca.view(file) as viewer:
        page = browser.new_page(viewport={"width": 1280, "height": 820})
        asked = time.perf_counter()
        page.goto(f"{viewer.address}#colour=0")
        while not page.evaluate(
            "Boolean(window.tmca?.frames > 1 && [...tmca.desk.panels.values()][0].spec.paint.plane)"
        ):
            time.sleep(0.005)
        shown = time.perf_counter()
        while not page.evaluate("tmca.planes.whole(0, tmca.desk.items[0].layers[0])"):
            time.sleep(0.05)
        rate, busy = page.evaluate(_SCRUB)
        page.close()
    return shown - start, shown - asked, rate, busy


def main(files: list[str]) -> None:
    """Print medians of five as JSON."""
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    with sync_playwright() as running, tempfile.TemporaryDirectory() as folder:
        if not files:
            files = [str(Path(folder) / "noise.npy")]
            np.save(files[0], np.random.default_rng(0).random((31, 512, 512), np.float32))
        browser = running.chromium.launch(
            executable_path=chromium, args=["--no-sandbox", "--enable-unsafe-swiftshader"]
        )
        for file in files:
            rows = [measured(file, browser) for _ in range(6)][1:]  # the first starts the browser's processes
            opened, page, rate, busy = (statistics.median(column) for column in zip(*rows, strict=True))
            row = {
                "opened (s)": opened,
                "of which the page (s)": page,
                "bands a second": rate,
                "script (ms a band)": busy,
            }
            row |= {"best of five": {"opened (s)": min(r[0] for r in rows), "bands a second": max(r[2] for r in rows)}}
            print(json.dumps({"file": Path(file).name, **row, "load": os.getloadavg()[0]}))
        browser.close()


if __name__ == "__main__":
    main(sys.argv[1:])
