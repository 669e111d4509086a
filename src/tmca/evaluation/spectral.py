"""The spectral camera in studies and sweeps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, BeforeValidator, ConfigDict

from tmca.applications.report import Section
from tmca.cameras import SpectralCamera
from tmca.data import read_dataset, split_rendered
from tmca.data.fitting import VISIBLE
from tmca.data.headers import wavelengths_of
from tmca.data.scene_names import identity_of
from tmca.data.scenes import load_scene
from tmca.errors import DataError, SettingError
from tmca.evaluation.camera import CameraEvaluation, Lists, Settings
from tmca.evaluation.cells import Check, Measurement
from tmca.evaluation.grid import Measured
from tmca.evaluation.scenes import read_once
from tmca.evaluation.tables import Row
from tmca.plots.cube import bands, composites, signatures
from tmca.sensor import Sensor
from tmca.specs.base import Span

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from tmca.evaluation.study import Study


def _in_nm(value: Any) -> Any:
    """Numbers of 1 or more are nanometres, in metres; other values as they are."""
    several = isinstance(value, list | tuple) and all(isinstance(one, int | float) for one in value)
    return [one * 1e-9 for one in value] if several and value and min(value) >= 1 else value


class SpectralReading(BaseModel):
    """How cubes are read.

    Args:
        bands: nearest to even spacing over the range.
        range: first and last wavelength that bands are taken from, metres; ``400:1000`` or [400, 1000] in nm; 400 to
            700 nm if None.
        size: (H, W) middle of those that are measured.
    """

    model_config = ConfigDict(extra="forbid")
    bands: int = 12
    range: Annotated[Span, BeforeValidator(_in_nm)] | None = None
    size: tuple[int, int] | None = None


def _some_bands(study: Study, there: Sequence[NDArray[np.float64]]) -> str:
    """How many of the scenes' bands are measured, where some have more, and how all are, where that is one number."""
    low, high = study.reading["range"] or VISIBLE
    bands, counts = study.reading["bands"], sorted({len(metres) for metres in there})
    if not counts or counts[-1] <= bands:
        return ""
    option = f"--bands {counts[0]}" if study.figure else f"`bands: {counts[0]}` under `reading`"
    whole = all(metres.min() > low - 1e-9 and metres.max() < high + 1e-9 for metres in there)
    hint = f" ({option} for all)" if whole and len(counts) == 1 else ""
    return f"{bands} of {' or '.join(map(str, counts))} bands{hint}"


def _wavelengths(sources: Sequence[str]) -> list[NDArray[np.float64]]:
    """Of all scenes; of none where one is gone since it was measured."""
    try:
        return [wavelengths_of(source) for source in sources]
    except DataError:
        return []


