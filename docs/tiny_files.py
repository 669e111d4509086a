"""A small file of every kind that tmca writes: the page of file formats is made from these."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any
from warnings import catch_warnings, simplefilter

import numpy as np
import torch

import tmca
from tmca.cameras import LightFieldCamera, Snapshot, SpectralCamera, SpectralDepthCamera
from tmca.cameras.phase_codes import write_phase_codes
from tmca.codes.files import write_codes
from tmca.data import (
    label,
    label_depth,
    label_spectral_depth,
    rendered_light_field,
    rendered_scene,
    write_dataset,
    write_tiff,
)
from tmca.dbd import Units, simulate, solve
from tmca.dbd.files import save_problem, save_recovery
from tmca.decoders import Weights, build_network
from tmca.evaluation import own_study, run_study
from tmca.lab.acquisition.drivers import find_device
from tmca.lab.acquisition.session import capture
from tmca.lab.calibration.buckets import BucketMixing
from tmca.lab.calibration.displacement import MeasuredDispersion, MeasuredShear
from tmca.lab.calibration.file import Calibration
from tmca.lab.calibration.psf import PsfStack, ZernikeFit
from tmca.lab.calibration.registration import Registration
from tmca.lab.calibration.sensor import DarkField, FlatField, Linearity
from tmca.lab.calibration.timing import Timing
from tmca.lab.deploy import export_decoder
from tmca.lab.display.codes import planes_of
from tmca.lab.display.devices import device_named
from tmca.lab.display.export import export_codes
from tmca.optics import PhaseMaskBench
from tmca.priors import GaussianMixturePrior, GaussianPrior, PatchDictionary
from tmca.sensor import Sensor

BANDS = (450e-9, 550e-9, 650e-9)
SIZE = (16, 20)


def write_tiny_files(folder: Path) -> None:
    """Write them all into a folder, in a few seconds."""
    torch.manual_seed(0)
    with catch_warnings():
        simplefilter("ignore")  # masks of a few pixels are no good ones
        for write in WRITERS:
            write(folder)


def _scenes(folder: Path) -> None:
    """As `tmca render` writes them."""
    write_dataset(rendered_scene("coffee", size=SIZE), folder / "scene.nc")
    write_dataset(_views(), folder / "views.nc")


def _views() -> Any:
    return rendered_light_field("coffee", views=3, size=SIZE)


def _sensor() -> Sensor:
    return Sensor(full_well=10_000, read_noise_electrons=3, bits=12)


def _pictures(folder: Path) -> None:
    """Of the spectral camera, and a cube for ImageJ."""
    cube = label(_cube().numpy(), np.array(BANDS))
    some = cube.assign_attrs(source_bands=31)  # as tmca.read takes some of a scene's bands
    snapshot = tmca.simulate(some, _camera(), progress=False)
    _written(folder, "spectral", snapshot, "lmmse", _gaussian(), uncertainty=True)
    write_tiff(cube, folder / "cube.tif")


def _camera() -> SpectralCamera:
    return SpectralCamera(BANDS, SIZE, 2, shutter="one-hot", sensor=_sensor())


def _light_field(folder: Path) -> None:
    """Of the light-field camera, and what `tmca refocus` writes."""
    camera, views = LightFieldCamera(3, SIZE, 2, sensor=_sensor()), _views()["light_field"]
    _written(folder, "light-field", tmca.simulate(views, camera), "tikhonov")
    write_dataset(tmca.refocus(views, [-1.0, 1.0]), folder / "refocused.nc")


def _written(folder: Path, name: str, snapshot: Snapshot[Any], decoder: str, prior: Any = None, **how: Any) -> None:
    snapshot.save(folder / f"{name}.nc")
    tmca.reconstruct(snapshot, decoder, prior=prior, **how).save(folder / f"{name}_estimate.nc")


def _mirror(**parts: Any) -> SpectralDepthCamera:
    bench = PhaseMaskBench(diameter=0.5e-3, window=(3, 3), mask_pixels=8)
    return SpectralDepthCamera(BANDS, SIZE, 2, planes=3, bench=bench, filters="gaussian", period=2, modes=3, **parts)


def _depth(folder: Path) -> None:
    camera = _mirror(sensor=_sensor())
    window = GaussianPrior.learn([_cube()], (16, 16), wavelengths=BANDS)
    depth = label_depth(np.full(SIZE, 0.8, np.float32), "scene")
    scene = label_spectral_depth(label(_cube().numpy(), np.array(BANDS)), depth)
    _written(folder, "spectral-depth", tmca.simulate(scene, camera), "likelihood", window)


def _codes(folder: Path) -> None:
    """As `tmca design` writes them."""
    codes = SpectralCamera(BANDS, SIZE, 2, period=4, shutter="one-hot").codes
    write_codes(folder / "codes.nc", codes.aperture.tile(), codes.shutter.tile(), (4, 4))
    write_phase_codes(_mirror(), folder / "masks.nc", "gaussian", "monochrome")


def _cube(channels: int = 3) -> torch.Tensor:
    return torch.rand(channels, 16, 20, generator=torch.Generator().manual_seed(0))


def _gaussian() -> GaussianPrior:
    return GaussianPrior.learn([_cube()], (4, 8), wavelengths=BANDS, sources=["a", "b"])


def _priors(folder: Path) -> None:
    _gaussian().save(folder / "gaussian.nc")
    small = {"kinds": 2, "rank": 3, "gains": 2, "samples": 60}
    mixture = GaussianMixturePrior.learn([_cube(9)], (2, 2), views=(3, 3), **small)
    mixture.save(folder / "mixture.nc")
    mixture.component(0).save(folder / "component.nc")
    atoms = PatchDictionary.learn([_cube(9)], (2, 3), views=(3, 3), atoms=4, coreset=30, rank=4, batch=10)
    atoms.save(folder / "dictionary.nc")


def _weights(folder: Path) -> None:
    camera = SpectralCamera(BANDS, SIZE, 2, period=4)
    network = build_network("unet", bands=3, start="dagger", widths=(2, 3), blocks=1, gather=2)
    Weights.of(network, camera, "", {"steps": 100, "best": {"psnr": 30.0}}).save(folder / "weights.safetensors")


def _calibration(folder: Path) -> None:
    """With every part that there is."""
    calibration = Calibration.empty("my-bench")
    for name, part in _parts().items():
        calibration = calibration.with_part(name, part, {"residual": 0.01}, settings={"order": 2})
    saved = calibration.save(folder / "bench").path
    assert saved is not None
    saved.rename(folder / "calibration.nc")


def _parts() -> dict[str, Any]:
    def some(*shape: int) -> np.ndarray:
        return np.linspace(0.1, 1.0, int(np.prod(shape))).reshape(shape)

    none = np.zeros(SIZE, np.uint8)
    return {
        "dark": DarkField(some(*SIZE), some(*SIZE), none, 8),
        "flat": FlatField(some(*SIZE), 900.0, 0.01, 1e-4, none, 8),
        "linearity": Linearity(some(4), some(4), some(4), 3.0, 1.0, some(4), 4000.0, 2.5, 0.1, 9.0),
        "registration": Registration(some(2, 3), some(2, 3), 0.3, 0.02, SIZE, SIZE, 550e-9, 0.004, 1e-4),
        "timing": Timing(0.1, 0.98, some(2), 100.0, 0.01, 4, False, 0.02, 1e-3),
        "buckets": BucketMixing(some(3, 2), some(3, 2), 0.02, 0.05, some(2), 1e-4),
        "dispersion": MeasuredDispersion(
            some(3), some(3, 2), some(3, 2), "cauchy", some(2, 2), some(2), some(3), some(3)
        ),
        "shear": MeasuredShear(some(4, 2), some(4, 2), some(2), some(2), some(2), 0.1, some(4)),
        "psf0": PsfStack(some(2, 3, 5, 5), some(2), some(3), some(2, 2), some(2, 3)),
        "wavefront0": ZernikeFit(((2, 0), (2, 2)), some(2), some(2), some(2, 2), 0.02, 1),
    }


def _bench(folder: Path) -> None:
    """An export and a capture of it."""
    shown = [device_named("dli4120", size=(24, 32)), device_named("emulated-shutter")]
    camera = _camera()
    export_codes(planes_of(camera, "spectral.nc"), shown, folder / "export")
    bench = find_device("simulated", camera=camera, scene=[torch.full((1, *camera.scene_shape), 0.5)])
    capture(folder / "export", bench, folder / "capture", gain=bench.gain)


def _dbd(folder: Path) -> None:
    """A problem with units, and its recovery."""
    problem = replace(simulate(M=9, P=5, J=2, targets=2, paths=1, seed=2, snr_db=30), units=Units(1e-6, 2e4, 1e9))
    save_problem(problem, folder / "problem.nc")
    save_recovery(solve(problem, progress=False), folder / "recovery.nc")


def write_study(folder: Path) -> None:
    """A study of the cube of `write_tiny_files`, without pictures for a paper."""
    described = own_study([str(folder / "cube.tif")], codes=["cassi"], decoders=["dagger"], crop=SIZE)
    plain = described.model_copy(update={"figure": False, "name": "study"})
    run_study(plain, folder / "study", folder / "study" / "cells", progress=False)


def write_decoder(folder: Path) -> None:
    """The weights of `write_tiny_files` as a program of their own."""
    export_decoder(folder / "weights.safetensors", folder / "decoder", ("torch",))


WRITERS = (_scenes, _pictures, _light_field, _depth, _codes, _priors, _weights, _calibration, _bench, _dbd)
"""All but a study and a program, which take longer."""
