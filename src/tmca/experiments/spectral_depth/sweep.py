"""Sweeps of the spectral-depth camera: what can be varied, how its scenes are read, one combination on one scene."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tmca.cameras import Hardware, SpectralDepthCamera
from tmca.cameras.phase_codes import read_phase_codes
from tmca.cameras.spectral_depth import PROBE
from tmca.data.depth_scenes import check_depth_scenes, load_any_depth_scene, with_surroundings
from tmca.data.scene_names import identity_of
from tmca.decoders.likelihood import check_window, usual_window
from tmca.errors import SettingError
from tmca.experiments.cells import Measured, Settings
from tmca.experiments.decoder_labels import DecoderLabels, prior_kind
from tmca.experiments.spectral_depth.imaging import (
    middle_of_reconstruction,
    reading_range,
    reconstruct_spectral_depth,
    take_spectral_depth_snapshot,
)
from tmca.experiments.spectral_depth.priors import learned_depth_prior
from tmca.experiments.sweep import Swept, Values, parts, sweep
from tmca.sensor import Sensor

if TYPE_CHECKING:
    import xarray as xr

_CODES = ("slots", "shutter", "filters", "channels", "mask", "rms", "modes", "period", "exposure", "seed")
"""Settings that a file of codes says."""


def measure(cell: Settings) -> Measured:
    """One combination on one scene."""
    size = (int(cell["size"][0]), int(cell["size"][1]))
    probe = _camera(cell["preset"], cell["camera"], cell["sensor"], size)
    how = {**{name: cell[name] for name in ("side", "placed", "from_rgb")}, "materials": "test"}
    scene = load_any_depth_scene(cell["path"], **how, **reading_range(probe))
    scene = with_surroundings(scene, size, cell["path"], probe.tile_size)
    scene = of_contrast(scene, float(cell["camera"].get("contrast", 1.0)))
    camera = _camera(cell["preset"], cell["camera"], cell["sensor"], (scene.sizes["y"], scene.sizes["x"]))
    faults, seed = Hardware.of(cell.get("faults", {})), int(cell["camera"].get("seed", 0))
    snapshot = take_spectral_depth_snapshot(scene, camera, seed, hardware=faults)
    window = {"window": cell["window"]} if cell["decoder"] == "likelihood" else {}
    prior = cell["prior"] if prior_kind(cell["decoder"]) else None
    whole = reconstruct_spectral_depth(snapshot, cell["decoder"], prior=prior, **{**window, **cell.get("settings", {})})
    found = middle_of_reconstruction(whole, size, scene, camera.planes)
    return {"metrics": found.metrics, "seconds": found.seconds, "throughput": camera.throughput()}


def of_contrast(scene: xr.Dataset, contrast: float) -> xr.Dataset:
    """A scene whose texture is squeezed towards the mean of every band: 1 as it is, 0 uniform; depth stays."""
    cube = scene["radiance"]
    mean = cube.mean(("y", "x"))
    return scene.assign(radiance=(mean + contrast * (cube - mean)).transpose(*cube.dims))


def _camera(
    preset: str, settings: dict[str, Any], sensor: dict[str, Any], size: tuple[int, int]
) -> SpectralDepthCamera:
    own = {name: value for name, value in settings.items() if name not in ("contrast", "codes")}
    if "codes" in settings:
        own = {**read_phase_codes(settings["codes"]), **own}
    return SpectralDepthCamera.from_preset(preset, size=size, sensor=Sensor(**sensor), **own)


def _check(preset: str, camera: dict[str, Any], sensor: dict[str, Any]) -> None:
    """Refuses what makes no camera, or settings beside a file that says them."""
    if not 0 <= float(camera.get("contrast", 1.0)) <= 1:
        raise SettingError("contrast", str(camera["contrast"]), "from 0 (uniform) to 1 (as the scene is)")
    beside = [name for name in _CODES[:-1] if name in camera and "codes" in camera]
    if beside:
        raise SettingError("--set codes", f"a file beside {beside[0]}", "one of them: the file says it", "leave it out")
    _camera(preset, camera, sensor, PROBE)


def _window(camera: SpectralDepthCamera, size: tuple[int, int], window: int | None) -> int:
    """Side of a camera's windows in pixels.

    Raises:
        SettingError: one that does not hold a tile of the codes, or a tile larger than the crop (H, W).
    """
    if camera.tile_size > min(size):
        found, known = f"{size[0]}×{size[1]} pixels", f"at least the {camera.tile_size} of the tile of the codes"
        raise SettingError("--crop", found, known, "take a larger crop, or a smaller period")
    side = usual_window(camera) if window is None else window
    check_window(side, camera)
    return side


def spectral_depth_swept(preset: str) -> Swept:
    """What a sweep asks of the camera of a preset."""

    def check(camera: dict[str, Any], sensor: dict[str, Any]) -> None:
        _check(preset, camera, sensor)

    return Swept(
        title="Spectral-depth camera",
        camera=("slots", "mask", "rms", "modes", "shutter", "filters", "channels", "planes", "exposure",
                "image_formation", "period", "contrast", "codes"),
        words=("mask", "shutter", "filters", "channels", "exposure", "image_formation", "decoder", "codes"),
        check=check,
        decoders=DecoderLabels("spectral-depth", {}),
        networks=(),
        application="spectral-depth",
        measure=measure,
        train=measure,
    )  # fmt: skip


def sweep_spectral_depth(
    vary: Values,
    scenes: Sequence[str],
    out: Path,
    work: Path,
    *,
    train: Sequence[str] = (),
    preset: str = "quick",
    size: tuple[int, int] | None = None,
    side: int = 256,
    placed: str | None = None,
    from_rgb: bool = False,
    window: int | None = None,
    **how: Any,
) -> dict[str, Any]:
    """Measure every combination of the varied settings; ``sweep`` says what is not said here.

    Args:
        vary: setting → its values; names of ``axes``. ``contrast`` squeezes the texture of the scenes, ``codes`` are
            files of `tmca design spectral-depth`.
        scenes: test scenes, what ``load_any_depth_scene`` reads.
        out: the results ``OUT.json``, ``OUT.csv``, ``OUT.md`` and ``OUT.png``.
        work: folder of finished cells.
        train: scenes that the prior is learned from; the rendered ones' prior without any.
        preset: of the camera.
        size: (H, W) middle of the test scenes; 96×128 if None.
        side: scenes from files are averaged down while their shorter side keeps at least this many pixels.
        placed: how cubes without depth are put at drawn depths.
        from_rgb: make up spectra for RGB-D scenes.
        window: of the patch likelihood, pixels; the usual one of every camera if None.
        how: further arguments of ``sweep``.
    """
    reading: Settings = {"side": side, "placed": placed, "from_rgb": from_rgb}
    swept, size = spectral_depth_swept(preset), size or (96, 128)

    def check() -> None:
        probe = SpectralDepthCamera.from_preset(preset, size=PROBE)
        check_depth_scenes(train, scenes, size, **reading, **reading_range(probe))

    def prepare(points: Sequence[dict[str, Any]]) -> Settings:
        files = {str(point["codes"]) for point in points if "codes" in point}
        largest = max(_window(_camera(preset, *parts(swept, point), PROBE), size, window) for point in points)
        return {"prior": learned_depth_prior(train, work, preset, largest, reading) if train else None,
                "code_files": [identity_of(name) for name in sorted(files)]}  # fmt: skip

    data: Settings = {**reading, "preset": preset, "size": list(size), "window": window}
    return sweep(swept, vary, scenes, out, work, data, check=check, prepare=prepare, train=train,
                 **{"decoder": "likelihood", **how})  # fmt: skip