class SpectralEvaluation(CameraEvaluation):
    """Cubes."""

    kind, sweeps_networks, Reading = "spectral", True, SpectralReading
    swept = ("slots", "aperture", "shutter", "exposure", "dispersion", "disperser", "transmittance", "duty", "period")
    words = ("aperture", "shutter", "exposure", "disperser")
    pictures: ClassVar = {  # the thesis' figures 20 to 22
        "composites": "Colour composites",
        "spectra": "Spectra at a few points",
        "bands": "Six bands",
    }

    def load(self, source: str, reading: Settings, measured: bool = False) -> xr.DataArray:
        size = reading.get("size") if measured else None
        return read_once(load_scene, source, **self.training_reading(reading), size=size and (size[0], size[1]))

    def rendered(self) -> Mapping[str, Sequence[str]]:
        return split_rendered()

    def training_reading(self, reading: Settings) -> Settings:
        span = reading.get("range")
        return {"bands": reading["bands"], **({} if span is None else {"range": (span[0], span[1])})}

    def check_study(self, study: Study, train: Sequence[str], test: Sequence[str]) -> None:
        """See ``CameraEvaluation``; networks are trained on 400 to 700 nm."""
        trained = [name for name in study.decoders if name in study.networks]
        if trained and study.reading["range"] is not None:
            found = f"a range for {', '.join(trained)}"
            raise SettingError("reading.range", found, "none where a network is trained", "leave one of them out")
        super().check_study(study, train, test)

    def check_point(self, camera: Settings, sensor: Settings) -> None:
        SpectralCamera(bands=2, size=(64, 64), sensor=Sensor(**sensor), **camera)

    def prior_settings(self, prior_kind: str, settings: Settings, reading: Settings) -> Settings:
        """See ``CameraEvaluation``: how far the camera disperses."""
        camera = self.build({"bands": reading["bands"], "size": (64, 64)}, settings, {})
        return {"extent": camera.dispersion.extent}

    def checks(self, study: Study, cells: Sequence[Measurement], lists: Lists) -> list[Check]:
        """See ``CameraEvaluation``: the expected error of codes that are not learned, where the LMMSE is asked for and
        scenes stand still."""
        if study.motion is not None or not study.patches:
            return []
        scenes = {"train": [*lists.train], "test": [*lists.test]}
        about = {"prior": lists.priors.get("gaussian"), **scenes, "reading": study.reading, "patches": study.patches,
                 "identities": [identity_of(name) for part in scenes.values() for name in part]}  # fmt: skip
        first = {(cell.noise, cell.code): cell for cell in cells if cell.decoder == "lmmse" and not cell.camera_of}
        return [
            Check(name=f"expected error · {code} · {noise}", camera=self.kind, method="expected_error", code=code,
                  noise=noise, seed=study.seed,
                  arguments={**about, "sensor": cell.sensor, "settings": {**cell.settings, "seed": study.seed}})
            for (noise, code), cell in first.items() if cell.codes is None and about["prior"]
        ]  # fmt: skip

    def expected_error(self, cell: Check, folder: Path) -> Settings:
        """Predicted PSNR of a code beside the PSNR on patches of the training and of the test scenes."""
        import torch

        from tmca.evaluation.expected import predicted_and_measured
        from tmca.priors import GaussianPrior

        about = cell.arguments
        prior, found = GaussianPrior.load(about["prior"]), {}
        parts = {"bands": prior.wavelengths or about["reading"]["bands"], "size": (256, 256)}
        camera = self.build(parts, about["settings"], about["sensor"])
        for split in ("train", "test"):
            cubes = [torch.from_numpy(self.load(path, about["reading"]).values) for path in about[split]]
            found["predicted"], found[split] = predicted_and_measured(
                prior, camera, cubes, count=about["patches"], seed=cell.seed
            )
        return {"expected": found}

    def conclusions(self, study: Study, measured: Sequence[Measured], rows: Sequence[Row]) -> Row:
        checks = [cell for cell in measured if "expected" in cell]
        sources = sorted({cell["source"] for cell in measured if "metrics" in cell})
        return {
            "expected_error": [{"code": cell["code"], "noise": cell["noise"], **cell["expected"]} for cell in checks],
            "bands": _some_bands(study, _wavelengths(sources)),
        }

    def scores(self, found: Row, decoder: str, noise: str) -> dict[str, float]:
        """See ``CameraEvaluation``; of the LMMSE what searches expect of their codes."""
        if decoder != "lmmse":
            return super().scores(found, decoder, noise)
        return {one["code"]: -one["psnr"] for one in found["searches"] if one["noise"] == noise and "psnr" in one}

    def sections(self, found: Row, study: Study) -> Iterable[Section]:
        columns = [("code", "code", ""), ("noise", "noise", ""), ("predicted", "predicted (dB)", ".2f")]
        columns += [("train", "on patches of training scenes", ".2f"), ("test", "on patches of test scenes", ".2f")]
        text = "PSNR of single blocks under the Gaussian prior: predicted before anything is captured, and measured on "
        text += "thousands of patches. Overlapping blocks, blended, do better than single ones."
        if found["expected_error"]:
            yield Section("Expected error against measured error", [text], found["expected_error"], columns)

    def scene_figures(self, study: Study, cells: Sequence[Measured]) -> dict[str, Figure]:
        truth = self.load(cells[0]["source"], cells[0]["reading"], measured=True)
        shown = self.estimates(study, cells)
        cubes = {name: read_dataset(cell["estimate"], ("estimate",))["estimate"].values for name, cell in shown.items()}
        waves: list[float] = truth["wavelength"].values.tolist()
        return {
            "composites": composites(truth.values, cubes, waves, study.shown_noise or ""),
            "spectra": signatures(truth.values, cubes, waves),
            "bands": bands(truth.values, cubes, waves),
        }
