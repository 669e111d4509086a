"""The spectral-depth camera in studies and sweeps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import torch
from pydantic import BaseModel, ConfigDict

from tmca.applications.example_scenes import flat_error, judge_on, placed_error, some_of
from tmca.applications.report import Section
from tmca.applications.spectral_depth import reading_range
from tmca.cameras import SpectralDepthCamera
from tmca.cameras.phase_codes import read_phase_codes
from tmca.cameras.spectral_depth import PROBE
from tmca.data import read_dataset, split_rendered
from tmca.data.depth_scenes import load_any_depth_scene, with_surroundings, withheld_scene
from tmca.data.fitting import middle_of
from tmca.decoders.likelihood import check_window, usual_window
from tmca.design import MaskEffort
from tmca.design.mask_search import SIZE
from tmca.errors import SettingError
from tmca.evaluation.camera import CameraEvaluation, Lists, Settings
from tmca.evaluation.cells import Check, Measurement
from tmca.evaluation.expected import PREDICTED, PREDICTED_BY, order
from tmca.evaluation.grid import Measured
from tmca.evaluation.scenes import read_once
from tmca.evaluation.searches import searched_masks
from tmca.evaluation.tables import Row, grouped, mean, means
from tmca.operators.window_moments import needed_block
from tmca.plots.depth import Pair, predicted_depth_figure, rows_figure
from tmca.training.scenes import place_of
from tmca.training.starting_masks import usual_margin

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from tmca.decoders import Estimate
    from tmca.evaluation.study import Study
    from tmca.evaluation.study_parts import Code, TrainStage
    from tmca.priors import GaussianPrior

CONSTANT = "constant guess"
"""Row of a depth map that is the middle of the range, in inverse metres, everywhere."""
_SAID = ("slots", "shutter", "filters", "channels", "mask", "rms", "modes", "period", "exposure")
"""Settings that a file of codes says."""


class SpectralDepthReading(BaseModel):
    """How scenes with depth are read.

    Args:
        preset: of the camera, whose bands and depth range they get.
        side: scenes from files are averaged down while their shorter side keeps at least this many pixels.
        placed: how cubes without depth are put at drawn depths, a kind of ``tmca.data.place_cube``.
        from_rgb: make up spectra for RGB-D scenes.
        crop: (H, W) middle of every scene that is measured.
    """

    model_config = ConfigDict(extra="forbid")
    preset: str = "quick"
    side: int = 256
    placed: str | None = None
    from_rgb: bool = False
    crop: tuple[int, int] = (96, 128)


def of_contrast(scene: xr.Dataset, contrast: float) -> xr.Dataset:
    """A scene whose texture is squeezed towards the mean of every band: 1 as it is, 0 uniform; depth stays."""
    cube = scene["radiance"]
    mean = cube.mean(("y", "x"))
    return scene.assign(radiance=(mean + contrast * (cube - mean)).transpose(*cube.dims))


class SpectralDepthEvaluation(CameraEvaluation):
    """Scenes with depth, of which the middle is measured. Light from around it falls into it, and is imaged too."""

    kind, Reading = "spectral-depth", SpectralDepthReading
    swept = ("slots", "mask", "rms", "modes", "shutter", "filters", "channels", "planes", "exposure", "image_formation",
             "period", "contrast", "codes")  # fmt: skip
    always_learned = ("gaussian",)
    words = ("mask", "shutter", "filters", "channels", "exposure", "image_formation", "codes")
    metric = "depth_mae"
    pictures: ClassVar = {"": "Colours, depth and spectra behind every code"}

    def probe(self, reading: Settings, size: tuple[int, int] = (64, 64)) -> SpectralDepthCamera:
        """A camera of the preset, for its bands and depth range."""
        return SpectralDepthCamera.from_preset(reading["preset"], size=size)

    def load(
        self, source: str, reading: Settings, measured: bool = False, camera: SpectralDepthCamera | None = None
    ) -> xr.Dataset:
        """See ``CameraEvaluation``; made-up spectra of what is measured are of reflectances that nothing learned from.
        Bands and depth range are those of the preset, or of a camera."""
        materials = {"materials": "test"} if measured else {}
        how = {**self.training_reading(reading), **materials, **reading_range(camera or self.probe(reading))}
        whole: xr.Dataset = read_once(load_any_depth_scene, source, **how)
        if measured:
            middle_of(whole, _size(reading["crop"]), source)  # refuses a smaller one
        return whole

    def scene(self, cell: Any) -> xr.Dataset:
        size = _size(cell.reading["crop"])
        camera = self.camera(cell, _Extent(size))
        whole = self.load(cell.source, cell.reading, measured=True, camera=camera)
        scene = with_surroundings(whole, size, cell.source, camera.tile_size)
        return of_contrast(scene, float(cell.about["contrast"])) if "contrast" in cell.about else scene

    def rendered(self) -> Mapping[str, Sequence[str]]:
        return split_rendered()

    def parts(self, scene: Any) -> Settings:
        """See ``CameraEvaluation``; bands are the preset's."""
        return {"size": (scene.sizes["y"], scene.sizes["x"])}

    def coded(self, codes: str, parts: Settings) -> Settings:
        return read_phase_codes(codes)

    def learn(self, cell: Settings, path: Path) -> Path:
        from tmca.priors import learn_prior

        probe, scenes = self.probe(cell["reading"]), []
        for name in cell["scenes"]:
            scene = self.load(name, cell["reading"], camera=probe)
            scenes.append(scene["radiance"].assign_attrs(name=name))
        file = path.with_suffix(".nc")
        learn_prior(scenes, probe, cell["prior_kind"], block=tuple(cell["settings"]["block"])).save(
            file, overwrite=True
        )
        return file

    def search(self, cell: Settings, folder: Path) -> Settings:
        """See ``CameraEvaluation``: masks of least confusion of depths."""
        camera = {**cell["settings"]["camera"], "seed": cell["seed"]}
        probe = self.build({"size": SIZE}, camera, cell["sensor"])
        return searched_masks(probe, cell, self._examples(cell["settings"]), folder)

    def _examples(self, about: Settings) -> list[torch.Tensor]:
        """Some training scenes (L, H, W), at the bands of the preset."""
        how = {name: about["reading"][name] for name in ("preset", "side", "placed", "from_rgb")}
        return _examples(tuple(about["examples"]), **how)

    def search_settings(self, study: Study, code: Code, lists: Lists) -> Settings:
        """See ``CameraEvaluation``: the code's camera, prior and example scenes."""
        own = MaskEffort(**study.search["effort"])
        starts = own.starts * (code.search.starts if code.search else 1)
        camera = self.camera_settings({**study.settings, **code.camera}, study.reading)
        return {**self.judging(study, lists), "camera": camera,
                "effort": {**study.search["effort"], "starts": starts}}  # fmt: skip

    def judging(self, study: Study, lists: Lists) -> Settings:
        """What masks are judged by without a test scene."""
        return {"prior": lists.priors["gaussian"], "examples": some_of(list(lists.train)), "reading": study.reading,
                "searched": study.search["searched"], "window": study.options["likelihood"]["window"]}  # fmt: skip

    def training_camera(self, study: Study) -> Settings:
        return {"preset": study.reading["preset"], "size": [study.train.settings["data"]["patch"]] * 2}

    def training_scenes(
        self, reading: Settings, train: Sequence[str], validation: Sequence[str], measured: Sequence[str],
        stage: TrainStage,
    ) -> Settings:  # fmt: skip
        """See ``CameraEvaluation``; a rendered scene and the last given one with a depth of its own choose the best
        step, and teach networks nothing."""
        withheld = withheld_scene(train)
        rendered = sorted({*self.rendered()["train"]} - {*measured}) if stage.rendered else []
        learned = [name for name in train if name != withheld]
        checked = [*validation] or [*rendered[:1], *([] if withheld is None else [withheld])]
        scenes = {"train": [*stage.repeat * learned, *rendered[1:]], "validation": checked, "prior": learned}
        return {**scenes, **self.training_reading(reading)}

    def training_reading(self, reading: Settings) -> Settings:
        return {name: reading[name] for name in ("side", "placed", "from_rgb")}

    def middle(self, cell: Measurement, estimate: Estimate, scene: xr.Dataset) -> tuple[xr.Dataset, xr.Dataset]:
        size = _size(cell.reading["crop"])
        shown = estimate.to_xarray()
        return middle_of(shown, size, cell.scene), middle_of(scene, size, cell.scene)

    def measured(self, cell: Measurement, shown: xr.Dataset, truth: xr.Dataset) -> Settings:
        """See ``CameraEvaluation``: also the share of a point's light that arrives within the window of its image."""
        camera = self.camera(cell, _Extent(_size(cell.reading["crop"])))
        parts = {"values": shown["radiance"].values[None], "depth": shown["depth"].values}
        with torch.no_grad():
            arrived = float(camera.point_spread.arrived().mean())
        return {"metrics": self.application.metrics(parts, truth, camera), "arrived": arrived}

    def constant_guess(self, cell: Check, folder: Path) -> Settings:
        """Depth errors of the middle of the range, in inverse metres, everywhere; scene by scene."""
        reading, crop = cell.arguments["reading"], _size(cell.arguments["reading"]["crop"])
        camera, metrics = self.probe(reading, crop), {}
        middle = 2 / (1 / camera.planes.near + 1 / camera.planes.far)
        for source, name in cell.arguments["scenes"].items():
            scene = middle_of(self.load(source, reading, measured=True, camera=camera), crop, name)
            parts = {"values": scene["radiance"].values[None], "depth": np.full(crop, middle, dtype=np.float32)}
            own = self.application.metrics(parts, scene, camera)
            metrics[name] = {key: own[key] for key in ("depth_mae", "depth_rmse", "within_bin", "known_depth")}
        return {"guess": metrics}

    def check_study(self, study: Study, train: Sequence[str], test: Sequence[str]) -> None:
        """See ``CameraEvaluation``: also scenes of both lists, and scenes too small for what is measured or learned."""
        reading, preset = study.reading, SpectralDepthCamera.preset(study.reading["preset"])
        margin = usual_margin(preset["bench"].window, preset["period"])
        trains = {*study.decoders} & {*study.networks}
        least = max(min(reading["crop"]), study.train.settings["data"]["patch"] + 2 * margin if trains else 1)
        if reading["side"] < least:
            wanted = f"at least {least} pixels, as patches with margins and --crop need"
            raise SettingError("side", str(reading["side"]), wanted)
        for name, scenes in (("train", train), ("test", test)):
            if not scenes:
                raise SettingError(name, "no scenes", "scenes or split files")
        both = sorted({place_of(name) for name in train} & {place_of(name) for name in test})
        if both:
            raise SettingError("test", f"{both[0]}, a training scene", "other scenes")
        self.check_scenes(train, test, reading)

    def checks(self, study: Study, cells: Sequence[Measurement], lists: Lists) -> list[Check]:
        """See ``CameraEvaluation``: what a constant guess of the depth errs by, and what is predicted of the codes that
        the patch likelihood decodes."""
        scenes = {"reading": study.reading, "scenes": {place.source: place.scene for place in lists.places},
                  "identities": [place.identity for place in lists.places]}  # fmt: skip
        guess = Check(name=CONSTANT, camera=self.kind, method="constant_guess", seed=study.seed, arguments=scenes)
        first = {(cell.code, cell.noise, cell.seed): cell for cell in cells if cell.decoder == "likelihood"}
        about = self.judging(study, lists)
        return [guess, *(
            Check(name=f"predicted · {code} · {noise} · seed {seed}", camera=self.kind, method="predicted", code=code,
                  noise=noise, seed=seed,
                  arguments={**about, "settings": cell.settings, "sensor": cell.sensor, "codes": cell.codes,
                             "weights": cell.camera_of, "identity": cell.identity})
            for (code, noise, seed), cell in first.items()
        )]  # fmt: skip

    def predicted(self, cell: Check, folder: Path) -> Settings:
        """What prior and training scenes say of a code under a noise, before any test scene is seen."""
        from tmca.design.spectral_depth import confusion, depth_information, kullback_leibler, predict_windows
        from tmca.priors import GaussianPrior

        about, prior = cell.arguments, GaussianPrior.load(cell.arguments["prior"])
        camera = self.shown({"size": SIZE}, about["settings"], about["sensor"], about["codes"], about["weights"])
        with torch.no_grad():
            found = predict_windows(camera, prior, about["searched"])
            distance = kullback_leibler(found.covariance).fill_diagonal_(float("inf"))
            return {"figures": {
                **self._on_examples(about, camera, prior),
                "confusion": float(confusion(found.covariance)),
                "fisher": float(depth_information(camera, prior, about["searched"]).log().mean().exp()),
                "kullback_leibler": float(distance.min(1).values.mean()),
                "psnr": -10 * float(found.spectral_error.mean().log10()),
            }}  # fmt: skip

    def _on_examples(self, about: Settings, camera: Any, prior: GaussianPrior) -> dict[str, float]:
        """Errors on training scenes at drawn depths, and without edges of depth; none where they are too small."""
        kinds = {"placed": placed_error, "flat": flat_error}
        judges = {name: judge_on(self._examples(about), prior, about["window"], error) for name, error in kinds.items()}
        return {name: judge(camera) for name, judge in judges.items() if judge is not None}

    def check_point(self, camera: Settings, sensor: Settings) -> None:
        """See ``CameraEvaluation``: also settings beside a file that says them."""
        if not 0 <= float(camera.get("contrast", 1.0)) <= 1:
            raise SettingError("contrast", str(camera["contrast"]), "from 0 (uniform) to 1 (as the scene is)")
        beside = [name for name in _SAID if name in camera and "codes" in camera]
        if beside:
            found, wanted = f"a file beside {beside[0]}", "one of them: the file says it"
            raise SettingError("--set codes", found, wanted, "leave it out")
        own = {name: value for name, value in camera.items() if name not in ("contrast", "codes")}
        self.build({"size": PROBE}, own, sensor, camera.get("codes"))

    def window(self, settings: Settings, crop: Sequence[int], window: int | None, codes: str | None) -> int:
        """Side of the windows of a swept camera in pixels.

        Raises:
            SettingError: one that does not hold a tile of the codes, or a tile larger than the crop (H, W).
        """
        camera = self.build({"size": PROBE}, settings, {}, codes)
        if camera.tile_size > min(crop):
            found, known = f"{crop[0]}×{crop[1]} pixels", f"at least the {camera.tile_size} of the tile of the codes"
            raise SettingError("crop", found, known, "take a larger crop, or a smaller period")
        side = usual_window(camera) if window is None else window
        check_window(side, camera)
        return side

    def prior_settings(self, prior_kind: str, settings: Settings, reading: Settings) -> Settings:
        """See ``CameraEvaluation``: blocks for windows of the side that the reading says."""
        return {"block": list(needed_block(reading["window"], self.probe(reading).bench.window))}

    def row(self, cells: Sequence[Measured]) -> Row:
        return {"arrived": mean([cell["arrived"] for cell in cells])}

    def conclusions(self, study: Study, measured: Sequence[Measured], rows: Sequence[Row]) -> Row:
        """See ``CameraEvaluation``: what is known of every code and noise before a test scene, means over seeds, beside
        what decoders made of it; the constant guess."""
        made: dict[tuple[str, str], Row] = {}
        for row in rows:
            made.setdefault((row["code"], row["noise"]), {})[row["decoder"]] = {
                n: row[n] for n in ("depth_mae", "psnr")
            }
        groups = grouped([cell for cell in measured if "figures" in cell], "code", "noise")
        predicted = [
            {"code": code, "noise": noise, **means(cell["figures"] for cell in own), "measured": made[code, noise]}
            for (code, noise), own in groups.items() if (code, noise) in made
        ]  # fmt: skip
        guesses = {scene: guess for cell in measured for scene, guess in cell.get("guess", {}).items()}
        return {"predicted": predicted, "guess": guesses}

    def scores(self, found: Row, decoder: str, noise: str) -> dict[str, float]:
        """See ``CameraEvaluation``; of the patch likelihood the error on training scenes at drawn depths."""
        if decoder != "likelihood":
            return super().scores(found, decoder, noise)
        return {row["code"]: row["placed"] for row in found["predicted"] if row["noise"] == noise and "placed" in row}

    def sections(self, found: Row, study: Study) -> Iterable[Section]:
        columns = [("scene", "scene", ""), *self.columns[:3], ("known_depth", "known depth", ".0%")]
        text = "The middle of the range, in inverse metres, everywhere; depth counts where it is known."
        yield Section("A constant guess", [text], [{"scene": n, **own} for n, own in found["guess"].items()], columns)
        if not found["predicted"]:
            return
        rows = [
            {**row, **{f"measured_{name}": value for name, value in row["measured"].get("likelihood", {}).items()}}
            for row in found["predicted"]
        ]
        measured = [("depth_mae", "measured depth MAE (m)", ".3f"), ("psnr", "measured PSNR (dB)", ".2f")]
        columns = [("noise", "noise", ""), ("code", "code", ""), *PREDICTED]
        columns += [(f"measured_{name}", heading, spec) for name, heading, spec in measured]
        yield Section("What is predicted without a test scene", [PREDICTED_BY], rows, columns)
        text = "Rank correlation of each with the measured depth MAE, of PSNR with measured PSNR; 1: the right order."
        columns = [("noise", "noise", ""), ("decoder", "decoder", ""), ("codes", "codes", "d")]
        columns += [(name, heading, "+.2f") for name, heading, _ in PREDICTED]
        if ranked := order(found, study.decoder_labels):
            yield Section("The order of the codes", [text], ranked, columns)

    def truth(self, study: Study, cell: Measured) -> xr.Dataset:
        """See ``CameraEvaluation``; the middle that is compared."""
        scene = self.load(cell["source"], cell["reading"], measured=True)
        return middle_of(scene, _size(cell["reading"]["crop"]), cell["scene"])

    def scene_figures(self, study: Study, cells: Sequence[Measured]) -> dict[str, Figure]:
        """See ``CameraEvaluation``: depth maps and spectra of the rows of a scene."""
        first, labels = cells[0], study.decoder_labels
        camera = self.probe(study.reading, _size(study.reading["crop"]))
        truth = middle_of(self.load(first["source"], study.reading, measured=True), camera.size, first["scene"])
        rows: dict[str, dict[str, Pair]] = {}
        for cell in cells:
            found = read_dataset(cell["estimate"], ("radiance", "depth"))
            rows.setdefault(cell["code"], {})[labels[cell["decoder"]]] = found["radiance"].values, found["depth"].values
        decoders = [*dict.fromkeys(labels[cell["decoder"]] for cell in cells)]
        real, ends = (truth["radiance"].values, truth["depth"].values), (camera.planes.near, camera.planes.far)
        return {"": rows_figure(rows, decoders, real, camera.wavelengths, ends)}

    def study_figures(self, study: Study, measured: Sequence[Measured]) -> dict[str, Figure]:
        """See ``CameraEvaluation``: what searched masks predict over depth."""
        found = {cell["code"]: cell for cell in measured if "confusion" in cell}
        cameras = {
            code: self.build({"size": SIZE}, one["settings"]["camera"], one["sensor"]) for code, one in found.items()
        }
        metres = {code: camera.planes.metres.numpy() for code, camera in cameras.items()}
        predicted = {code: one["predicted"] for code, one in found.items()}
        return {"fisher": predicted_depth_figure(predicted, metres)} if predicted else {}


class _Extent:
    """Sizes of a scene that is not read yet."""

    def __init__(self, size: tuple[int, int]) -> None:
        self.sizes = {"y": size[0], "x": size[1]}


def _size(crop: Sequence[int]) -> tuple[int, int]:
    return int(crop[0]), int(crop[1])


@lru_cache(maxsize=1)
def _examples(names: tuple[str, ...], **reading: Any) -> list[torch.Tensor]:
    """Read once for all the cells of a process."""
    camera = SpectralDepthCamera.from_preset(reading.pop("preset"), size=SIZE)
    scenes = (load_any_depth_scene(name, **reading, **reading_range(camera)) for name in names)
    return [torch.from_numpy(scene["radiance"].values.copy()) for scene in scenes]
