"""`tmca.train`: the engines of all cameras under one call."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tmca.errors import SettingError

if TYPE_CHECKING:
    from tmca.training import Trained

KINDS = ("spectral", "light-field", "spectral-depth")


def train(
    camera: str = "spectral",
    *,
    out: str | Path,
    scenes: Sequence[str] | None = None,
    validation: Sequence[str] | None = None,
    preset: str | None = None,
    config: str | Path | None = None,
    settings: Mapping[str, Any] | None = None,
    progress: Callable[[int, int, str], None] | None = None,
    **how: Any,
) -> Trained:
    """Train a camera's codes and its decoder together; the same call goes on with a run that was stopped.

    Args:
        camera: kind of the camera.
        out: folder of the run: ``weights.safetensors``, ``log.csv``, checkpoints.
        scenes: to learn from, files, rendered scenes, or split files; those of the preset if None.
        validation: the same, for choosing the best step.
        preset: ``"quick"`` or ``"thesis"``.
        config: YAML of settings, which replace the preset's.
        settings: dotted names and values, such as ``{"camera.slots": 4}``, which replace both.
        progress: called after every step with (done, all, text).
        how: ``accelerator``, ``processes`` and ``nodes`` of `tmca.training.run.train`.

    Raises:
        SettingError, DataError, OutputError: impossible settings or scenes, or the folder of another run.
    """
    named = {"data.train": scenes, "data.validation": validation}
    changes = {**(settings or {}), **{name: list(value) for name, value in named.items() if value is not None}}
    prepared, engine, load = _of(_TRAININGS, camera)(preset, config, changes)
    trained: Trained = engine(prepared, Path(out), load, progress=progress, **how)
    return trained


def training_of(
    camera: str, preset: str | None, config: str | Path | None, changes: Mapping[str, Any]
) -> tuple[Any, Callable[..., Trained], Callable[[str], Any]]:
    """Settings, engine and reader of scenes of a camera's training."""
    return _of(_TRAININGS, camera)(preset, config, changes)


def _spectral(preset: str | None, config: str | Path | None, changes: Mapping[str, Any]) -> Any:
    from tmca.data.scenes import load_scene
    from tmca.training import settings_from, train_spectral

    settings = settings_from(preset, config, changes)
    return settings, train_spectral, lambda name: load_scene(name, bands=settings.data.bands)


def _light_field(preset: str | None, config: str | Path | None, changes: Mapping[str, Any]) -> Any:
    from tmca.training import light_field_settings, train_light_field
    from tmca.training.light_field import training_loader

    settings = light_field_settings(preset, config, changes)
    return settings, train_light_field, training_loader(settings)


def _spectral_depth(preset: str | None, config: str | Path | None, changes: Mapping[str, Any]) -> Any:
    from tmca.data.depth_scenes import load_any_depth_scene
    from tmca.experiments.spectral_depth.imaging import reading_range
    from tmca.training import spectral_depth_settings, train_spectral_depth
    from tmca.training.spectral_depth.camera import training_camera

    settings = spectral_depth_settings(preset, config, changes)
    how = {name: getattr(settings.data, name) for name in ("side", "placed", "from_rgb")}
    how |= reading_range(training_camera(settings))
    return settings, train_spectral_depth, lambda name: load_any_depth_scene(name, **how)


_TRAININGS = dict(zip(KINDS, (_spectral, _light_field, _spectral_depth), strict=True))


def _of(engines: Mapping[str, Callable[..., Any]], camera: str) -> Callable[..., Any]:
    if camera not in engines:
        raise SettingError("camera", repr(camera), f"one of {', '.join(engines)}")
    return engines[camera]
