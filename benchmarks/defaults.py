"""How defaults were chosen, on training scenes: ``python benchmarks/defaults.py --train SPLIT --study NAME``.

``tv``: PSNR of ADMM-TV over weights, beside `tmca.decoders.default_weight`. ``blocks``: PSNR of the patch LMMSE over
block sizes of the prior, every scene decoded under a prior of the others. ``adapted``: PSNR of the adapted LMMSE over
the number of times its prior is refitted, and the PSNR that its standard deviation predicts, in the same way.
``tiles``: the same over the size of its tiles. ``subspace``: PSNR of plug-and-play ADMM in the scene's own subspace
over dimensions and strengths, beside ADMM-TV. ``tikhonov``: PSNR of least squares with a smooth scene over weights and
numbers of iterations, beside ADMM-TV and the least-norm scene.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from itertools import product
from pathlib import Path

import torch
import xarray as xr

from tmca.cameras import Snapshot, SpectralCamera
from tmca.data import read_split
from tmca.data.fitting import middle_of
from tmca.data.scenes import load_scene
from tmca.decoders import admm_tv, decode, default_weight, pnp_admm, tv_denoiser
from tmca.decoders.adapted import AdaptedEstimator
from tmca.decoders.least_squares import tikhonov
from tmca.decoders.pnp import subspace_denoiser
from tmca.metrics import psnr
from tmca.priors import learn_prior
from tmca.sensor import Noise, Sensor

CODES = {
    "static": {"slots": 1, "aperture": "static", "shutter": "open"},
    "random K = 8": {"slots": 8},
}
NOISES = (0.0, 0.01, 0.05)
FACTORS = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0, 10.0)
REFITS = (0, 1, 2, 4, 8)
TILES = (None, 128, 64)
STIFFNESSES, STEPS = (0.03, 0.1, 0.3, 1.0, 3.0), (30, 60, 100)
RANKS, STRENGTHS = (4, 6, 8, 12), (2.5, 5.0, 10.0)
BLOCKS = ((6, 30), (6, 36), (8, 36), (10, 36), (12, 30), (12, 36), (12, 42), (16, 36))


def snapshot(cube: xr.DataArray, code: str, noise: float) -> tuple[Snapshot, torch.Tensor]:
    """A snapshot of a scene, and the scene (1, L, H, W)."""
    camera = SpectralCamera(
        bands=cube["wavelength"].values.tolist(), size=cube.shape[1:], sensor=Sensor(read_noise=noise), **CODES[code]
    )
    scene = torch.from_numpy(cube.values)[None]
    return Snapshot(camera(scene, generator=0), camera), scene


Estimates = Callable[[Snapshot, float], Iterator[tuple[str, torch.Tensor]]]
"""Of a snapshot with some noise: what each setting of a study makes of it, by name."""


def _compare(cubes: Sequence[xr.DataArray], beside: Sequence[str], tried: Estimates) -> None:
    """Mean PSNR over scenes of decoders and of a study's settings, a line per code and noise."""
    for code, noise in product(CODES, NOISES):
        values: dict[str, list[float]] = {}
        for cube in cubes:
            taken, scene = snapshot(cube, code, noise)
            for name in beside:
                values.setdefault(name, []).append(float(psnr(decode(taken, name).estimate, scene)))
            for name, estimate in tried(taken, noise):
                values.setdefault(name, []).append(float(psnr(estimate, scene)))
        text = "  ".join(f"{name}: {sum(v) / len(v):.2f}" for name, v in values.items())
        print(f"{code}, σ = {noise:g}  {text}", flush=True)


def study_tv(cubes: Sequence[xr.DataArray]) -> None:
    """Mean PSNR over scenes for weights around the default."""

    def tried(taken: Snapshot, noise: float) -> Iterator[tuple[str, torch.Tensor]]:
        for joint, factor in product((True, False), FACTORS):
            weight, bounds = factor * default_weight(noise), (0.0, float("inf"))
            result = admm_tv(taken.camera.operator(), taken.values, weight, joint=joint, bounds=bounds)
            yield f"{'joint' if joint else 'band'} ×{factor:g}", result.estimate

    _compare(cubes, (), tried)


def study_subspace(cubes: Sequence[xr.DataArray]) -> None:
    """Mean PSNR over scenes for dimensions and strengths of the variation, beside joint ADMM-TV."""

    def tried(taken: Snapshot, noise: float) -> Iterator[tuple[str, torch.Tensor]]:
        for rank, strength in product(RANKS, STRENGTHS):
            denoise = subspace_denoiser(tv_denoiser(strength, joint=False, max_iterations=20), rank)
            result = pnp_admm(taken.camera.operator(), taken.values, denoise, noise_sigma=max(noise, 0.01))
            yield f"{rank}, {strength:g}", result.estimate

    _compare(cubes, ("admm-tv-joint", "pnp-subspace"), tried)


