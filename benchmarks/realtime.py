"""A next frame of one camera, solved anew, by a prepared decoder and by a fast one: ``python benchmarks/realtime.py``.

256×256×12, K = 8, random codes, in tiles of 32 and such that do not repeat, σ = 0.01, the rendered scenes' prior,
coffee; LMMSE with its standard deviation, and the mixture behind tiles. One thread, CPU time, medians.
"""

from __future__ import annotations

import torch
from timing import Clock, asked, milliseconds, show

import tmca
from tmca.decoders import PatchEstimator
from tmca.priors import find_prior

CAMERAS = {
    "one bucket": {"shutter": "random", "period": 32},
    "two buckets": {"shutter": "balanced", "buckets": 2, "period": 32},
    "one bucket, no tiles": {"shutter": "random"},
    "mixture": {"shutter": "random", "period": 32},
}
"""The mixture's prior for the row of that name, one Gaussian for the others."""


def measured(settings: dict[str, object], kind: str, repeats: int) -> dict[str, float]:
    """Milliseconds of a next frame solved anew, prepared and fast, those of preparing; largest and root mean square
    difference from the frame that is solved anew."""
    camera = tmca.SpectralCamera(12, (256, 256), slots=8, sensor=tmca.Sensor(read_noise=0.01), **settings)
    frame = tmca.simulate(tmca.read("coffee"), camera).values
    prior = find_prior(camera, None, kind)
    estimator = PatchEstimator(prior, camera.taps(), camera.noise)
    solved = milliseconds(lambda: estimator(frame, uncertainty=True), max(1, repeats // 5))
    before = estimator(frame, uncertainty=True)
    prepared = 1e3 * Clock().seconds(estimator.precompute)
    after = estimator(frame, uncertainty=True)
    rows = {
        "solved anew (ms)": solved,
        "prepared (ms)": milliseconds(lambda: estimator(frame, uncertainty=True), repeats),
        "preparing (ms)": prepared,
        "largest difference": float((after.estimate - before.estimate).abs().max()),
    }
    if estimator.bank is None:
        return rows
    fast = PatchEstimator(prior, camera.taps(), camera.noise, fast=True).precompute()
    away = fast(frame, uncertainty=True).estimate - before.estimate
    rows["fast (ms)"] = milliseconds(lambda: fast(frame, uncertainty=True), repeats)
    rows["fast: root mean square"] = float(away.square().mean().sqrt())
    return rows


def main() -> None:
    arguments = asked(__doc__, 15)
    torch.set_num_threads(1)
    with torch.no_grad():
        kinds = {name: "mixture" if name == "mixture" else "gaussian" for name in CAMERAS}
        rows = {name: measured(settings, kinds[name], arguments.repeats) for name, settings in CAMERAS.items()}
    show(rows, {}, arguments.json)


if __name__ == "__main__":
    main()
