"""Our own files: snapshots, codes, priors, weights, estimates."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from tests.fuzz.kinds import kind
from tmca.applications import evaluate
from tmca.cameras import LightFieldCamera, Snapshot, SpectralCamera, SpectralDepthCamera, camera_of
from tmca.cameras.described import read_patterns
from tmca.cameras.phase_codes import write_phase_codes
from tmca.codes.files import write_codes
from tmca.data import describe
from tmca.decoders import Estimate, Weights, build_network, make_decoder
from tmca.decoders.nets.build import build_depth_network
from tmca.optics import PhaseMaskBench, Stroke
from tmca.priors import GaussianMixturePrior, GaussianPrior, PatchDictionary, load_prior
from tmca.sensor import Sensor
from tmca.specs import LightFieldSpec, SpectralDepthSpec, SpectralSpec

TESTS = Path(__file__).parents[1]
BANDS = (450e-9, 550e-9, 650e-9)
NET = {"widths": [2, 3], "blocks": 1, "gather": 2}


def _sensor() -> Any:
    return Sensor(read_noise=0.01, full_well=1e4, read_noise_electrons=3.0, bits=12)


def _spectral(size: tuple[int, int] = (6, 7), **parts: Any) -> Any:
    return SpectralCamera(BANDS, size, 2, sensor=_sensor(), **parts)


def _coloured() -> Any:
    return _spectral(coloured=torch.rand(3, 6, 7, generator=torch.Generator().manual_seed(0)))


def _views(**parts: Any) -> Any:
    return LightFieldCamera(3, (6, 7), 2, sensor=_sensor(), **parts)


def _depth(**parts: Any) -> Any:
    bench = PhaseMaskBench(diameter=0.5e-3, window=(3, 3), mask_pixels=8)
    return SpectralDepthCamera(
        BANDS, (6, 7), 2, planes=2, bench=bench, filters="gaussian", period=2, modes=3,
        sensor=_sensor(), **parts,
    )  # fmt: skip


def _blurred() -> Any:
    return _spectral(relay_blur=[0.5, 0.6, 0.7], exposure="per-slot", beside=(1, 0))


def _scene(camera: Any, colours: int = 1) -> tuple[Any, ...]:
    source = torch.Generator().manual_seed(1)
    scene = torch.rand(colours, *camera.scene_shape, generator=source)
    depth = torch.full((colours, 1, *camera.size), 0.8)
    return (scene, depth) if camera.psf_window is not None else (scene,)


def _snapshot(camera: Any, colours: int = 1) -> Any:
    notes = {"scene": "random", "noise_seed": 3, "hardware": {"leakage": 0.1}, "scene_reading": '{"source": "coffee"}'}
    return Snapshot(camera(*_scene(camera, colours), generator=0), camera, notes)


def _take(make: Callable[[], Any], colours: int = 1) -> Callable[[Path], object]:
    return lambda path: _snapshot(make(), colours).save(path)


def _read_snapshot(path: Path) -> Any:
    """Loaded and, where that is quick, decoded, as a user does next."""
    snapshot = Snapshot.load(path)
    camera = snapshot.camera
    state = {"codes": camera.codes(), "noise": camera.noise, "throughput": camera.throughput(), "text": repr(snapshot)}
    if camera.psf_window is None:
        state["backprojected"] = camera.A_adjoint(snapshot.values)
    return snapshot, state, dict(camera.state_dict()), snapshot.notes


def _copied(*parts: str) -> Callable[[Path], object]:
    return lambda path: shutil.copy(TESTS.joinpath(*parts), path)


kind("spectral-snapshot.nc", _take(lambda: _spectral(period=3)), _read_snapshot)
kind("blurred-snapshot.nc", _take(_blurred), _read_snapshot)
kind("dual-snapshot.nc", _take(lambda: _spectral(disperser="dual")), _read_snapshot)
kind("coloured-snapshot.nc", _take(_coloured), _read_snapshot)
kind("views-snapshot.nc", _take(lambda: _views(shear=(1.0, -0.7), exposure="per-slot"), 3), _read_snapshot)
kind("depth-snapshot.nc", _take(_depth), _read_snapshot)
kind("buckets-snapshot.nc", _take(lambda: _spectral(buckets=2, exposure="per-slot")), _read_snapshot)
kind("burst-snapshot.nc", _take(lambda: _spectral(buckets=2, shutter="burst")), _read_snapshot)
kind("views-buckets-snapshot.nc", _take(lambda: _views(buckets=2)), _read_snapshot)
kind("depth-buckets-snapshot.nc", _take(lambda: _depth(buckets=2)), _read_snapshot)
for _name in ("spectral", "light-field", "spectral-depth"):
    kind(f"{_name}-snapshot-0-1.nc", _copied("cameras", "files", f"{_name}-0.1.nc"), _read_snapshot)


kind("inspected-snapshot.nc", _take(_views), describe)


# Codes


def _codes(path: Path, buckets: int = 1) -> None:
    codes = _spectral((8, 9), period=4, buckets=buckets).codes
    notes = {"kind": "codes", "figure": 1.5}
    write_codes(path, codes.aperture.tile(), codes.shutter.tile(), (4, 4), notes, buckets=buckets)


def _read_codes(path: Path) -> Any:
    camera = camera_of(SpectralSpec(codes=str(path)), bands=BANDS, size=(8, 9))
    return camera.codes(), camera.throughput(), camera.buckets


def _phase_codes(path: Path) -> None:
    write_phase_codes(_depth(stroke=Stroke(-1e-6, 1e-6, 9)), path, "gaussian", "monochrome", {"seed": 1})


def _read_phase_codes(path: Path) -> Any:
    camera = camera_of(SpectralDepthSpec(codes=str(path)), bands=BANDS, size=(8, 9))
    return camera.codes(), camera.throughput(), dict(camera.state_dict())


def _patterns(path: Path) -> None:
    np.save(path, (np.random.default_rng(0).random((2, 6, 9)) < 0.5).astype(np.uint8))


def _read_patterns(path: Path) -> Any:
    return read_patterns(str(path), "shutter")


def _vignetting(path: Path) -> None:
    np.save(path, np.full((3, 3), 0.5))


def _read_vignetting(path: Path) -> Any:
    return dict(camera_of(LightFieldSpec(vignetting=str(path)), views=(3, 3), size=(6, 7)).state_dict())


kind("codes.nc", _codes, _read_codes)
kind("buckets-codes.nc", partial(_codes, buckets=2), _read_codes)
kind("phase-codes.nc", _phase_codes, _read_phase_codes)
kind("patterns.npy", _patterns, _read_patterns)
kind("vignetting.npy", _vignetting, _read_vignetting)


# Priors


def _cubes(channels: int) -> list[Any]:
    return [torch.rand(channels, 9, 11, generator=torch.Generator().manual_seed(0))]


def _gaussian(path: Path) -> None:
    GaussianPrior.learn(_cubes(3), (2, 4), wavelengths=BANDS, sources=["a", "b"]).save(path)


def _whole_gaussian(path: Path) -> None:
    settings = {"kinds": 2, "rank": 3, "gains": 2, "samples": 60, "wavelengths": BANDS}
    GaussianMixturePrior.learn(_cubes(3), (2, 4), **settings).component(0).save(path)


def _mixture(path: Path) -> None:
    GaussianMixturePrior.learn(_cubes(9), (2, 2), views=(3, 3), kinds=2, rank=3, gains=2, samples=60).save(path)


def _dictionary(path: Path) -> None:
    PatchDictionary.learn(_cubes(9), (2, 3), views=(3, 3), atoms=4, coreset=30, rank=4, batch=10).save(path)


def _read_prior(path: Path) -> Any:
    prior = load_prior(path)
    return prior, prior.arrays(), prior.wavelengths, prior.attributes(), repr(prior)


kind("gaussian-prior.nc", _gaussian, _read_prior)
kind("whole-prior.nc", _whole_gaussian, _read_prior)
kind("mixture-prior.nc", _mixture, _read_prior)
kind("dictionary-prior.nc", _dictionary, _read_prior)
for _name in ("gaussian", "mixture", "dictionary"):
    kind(f"{_name}-prior-0-1.nc", _copied("priors", "files", f"{_name}-0.1.nc"), _read_prior)


# Weights


def _weights(make: Callable[[], Any], network: Callable[[Any], Any], prior: str = "") -> Callable[[Path], object]:
    def save(path: Path) -> None:
        torch.manual_seed(0)
        camera = make()
        Weights.of(network(camera), camera, prior, {"best": {"psnr": 1.0}, "scenes": ["a"]}).save(path)

    return save


def _built(name: str, **settings: Any) -> Callable[[Any], Any]:
    def build(camera: Any) -> Any:
        bands = int(np.prod(camera.scene_shape[:-2]))
        return build_network(name, bands=bands, start="dagger", **settings)

    return build


def _two_headed(camera: Any) -> Any:
    return build_depth_network({"start": "snapshot", **NET}, camera)


def _read_bank(path: Path) -> Any:
    """The estimate by a bank, which is made where there is none."""
    camera = _spectral((6, 20), period=2)
    scene = torch.rand(3, 12, 30, generator=torch.Generator().manual_seed(1))
    prior = GaussianPrior.learn([scene], (2, 5), wavelengths=BANDS)
    prepared = make_decoder("lmmse", "spectral", {"uncertainty": True}).prepare(camera, prior, bank=path)
    return prepared(camera(torch.full((1, 3, 6, 20), 0.5), generator=0)).values


def _read_weights(path: Path) -> Any:
    weights = Weights.load(path)
    camera, prior = weights.camera, weights.load_prior()
    return weights.network, camera.codes(), weights.card, weights.wavelengths, weights.slots, weights.period, prior


def _with_prior(path: Path) -> None:
    _gaussian(path.with_suffix(".nc"))
    _weights(lambda: _spectral(period=3), _built("unrolled", stages=1, **NET), path.with_suffix(".nc").name)(path)


kind("bank.safetensors", _read_bank, _read_bank)
kind("unet-weights.safetensors", _weights(_spectral, _built("unet", **NET)), _read_weights)
kind("unrolled-weights.safetensors", _with_prior, _read_weights)
kind(
    "views-weights.safetensors",
    _weights(_views, _built("spatial-angular", stages=1, width=2, blocks=1, gather=2)),
    _read_weights,
)
kind("depth-weights.safetensors", _weights(_depth, _two_headed), _read_weights)
for _name in ("light-field", "spectral-depth"):
    _file = f"weights-0.1-{_name}.safetensors"
    kind(f"{_name}-weights-0-1.safetensors", _copied("decoders", "files", _file), _read_weights)


# Estimates


def _estimate(make: Callable[[], Any], frames: int = 0) -> Callable[[Path], object]:
    def save(path: Path) -> None:
        camera = make()
        scene, *depth = _scene(camera)
        more = {"depth": depth[0], "confidence": depth[0] / 2} if depth else {"deviation": scene / 10}
        notes = {
            "scene": "random",
            "scene_reading": '{"source": "coffee", "scale": 1, "pattern": null}',
            "metric_psnr": 30.0,
        }
        if frames:
            scene, more = scene[:, None].expand(-1, frames, -1, -1, -1), {}
            notes["motion_pixels"] = [1.0, -2.5]
        Estimate(scene, camera, "lmmse", seconds=0.1, notes=notes, **more).save(path)

    return save


def _evaluate(make: Callable[[], Any]) -> Callable[[Path], Any]:
    def read(path: Path) -> Any:
        camera = make()
        scene, *depth = _scene(camera)
        truth = camera.label(0.9 * scene).assign_attrs(source=f"truth of {path.name}", name=f"truth of {path.name}")
        if depth:
            truth = truth.to_dataset(name="radiance").assign(depth=(("y", "x"), depth[0][0, 0].numpy()))
        return evaluate(path, truth)

    return read


def _large() -> Any:
    return _spectral((12, 13))


def _large_views() -> Any:
    return LightFieldCamera(3, (12, 13), 1)


def _large_depth() -> Any:
    return _depth().replace(size=(12, 13))


for _name, _make in (("spectral", _large), ("views", _large_views), ("depth", _large_depth)):
    kind(f"{_name}-estimate.nc", _estimate(_make), _evaluate(_make))
kind("frames-estimate.nc", _estimate(_large, 3), _evaluate(_large))
