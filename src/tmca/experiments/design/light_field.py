"""Codes of a light-field camera for a sensor: the light fields that they are designed for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tmca.cameras import LightFieldCamera
from tmca.data.light_field_scenes import NOTHING, Reading, check_asked, read_middle
from tmca.design import Advice, SensorSheet, design_model, designable, learn_examples
from tmca.errors import SettingError
from tmca.experiments.design.checks import named_once
from tmca.experiments.design.codes import Learned, Told, design_codes
from tmca.optics import view_grid
from tmca.priors import views_of


def design_light_field(
    sheet: SensorSheet,
    out: Path,
    *,
    scenes: Sequence[str] = (),
    views: int = 5,
    reading: Reading = NOTHING,
    camera: Mapping[str, Any] | None = None,
    **how: Any,
) -> tuple[Advice, dict[str, Any]]:
    """Search codes for a sensor and write them to a folder; ``design_codes`` says what is not said here.

    Args:
        sheet: sensor and modulator.
        out: folder of the results.
        scenes: to design for, what ``load_light_field`` reads; the rendered training light fields without any.
        views: n for the centre n×n views.
        reading: of light fields from files.
        camera: further arguments of ``LightFieldCamera``.
        how: further arguments of ``design_codes``.

    Raises:
        SettingError: a scale below 1; what ``design_codes`` refuses.
    """
    from tmca.data import split_rendered_light_fields

    named_once(scenes)
    if reading.scale is not None and reading.scale < 1:
        raise SettingError("--scale", str(reading.scale), "1 or more pixels that are averaged into one")
    check_asked(scenes, **vars(reading))
    names = list(scenes) or sorted(split_rendered_light_fields()["train"])
    own = {"camera_type": LightFieldCamera, "views": view_grid(views), **(camera or {})}

    def learn(told: Told) -> Learned:
        fields = _light_fields(names, views, reading, told)
        told(0.2, "learning what the light fields have in common")
        one = designable("static", 1, (8, 8), **own)
        return Learned(learn_examples(fields, design_model(one.taps()), None, views=own["views"]), own)

    return design_codes(sheet, out, learn, own, len(names), **how)


def _light_fields(names: Sequence[str], views: int, reading: Reading, told: Told) -> dict[str, Any]:
    """(V·U, H, W) of every light field in grey, by name."""
    found: dict[str, Any] = {}
    for place, name in enumerate(names):
        told(0.2 * place / len(names), f"reading {name}")
        field = read_middle(name, views, reading)
        found[Path(name).stem if Path(name).stem not in found else name] = views_of(field)[0].flatten(0, 1)
    return found
