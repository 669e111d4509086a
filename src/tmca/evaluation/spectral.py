"""The spectral camera in studies and sweeps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel, ConfigDict

from tmca.cameras import SpectralCamera
from tmca.data import split_rendered
from tmca.data.scene_names import identity_of
from tmca.data.scenes import check_readable, load_scene
from tmca.evaluation.camera import CameraEvaluation, Settings
from tmca.evaluation.cells import Check, Measurement
from tmca.evaluation.scenes import read_once
from tmca.sensor import Sensor

if TYPE_CHECKING:
    import xarray as xr

    from tmca.evaluation.study import Study, TrainStage


class SpectralReading(BaseModel):
    """How cubes are read.

    Args:
        bands: nearest to even spacing from 400 to 700 nm.
        size: (H, W) middle of those that are measured.
    """

    model_config = ConfigDict(extra="forbid")
    bands: int = 12
    size: tuple[int, int] | None = None


class SpectralEvaluation(CameraEvaluation):
    """Cubes."""

    kind, sweeps_networks, Reading = "spectral", True, SpectralReading
    swept = ("slots", "aperture", "shutter", "exposure", "dispersion", "disperser", "transmittance", "duty", "period")
    words = ("aperture", "shutter", "exposure", "disperser")

    def load(self, source: str, reading: Settings) -> xr.DataArray:
        """See ``CameraEvaluation``."""
        return read_once(load_scene, source, bands=reading["bands"])

    def scene(self, cell: Any) -> xr.DataArray:
        """See ``CameraEvaluation``."""
        size = cell.reading.get("size")
        side = None if size is None else (size[0], size[1])
        return read_once(load_scene, cell.source, bands=cell.reading["bands"], size=side)

    def check_scenes(self, learned: Sequence[str], measured: Sequence[str], reading: Settings) -> None:
        """See ``CameraEvaluation``."""
        check_readable(measured, reading["bands"], reading.get("size"))
        check_readable(learned, reading["bands"])

    def study_prior_settings(self, prior_kind: str, study: Study) -> Settings:
        """See ``CameraEvaluation``: for one pixel of dispersion between bands."""
        return {"extent": study.reading["bands"] - 1}

    def training_scenes(
        self,
        reading: Settings,
        train: Sequence[str],
        validation: Sequence[str],
        measured: Sequence[str],
        stage: TrainStage,
    ) -> Settings:
        """See ``CameraEvaluation``; given scenes make the prior alone: rendered ones among them cost the first estimate
        1.4 dB on scenes left out."""
        rendered = sorted(split_rendered()["train"]) if stage.rendered else []
        scenes = {"train": [*stage.repeat * [*train], *rendered], "validation": [*validation]}
        return {"bands": reading["bands"], "prior": [*train] or ["rendered"], **scenes}

    def check_point(self, camera: Settings, sensor: Settings) -> None:
        """See ``CameraEvaluation``."""
        SpectralCamera(bands=2, size=(64, 64), sensor=Sensor(**sensor), **camera)

    def prior_settings(self, prior_kind: str, settings: Settings, reading: Settings) -> Settings:
        """See ``CameraEvaluation``: how far the camera disperses."""
        camera = self.build({"bands": reading["bands"], "size": (64, 64)}, settings, {})
        return {"extent": camera.dispersion.extent}

    def checks_after(
        self,
        study: Study,
        cells: Sequence[Measurement],
        priors: Mapping[str, str],
        train: Sequence[str],
        test: Sequence[str],
    ) -> list[Check]:
        """See ``CameraEvaluation``: the expected error of codes that are not learned, where the LMMSE is asked for."""
        about = {"prior": priors.get("gaussian"), "train": [*train], "test": [*test], "reading": study.reading,
                 "patches": study.patches, "identities": [identity_of(name) for name in (*train, *test)]}  # fmt: skip
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