def study_tikhonov(cubes: Sequence[xr.DataArray]) -> None:
    """Mean PSNR over scenes for weights and iterations, beside joint ADMM-TV and the least norm."""

    def tried(taken: Snapshot, noise: float) -> Iterator[tuple[str, torch.Tensor]]:
        for weight, steps in product(STIFFNESSES, STEPS):
            found = tikhonov(taken.camera.operator(), taken.values, weight=weight, iterations=steps)
            yield f"{weight:g}, {steps}", found.clamp_min(0)

    _compare(cubes, ("admm-tv-joint", "dagger"), tried)


def study_blocks(cubes: Sequence[xr.DataArray], whole: Sequence[xr.DataArray]) -> None:
    """Mean PSNR over scenes and codes for block sizes (rows × columns), each scene left out of its prior."""
    for block in BLOCKS:
        values: dict[float, list[float]] = {noise: [] for noise in NOISES[:2]}
        for _index, cube in enumerate(cubes):
            others = [c for c in whole if c.attrs["name"] != cube.attrs["name"]]
            prior = learn_prior(others, extent=cube.sizes["wavelength"] - 1, block=block)
            for noise in values:
                for code in CODES:
                    taken, scene = snapshot(cube, code, noise)
                    values[noise].append(float(psnr(decode(taken, "lmmse", prior=prior).estimate, scene)))
        text = "  ".join(f"σ = {noise:g}: {sum(v) / len(v):.2f} dB" for noise, v in values.items())
        print(f"block {block[0]:2d} × {block[1]:2d}  {text}", flush=True)


def study_adapted(cubes: Sequence[xr.DataArray], whole: Sequence[xr.DataArray]) -> None:
    """PSNR, and in brackets the predicted one, over how often the prior is refitted; each scene left out of it."""
    print("scene, code, sigma:  " + "  ".join(f"{count} times" for count in REFITS))
    for cube in cubes:
        _adapted(cube, whole, {f"{count} times": {"iterations": count} for count in REFITS})


def study_tiles(cubes: Sequence[xr.DataArray], whole: Sequence[xr.DataArray]) -> None:
    """The same over the size of the tiles that have a prior of their own, on whole scenes: minutes for each."""
    print("scene, code, sigma:  " + "  ".join(str(tile) for tile in TILES))
    for cube in whole:
        _adapted(cube, whole, {str(tile): {"tile": tile} for tile in TILES})


def _adapted(cube: xr.DataArray, whole: Sequence[xr.DataArray], settings: dict[str, dict[str, int | None]]) -> None:
    others = [c for c in whole if c.attrs["name"] != cube.attrs["name"]]
    prior = learn_prior(others, extent=cube.sizes["wavelength"] - 1)
    for code in CODES:
        for noise in NOISES[:2]:
            taken, scene = snapshot(cube, code, noise)
            found = []
            for own in settings.values():
                estimator = AdaptedEstimator(prior, taken.camera.taps(), Noise(noise), **own)
                result = estimator(taken.values, uncertainty=True)
                predicted = -10 * torch.log10(result.deviation.square().mean())
                found.append(f"{float(psnr(result.estimate.clamp_min(0), scene)):.2f} ({float(predicted):.2f})")
            print(f"{cube.attrs['name']}, {code}, {noise:g}:  " + "  ".join(found), flush=True)


OF_CROPS = {"tv": study_tv, "subspace": study_subspace, "tikhonov": study_tikhonov}
STUDIES = {"blocks": study_blocks, "adapted": study_adapted, "tiles": study_tiles}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--train", type=Path, required=True, help="split file of training scenes")
    parser.add_argument("--study", choices=(*OF_CROPS, *STUDIES), default="tv")
    parser.add_argument("--size", type=int, default=160)
    options = parser.parse_args()
    torch.set_num_threads(1)
    whole = [load_scene(path, bands=12) for path in read_split(options.train)]
    size = (options.size, options.size)
    cubes = [middle_of(cube, size, cube.attrs["name"]) for cube in whole if min(cube.shape[1:]) >= options.size]
    print(f"{len(cubes)} scenes: {', '.join(str(cube.attrs['name']) for cube in cubes)}")
    if options.study in OF_CROPS:
        OF_CROPS[options.study](cubes)
    else:
        STUDIES[options.study](cubes, whole)


if __name__ == "__main__":
    main()
