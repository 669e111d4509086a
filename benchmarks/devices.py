"""Operators and decoders on a processor and on another device: ``python benchmarks/devices.py --device cuda``.

256×256×12, K = 8, random codes in tiles of 32, σ = 0.01; LMMSE with its standard deviation, first frame and prepared
next frame; the network that comes with tmca. Wall time, medians; largest difference between both estimates.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import torch
from timing import Clock

import tmca
from tmca.decoders import make_decoder
from tmca.priors import find_prior

SIZE = (256, 256)


def tasks(snapshot: tmca.Snapshot, prior: object) -> dict[str, Callable[[], torch.Tensor]]:
    """What is timed, by name; each returns what both devices shall agree on."""
    camera, values = snapshot.camera, snapshot.values
    operator, scene = camera.operator(), torch.full((1, *camera.scene_shape), 0.5, device=values.device)
    prepared = make_decoder("lmmse", "spectral", {"uncertainty": True}).prepare(camera, prior)

    def decoded(name: str, given: object = None, **settings: object) -> Callable[[], torch.Tensor]:
        decoder = make_decoder(name, "spectral", settings)
        return lambda: decoder(snapshot, given).values

    return {
        "forward and adjoint": lambda: operator.A_adjoint(operator.A(scene)),
        "least norm": decoded("dagger"),
        "Tikhonov": decoded("tikhonov"),
        "ADMM-TV joint": decoded("admm-tv-joint"),
        "LMMSE, first frame": decoded("lmmse", prior, uncertainty=True),
        "LMMSE, next frame": lambda: prepared(values).values,
        "network": decoded("network", prior, weights="default"),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cuda")
    parser.add_argument("--scene", default="coffee")
    parser.add_argument("--prior", default=None)
    parser.add_argument("--repeats", type=int, default=5)
    given = parser.parse_args()
    torch.set_num_threads(1)
    cube = tmca.read(given.scene, bands=12)[:, : SIZE[0], : SIZE[1]]
    camera = tmca.SpectralCamera(
        cube["wavelength"].values.tolist(), SIZE, slots=8, period=32, sensor=tmca.Sensor(read_noise=0.01)
    )
    here = tmca.simulate(cube, camera)
    prior = find_prior(camera, given.prior)
    there = here.to(given.device)
    print(f"{'':22s} {'CPU, ms':>10s} {given.device + ', ms':>10s} {'difference':>11s}")
    ours, others = tasks(here, prior), tasks(there, prior)
    clocks = Clock(wall=True), Clock(given.device, wall=True)
    for name, task in ours.items():
        first = clocks[0].median(task, min(given.repeats, 2))
        second = clocks[1].median(others[name], given.repeats)
        apart = float((task() - others[name]().cpu()).abs().max())
        print(f"{name:22s} {1e3 * first:10.2f} {1e3 * second:10.2f} {apart:11.1e}", flush=True)


if __name__ == "__main__":
    main()
