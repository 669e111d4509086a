"""The light-field camera in studies and sweeps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import BaseModel, ConfigDict

from tmca.applications.light_field import AGREEMENT
from tmca.applications.report import Section
from tmca.cameras import LightFieldCamera
from tmca.data import read_dataset, split_rendered_light_fields
from tmca.data.fitting import middle_of
from tmca.data.light_field_scenes import RENDERED, Reading, check_asked, read_middle, true_disparity
from tmca.data.scene_names import identity_of
from tmca.design import KINDS, designable
from tmca.errors import SettingError
from tmca.evaluation.camera import CameraEvaluation, Lists, Place, Settings
from tmca.evaluation.cells import Check, Measurement
from tmca.evaluation.grid import Measured
from tmca.evaluation.scenes import read_once
from tmca.evaluation.tables import Column, Row, grouped
from tmca.optics import view_grid
from tmca.plots.light_field import centre_view, disparity_figure, light_field_figure, view_psnr_figure
from tmca.plots.views import brightest
from tmca.sensor import Sensor

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from tmca.evaluation.study import Study

FILES = ("scale", "pattern", "lens")
"""What is asked of light fields from files."""
SPREAD, _FLAT = "disparity_spread", 0.25
"""Name of how much a disparity varies, and the part of that of the true views below which it is flat."""


class StudyLightFieldReading(BaseModel):
    """How light fields are read.

    Args:
        views: n of the centre n×n views.
        scale, pattern, lens: of files, see `tmca.data.light_field_scenes.Reading`.
        test_scale: ``scale`` of those that are measured.
        frame: (H, W) middle of the light fields from files that are measured.
        rendered: (H, W) of the rendered ones.
        crop: (H, W) middle of the frame, for decoders with a dictionary.
    """

    model_config = ConfigDict(extra="forbid")
    views: int = 5
    scale: int | None = None
    pattern: str | None = None
    lens: tuple[int, int] | None = None
    test_scale: int | None = None
    frame: tuple[int, int] = (270, 480)
    rendered: tuple[int, int] = RENDERED
    crop: tuple[int, int] = (96, 96)


class LightFieldEvaluation(CameraEvaluation):
    """Light fields; the reading of a cell has ``size``, the middle of what is measured, and ``crop``, of that again."""

    kind, Reading = "light-field", StudyLightFieldReading
    swept = ("slots", "aperture", "shutter", "exposure", "shear", "transmittance", "duty", "period", "design")
    words = ("aperture", "shutter", "exposure", "design")
    labels: ClassVar = {"lmmse": "patch LMMSE", "mixture": "patch mixture"}
    pictures: ClassVar = {
        "views": "Views and epipolar pictures, with errors",
        "psnr": "PSNR of every view",
        "disparity": "Disparity that one estimator sees in the reconstructed views",
    }
    beside: ClassVar = (
        ("disparity_mae_of_constant", "disparity MAE of a constant (px)", ".3f"),
        (f"{AGREEMENT}_mae_of_constant", "mean difference of a constant (px)", ".3f"),
        (SPREAD, "disparity varies by (px, 5 to 95 %)", ".3f"),
    )

    @property
    def columns(self) -> Sequence[Column]:
        """See ``CameraEvaluation``: also of the disparity (px per view step) that one fixed estimator sees in
        reconstructed views: against the truth, and the mean difference from what it sees in the true views."""
        return (
            *self.application.columns,
            ("disparity_mae", "disparity MAE (px)", ".3f"),
            ("disparity_badpix", "BadPix 0.07", ".1%"),
            (f"{AGREEMENT}_mae", "disparity: mean difference from that of the true views (px)", ".3f"),
        )

    def warnings(self, rows: Iterable[Row]) -> list[str]:
        """See ``CameraEvaluation``: rows whose disparity hardly varies, which may still be near that of the scene."""
        flat = [row for row in rows if row.get(SPREAD, 1.0) < _FLAT * row.get(f"{SPREAD}_of_true", 0.0)]
        named = ", ".join(dict.fromkeys(f"{row['code']} + {row.get('label', row['decoder'])}" for row in flat))
        said = f"Flat disparity: {named}. It varies by less than a quarter of what the true views show; compare its "
        return [f"{said}difference with that of a constant guess, the median."] if flat else []

    def load(self, source: str, reading: Settings, measured: bool = False) -> xr.DataArray:
        size, crop = (reading.get(name) if measured else None for name in ("size", "crop"))
        scene = read_once(read_middle, source, reading["views"], _asked(reading, measured), size)
        return scene if crop is None else middle_of(scene, (crop[0], crop[1]), source)

    def check_scenes(self, learned: Sequence[str], measured: Sequence[str], reading: Settings) -> None:
        view_grid(reading["views"])  # refuses even ones
        check_asked(learned, scale=reading.get("scale"))
        check_asked(measured, test_scale=reading.get("test_scale"))
        check_asked([*learned, *measured], pattern=reading.get("pattern"), lens=_asked(reading).lens)
        super().check_scenes(learned, measured, reading)

    def rendered(self) -> Mapping[str, Sequence[str]]:
        return split_rendered_light_fields()

    def usual_train(self) -> list[str]:
        return sorted(self.rendered()["train"])

    def always_measured(self) -> list[str]:
        """See ``CameraEvaluation``: rendered light fields, whose geometry is known."""
        return sorted(self.rendered()["test"])

    def check_study(self, study: Study, train: Sequence[str], test: Sequence[str]) -> None:
        self.check_scenes(train, test, {**study.reading, "size": study.reading["frame"]})

    def places(self, study: Study, names: Mapping[str, str], files: Sequence[str]) -> list[Place]:
        """See ``CameraEvaluation``: every scene, and a crop of those from files, where the dictionary can follow."""
        reading, whole = study.reading, []
        for source, name in names.items():
            size = reading["frame"] if source in files else reading["rendered"]
            how = {**reading, "crop": None, "size": size}
            whole.append(Place(name, name, source, identity_of(source), how, {"geometry": True}))
        crops = [
            replace(place, name=f"{place.name} crop", shown=False, part=True, about={},
                    reading={**place.reading, "crop": reading["crop"]})
            for place in whole if place.source in files
        ]  # fmt: skip
        return [*whole, *crops]

    def searching(self, reading: Settings) -> Settings:
        return {"views": [reading["views"]] * 2}

    def training_camera(self, study: Study) -> Settings:
        """See ``CameraEvaluation``: whole tiles of codes, at least as large as a patch."""
        patch, period = study.train.settings["data"]["patch"], study.tile()
        return {"views": study.reading["views"], "size": [-(-patch // side) * side for side in period]}

    def training_reading(self, reading: Settings) -> Settings:
        return {name: reading[name] for name in FILES if reading.get(name) is not None}

    def measured(self, cell: Measurement, shown: xr.Dataset, truth: xr.DataArray) -> Settings:
        """See ``CameraEvaluation``: also the disparity that whole estimates show, and the quality of every view."""
        from tmca.metrics import disparity_error, estimate_disparity, psnr_per_view, ssim_per_view

        values = shown["estimate"].values
        found = super().measured(cell, shown, truth)
        if not cell.about.get("geometry"):
            return found
        known, seen = self.disparity(cell.source, cell.reading), estimate_disparity(values)
        errors = {name: disparity_error(seen, known[maps].values) for name, maps in _ERRORS.items() if maps in known}
        for name, error in errors.items():
            found["metrics"] |= {f"{name}_{key}": error[key] for key in ("mae", "badpix", "mae_of_constant")}
        found["metrics"] |= {SPREAD: _spread(seen), f"{SPREAD}_of_true": _spread(known["seen"].values)}
        views = {"psnr_per_view": psnr_per_view, "ssim_per_view": ssim_per_view}
        return found | {name: metric(values, truth.values).tolist() for name, metric in views.items()}

    def disparity(self, source: str, reading: Settings) -> xr.Dataset:
        """``seen`` (y, x), the disparity that the fixed estimator sees in the true views, and ``truth``, if known."""
        how = {name: reading.get(name) for name in ("views", "size", "test_scale", "pattern", "lens")}
        known: xr.Dataset = read_once(_disparities, source, **how)
        return known

    def checks(self, study: Study, cells: Sequence[Measurement], lists: Lists) -> list[Check]:
        """See ``CameraEvaluation``: what the estimator errs by on the true views."""
        return [
            Check(name=f"{place.scene} · disparity of the true views", camera=self.kind, method="geometry",
                  arguments={"source": place.source, "scene": place.scene, "identity": place.identity,
                             "reading": place.reading})
            for place in lists.places if not place.part
        ]  # fmt: skip

    def geometry(self, cell: Check, folder: Path) -> Settings:
        """The error of the disparity that is seen in the true views of a scene; nothing where it is not known."""
        from tmca.metrics import disparity_error

        known = self.disparity(cell.arguments["source"], cell.arguments["reading"])
        error = disparity_error(known["seen"].values, known["truth"].values) if "truth" in known else {}
        return {"scene": cell.arguments["scene"], "error": {f"disparity_{key}": error[key] for key in error}}

    def row(self, cells: Sequence[Measured]) -> Row:
        """See ``CameraEvaluation``: PSNR and SSIM of every view (V, U), means over seeds."""
        scenes = grouped([cell for cell in cells if "psnr_per_view" in cell], "scene").items()
        return {"views": {
            scene: {n: np.mean([cell[f"{n}_per_view"] for cell in own], 0).tolist() for n in ("psnr", "ssim")}
            for (scene,), own in scenes
        }}  # fmt: skip

    def conclusions(self, study: Study, measured: Sequence[Measured], rows: Sequence[Row]) -> Row:
        return {"geometry": {cell["scene"]: cell["error"] for cell in measured if "error" in cell}}

    def sections(self, found: Row, study: Study) -> Iterable[Section]:
        rows = [{"scene": scene, **error} for scene, error in found["geometry"].items() if error]
        text = "What the estimator errs by on the true views, where the geometry is known."
        if rows:
            yield Section("Disparity of the true views", [text], rows, [("scene", "scene", ""), *self.columns[-3:-1]])

    def scene_figures(self, study: Study, cells: Sequence[Measured]) -> dict[str, Figure]:
        from tmca.metrics import estimate_disparity

        source, reading, own = cells[0]["source"], cells[0]["reading"], self.estimates(study, cells)
        truth, known = self.load(source, reading, measured=True).values, self.disparity(source, reading)
        fields = {name: read_dataset(cell["estimate"], ("estimate",))["estimate"].values for name, cell in own.items()}
        seen = {"estimator on true views": known["seen"].values}
        seen |= {name: estimate_disparity(field) for name, field in fields.items()}
        real, view = known["truth"].values if "truth" in known else None, centre_view(truth, brightest(truth))
        return {
            "views": light_field_figure(fields, truth),
            "psnr": view_psnr_figure({name: np.asarray(cell["psnr_per_view"]) for name, cell in own.items()}),
            "disparity": disparity_figure(seen, real, view=view),
        }

    def check_point(self, camera: Settings, sensor: Settings) -> None:
        """See ``CameraEvaluation``: a design chooses its codes and their period itself."""
        own = dict(camera)
        kind = own.pop("design", None)
        if kind is not None:
            if kind not in KINDS:
                raise SettingError("design", repr(kind), f"one of {', '.join(KINDS)}")
            others = sorted(set(own) - {"slots", "seed"})
            if others:
                raise SettingError("design", f"{kind} with {others[0]}", "slots and seed beside it", "leave it out")
            slots = 1 if kind == "static" else int(own.get("slots", 8))
            designable(kind, slots, (8, 8), camera_type=LightFieldCamera, views=3)
        LightFieldCamera(3, (64, 64), sensor=Sensor(**sensor), **own)

    def prior_settings(self, prior_kind: str, settings: Settings, reading: Settings) -> Settings:
        return {"atoms": 1024} if prior_kind == "dictionary" else {}


_ERRORS = {AGREEMENT: "seen", "disparity": "truth"}
"""Names of errors of a disparity, and the map that they are counted from."""


def _spread(disparity: np.ndarray) -> float:
    """Px per view step from 5 to 95 % of the pixels."""
    low, high = np.quantile(disparity, (0.05, 0.95))
    return float(high - low)


def _asked(reading: Settings, measured: bool = False) -> Reading:
    """What is asked of files that are learned from, or measured."""
    asked: dict[str, Any] = {name: reading.get(name) for name in FILES}
    return Reading(**(asked | ({"scale": reading.get("test_scale")} if measured else {})))


def _disparities(source: str, **reading: Any) -> xr.Dataset:
    """See ``LightFieldEvaluation.disparity``."""
    import xarray as xr

    from tmca.metrics import estimate_disparity

    asked = _asked(reading, measured=True)
    scene, own = read_middle(source, reading["views"], asked, reading["size"]), asked.of(source)
    maps = {"seen": (("y", "x"), estimate_disparity(scene.values).astype(np.float32))}
    truth = true_disparity(source, scene, own.get("scale"), own.get("pattern"))
    maps |= {} if truth is None else {"truth": (("y", "x"), truth.values.astype(np.float32))}
    return xr.Dataset(maps)
