"""Sweeps of the light-field camera: what can be varied, how its scenes are read, one combination on one scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from tmca.applications import simulate
from tmca.cameras import Hardware, LightFieldCamera
from tmca.data.light_field_scenes import NOTHING, Reading, check_asked, read_middle
from tmca.design import KINDS, Task, designable, on_frame
from tmca.errors import SettingError
from tmca.experiments.cells import Measured, Settings
from tmca.experiments.decoder_labels import DecoderLabels, prior_kind
from tmca.experiments.light_field.imaging import reconstruct_light_field
from tmca.experiments.light_field.learned import Learned
from tmca.experiments.light_field.rows import EFFORT, Sizes
from tmca.experiments.sweep import Swept, Values, sweep
from tmca.optics import view_grid
from tmca.sensor import Sensor

_DECODERS = DecoderLabels("light-field", {"lmmse": "patch LMMSE", "mixture": "patch mixture"})
_ATOMS = 1024


def measure(cell: Settings) -> Measured:
    """One combination on one scene."""
    scene = read_middle(cell["path"], cell["views"], Reading(**cell["reading"]), cell["size"])
    camera = _camera(cell, (scene.sizes["y"], scene.sizes["x"]))
    faults = Hardware.of(cell.get("faults", {}))
    snapshot = simulate(scene, camera, seed=cell["camera"].get("seed", 0), hardware=faults)
    prior = cell["prior"].get(cell["decoder"])
    result = reconstruct_light_field(snapshot, cell["decoder"], prior=prior, truth=scene, **cell.get("settings", {}))
    return {"metrics": result.metrics, "seconds": result.seconds, "throughput": camera.throughput()}


def _camera(cell: Settings, size: tuple[int, int]) -> LightFieldCamera:
    """Named codes, or those of a search for this combination's noise and slots."""
    own, sensor = dict(cell["camera"]), Sensor(**cell["sensor"])
    kind, views = own.pop("design", None), (cell["views"], cell["views"])
    if kind is None:
        return LightFieldCamera(views, size, sensor=sensor, **own)
    task = Task.of({**cell, "views": list(views), "seed": own.get("seed", 0)})
    camera: LightFieldCamera = on_frame(task.design(kind, _slots(kind, own)).camera, task.camera, size, sensor)
    return camera


def _slots(kind: str, settings: dict[str, Any]) -> int:
    """Those of a design: static codes have one slot, whatever the others of a sweep have."""
    return 1 if kind == "static" else int(settings.get("slots", 8))


def _check(camera: dict[str, Any], sensor: dict[str, Any]) -> None:
    """Refuses what makes no camera; a design chooses its codes and their period itself."""
    own = dict(camera)
    kind = own.pop("design", None)
    if kind is not None:
        if kind not in KINDS:
            raise SettingError("design", repr(kind), f"one of {', '.join(KINDS)}")
        others = sorted(set(own) - {"slots", "seed"})
        if others:
            raise SettingError("design", f"{kind} with {others[0]}", "slots and seed beside it", "leave it out")
        designable(kind, _slots(kind, own), (8, 8), camera_type=LightFieldCamera, views=3)
    LightFieldCamera(3, (64, 64), sensor=Sensor(**sensor), **own)


LIGHT_FIELD = Swept(
    title="Light-field camera",
    camera=("slots", "aperture", "shutter", "exposure", "shear", "transmittance", "duty", "period", "design"),
    words=("aperture", "shutter", "exposure", "decoder", "design"),
    check=_check,
    decoders=_DECODERS,
    networks=(),
    application="light-field",
    measure=measure,
    train=measure,
)


def sweep_light_field(
    vary: Values,
    scenes: Sequence[str],
    out: Path,
    work: Path,
    *,
    train: Sequence[str] = (),
    views: int = 5,
    size: tuple[int, int] | None = None,
    reading: Reading = NOTHING,
    test_scale: int | None = None,
    **how: Any,
) -> dict[str, Any]:
    """Measure every combination of the varied settings; ``sweep`` says what is not said here.

    Args:
        vary: setting → its values; names of ``LIGHT_FIELD.axes``. ``design`` searches codes of a kind (``free``,
            ``one-hot``, …) for the slots and the noise of every combination, ``static`` for one slot.
        scenes: test light fields, what ``load_light_field`` reads.
        out: the results ``OUT.json``, ``OUT.csv``, ``OUT.md`` and ``OUT.png``.
        work: folder of finished cells.
        train: light fields that priors are learned from and codes designed for; rendered ones without any.
        views: n for the centre n×n views.
        size: (H, W) middle of the test light fields.
        reading: of light fields from files; its ``scale`` of those of ``train``.
        test_scale: the scale of the test light fields.
        how: further arguments of ``sweep``.
    """
    from tmca.data import make_folder, split_rendered_light_fields

    view_grid(views)  # refuses even ones before anything is made
    check_asked(train, scale=reading.scale)
    check_asked(scenes, test_scale=test_scale)
    check_asked([*train, *scenes], pattern=reading.pattern, lens=reading.lens)
    learned = Learned(list(train) or sorted(split_rendered_light_fields()["train"]), work, views, reading)

    def prepare(points: Sequence[dict[str, Any]]) -> Settings:
        make_folder(work)
        decoders = {point["decoder"] for point in points}
        made = {"gaussian": learned.prior, "mixture": learned.mixture, "dictionary": lambda: learned.dictionary(_ATOMS)}
        kinds = {name: prior_kind(name) for name in sorted(decoders)}
        found: Settings = {"prior": {name: made[kind]() for name, kind in kinds.items() if kind is not None}}
        if any("design" in point for point in points):
            found |= {"examples": learned.examples(), "designs": str(make_folder(work / "designs"))}
            found |= {"period": 2 * [Sizes().period], "effort": EFFORT, "exposures": 1}
        return found

    data: Settings = {"views": views, "size": size, "reading": vars(replace(reading, scale=test_scale))}
    return sweep(LIGHT_FIELD, vary, scenes, out, work, data, prepare=prepare, train=learned.names, **how)
