"""The light-field camera in studies and sweeps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import BaseModel, ConfigDict

from tmca.cameras import LightFieldCamera
from tmca.data import split_rendered_light_fields
from tmca.data.fitting import centre_window
from tmca.data.formats.stored import whole_file
from tmca.data.light_field_scenes import RENDERED, Reading, check_asked, check_light_fields, read_middle, true_disparity
from tmca.data.scene_names import identity_of
from tmca.design import KINDS, designable
from tmca.errors import SettingError
from tmca.evaluation.camera import CameraEvaluation, Place, Settings
from tmca.evaluation.cells import Check
from tmca.evaluation.scenes import read_once
from tmca.optics import view_grid
from tmca.sensor import Sensor

if TYPE_CHECKING:
    import xarray as xr

    from tmca.evaluation.study import Code, Study, TrainStage


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


def asked_of_files(reading: Settings) -> Reading:
    """What is asked of files."""
    return Reading(**{name: reading.get(name) for name in ("scale", "pattern", "lens")})


class LightFieldEvaluation(CameraEvaluation):
    """Light fields; the reading of a cell has ``size``, the middle of what is measured, and ``crop``, of that again."""

    kind, Reading = "light-field", StudyLightFieldReading
    swept = ("slots", "aperture", "shutter", "exposure", "shear", "transmittance", "duty", "period", "design")
    words = ("aperture", "shutter", "exposure", "design")
    labels: ClassVar = {"lmmse": "patch LMMSE", "mixture": "patch mixture"}

    def load(self, source: str, reading: Settings) -> xr.DataArray:
        """See ``CameraEvaluation``."""
        return read_once(read_middle, source, reading["views"], asked_of_files(reading), reading.get("size"))

    def scene(self, cell: Any) -> xr.DataArray:
        """See ``CameraEvaluation``."""
        scene, crop = self.load(cell.source, cell.reading), cell.reading.get("crop")
        if crop is None:
            return scene
        rows, columns = centre_window((scene.sizes["y"], scene.sizes["x"]), tuple(crop), None, cell.scene)
        return scene.isel(y=rows, x=columns)

    def check_scenes(self, learned: Sequence[str], measured: Sequence[str], reading: Settings) -> None:
        """See ``CameraEvaluation``."""
        view_grid(reading["views"])  # refuses even ones
        check_asked(learned, scale=reading.get("scale"))
        check_asked(measured, test_scale=reading.get("test_scale"))
        check_asked([*learned, *measured], pattern=reading.get("pattern"), lens=asked_of_files(reading).lens)
        as_measured = asked_of_files({**reading, "scale": reading.get("test_scale")})
        check_light_fields(
            learned, measured, reading["views"], asked_of_files(reading), as_measured, reading.get("size")
        )

    def usual_train(self) -> list[str]:
        """See ``CameraEvaluation``."""
        return sorted(split_rendered_light_fields()["train"])

    def measured_reading(self, reading: Settings) -> Settings:
        """See ``CameraEvaluation``."""
        return {**reading, "scale": reading.get("test_scale")}

    def always_measured(self) -> list[str]:
        """See ``CameraEvaluation``: rendered light fields, whose geometry is known."""
        return sorted(split_rendered_light_fields()["test"])

    def places(self, study: Study, names: Mapping[str, str], files: Sequence[str]) -> list[Place]:
        """See ``CameraEvaluation``: every scene, and a crop of those from files, where the dictionary can follow."""
        reading, whole = self.measured_reading(study.reading), []
        for source, name in names.items():
            size = reading["frame"] if source in files else reading["rendered"]
            whole.append(Place(name, name, source, identity_of(source), {**reading, "crop": None, "size": size}))
        crops = [
            replace(place, name=f"{place.name} crop", shown=False, part=True,
                    reading={**place.reading, "crop": reading["crop"]})
            for place in whole if place.source in files
        ]  # fmt: skip
        return [*whole, *crops]

    def search_settings(self, study: Study, code: Code, train: Sequence[str], priors: Mapping[str, str]) -> Settings:
        """See ``CameraEvaluation``."""
        return {**super().search_settings(study, code, train, priors), "views": [study.reading["views"]] * 2}

    def training_camera(self, study: Study) -> Settings:
        """See ``CameraEvaluation``: whole tiles of codes, at least as large as a patch."""
        patch, period = study.train.settings["data"]["patch"], study.settings["period"]
        return {"views": study.reading["views"], "size": [-(-patch // side) * side for side in period]}

    def training_scenes(
        self,
        reading: Settings,
        train: Sequence[str],
        validation: Sequence[str],
        measured: Sequence[str],
        stage: TrainStage,
    ) -> Settings:
        """See ``CameraEvaluation``; given light fields make the prior alone: rendered ones among them cost up to 1.8 dB
        on a given one that was left out, and gained up to 0.8 dB on another."""
        rendered = {part: sorted(names) for part, names in split_rendered_light_fields().items()}
        asked = {name: reading[name] for name in ("scale", "pattern", "lens") if reading.get(name) is not None}
        scenes = {"train": [*stage.repeat * [*train], *(rendered["train"] if stage.rendered else ())]}
        checked = [*validation] or (rendered["validation"] if stage.rendered else [])
        return {**asked, **scenes, "prior": [*train] or ["rendered"], "validation": checked}

    def measured(self, cell: Any, shown: xr.Dataset, truth: xr.DataArray) -> Settings:
        """See ``CameraEvaluation``: also the disparity that whole estimates show, and the quality of every view."""
        from tmca.metrics import psnr_per_view, ssim_per_view

        values = shown["estimate"].values
        metrics = self.application.metrics({"values": values[None]}, truth, None)
        if not cell.about.get("disparity"):
            return {"metrics": metrics}
        views = {"psnr_per_view": psnr_per_view, "ssim_per_view": ssim_per_view}
        each = {name: metric(values, truth.values).tolist() for name, metric in views.items()}
        return {"metrics": metrics | _disparity_errors(values, cell.about["disparity"]), **each}

    def check_study(self, study: Study, train: Sequence[str], test: Sequence[str]) -> None:
        """See ``CameraEvaluation``: also a frame that the crop does not fit."""
        crop, frame = study.reading["crop"], study.reading["frame"]
        if any(side > most for side, most in zip(crop, frame, strict=True)):
            found, wanted = ("×".join(map(str, size)) for size in (frame, crop))
            raise SettingError("frame", f"{found} pixels", f"at least {wanted}, the crop that the dictionary decodes")
        try:
            self.check_scenes(train, test, {**study.reading, "size": frame})
        except SettingError as error:
            where = "frame" if error.where == "crop" else error.where
            raise SettingError(where, error.found, error.expected, error.remedy) from error

    def checks_before(self, study: Study, places: Sequence[Place]) -> list[Check]:
        """See ``CameraEvaluation``: the disparity of the true views of every scene."""
        return [
            Check(name=f"{place.scene} · disparity of the true views", camera=self.kind, method="geometry",
                  arguments={"source": place.source, "scene": place.scene, "identity": place.identity,
                             "reading": place.reading})
            for place in places if not place.part
        ]  # fmt: skip

    def informed(self, places: Sequence[Place], checks: Sequence[Settings]) -> list[Place]:
        """See ``CameraEvaluation``: with the file of their disparity."""
        maps = {check["source"]: check["disparity"] for check in checks}
        return [
            place if place.part else replace(place, about={"disparity": maps[place.source]})
            for place in places if place.part or place.source in maps
        ]  # fmt: skip

    def geometry(self, cell: Check, folder: Path) -> Settings:
        """The disparity that the fixed estimator sees in the true views and the true one, as a file; its error."""
        from tmca.metrics import disparity_error, estimate_disparity

        source, reading = cell.arguments["source"], cell.arguments["reading"]
        scene, own = self.load(source, reading), asked_of_files(reading).of(source)
        seen, truth = (
            estimate_disparity(scene.values),
            true_disparity(source, scene, own.get("scale"), own.get("pattern")),
        )
        maps = {"seen": seen.astype(np.float32)}
        maps |= {} if truth is None else {"truth": truth.values.astype(np.float32)}
        file = folder / f"disparity-{cell.key}.npz"
        np.savez(file, allow_pickle=False, **maps)
        error = {} if truth is None else _named("disparity", disparity_error(seen, truth.values))
        return {"disparity": str(file), "error": error, "source": source, "scene": cell.arguments["scene"]}

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
        """See ``CameraEvaluation``."""
        return {"atoms": 1024} if prior_kind == "dictionary" else {}


def _disparity_errors(values: np.ndarray, maps: str) -> dict[str, float]:
    """Error of the disparity that the reconstructed views show: against the true views', and the truth if known."""
    from tmca.metrics import disparity_error, estimate_disparity

    with whole_file(Path(maps), "file of disparities", "delete it and the cell that wrote it"):
        known = dict(np.load(maps, allow_pickle=False))
    seen = estimate_disparity(values)
    found = _named("agreement", disparity_error(seen, known["seen"]))
    return found | _named("disparity", disparity_error(seen, known["truth"])) if "truth" in known else found


def _named(name: str, error: dict[str, float]) -> dict[str, float]:
    return {f"{name}_{key}": error[key] for key in ("mae", "badpix")}
