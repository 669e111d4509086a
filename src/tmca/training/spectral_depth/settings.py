"""What a training run of the spectral-depth camera is told."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, model_validator

from tmca.training.settings import (
    DataSettings,
    LearningSettings,
    OptimiserSettings,
    Strict,
    TrainSettings,
    settings_of,
)


class SpectralDepthCameraSettings(Strict):
    """The spectral-depth camera of a run; names as in `SpectralDepthCamera`, what is None as in the preset, and
    so is the number of slots that is not given.

    ``size`` is that of the patches: point spread functions and tiles fit any. ``learn`` says what is learned,
    ``stroke`` (lowest and highest, metres) and ``levels`` what the device can show, ``bench`` replaces arguments of
    `PhaseMaskBench`.
    """

    preset: str = "quick"
    size: tuple[int, int] = (64, 64)
    slots: int = Field(default=4, ge=1)
    depth: tuple[float, float] | None = None
    planes: int | None = Field(default=None, ge=2)
    mask: str | None = None
    rms: float | None = Field(default=None, ge=0)
    modes: int | None = Field(default=None, ge=1)
    stroke: tuple[float, float] | None = None
    levels: int | None = Field(default=None, ge=2)
    bench: dict[str, Any] = Field(default={})
    shutter: str | None = None
    filters: str | None = None
    channels: str | None = None
    period: int | None = Field(default=None, ge=1)
    exposure: Literal["equal", "per-slot"] = "equal"
    image_formation: Literal["linear", "occlusion"] = "linear"
    seed: int = 0
    learn: Literal["none"] | tuple[Literal["mask", "shutter", "filters"], ...] = "none"


class SpectralDepthDataSettings(DataSettings):
    """Scenes with depth and patches; ``DataSettings`` says what is not said here.

    Args:
        train: rendered scenes, RGB-D scenes, spectral scenes with depth, cubes, or split files (``.txt``) of them.
        from_rgb: make up spectra of measured reflectances for RGB-D scenes.
        placed: how cubes without depth are put at drawn depths, a kind of ``tmca.data.place_cube``.
        side: scenes from files are averaged down while their shorter side keeps at least this many pixels.
        redrawn: share of patches at drawn depths.
        margin: pixels of scene around every patch, whose light falls into it; None for as many as light reaches. A
            patch in the dark would show its depth by the blur of its rim.
    """

    from_rgb: bool = False
    placed: str | None = None
    side: int = Field(default=256, ge=16)
    redrawn: float = Field(default=0.5, ge=0, le=1)
    margin: int | None = Field(default=None, ge=0)
    motion: Literal[0] = 0
    batch: int = Field(default=4, ge=1)


class SpectralDepthOptimiserSettings(OptimiserSettings):
    """Length of the run, learning rates, losses; ``OptimiserSettings`` says what is not said here.

    Args:
        mask_rate: learning rate of heights or coefficients (Adam), in units of the larger of a micrometre and the
            highest: 0.001 moves every one by up to a nanometre in a step.
        depth_weight: of the error of inverse depth, as a share of the range, beside the loss of the cube.
        likelihood_weight: of the same error of the patch likelihood, while masks, shutter or filters learn: a network
            may be long in seeing depth, and codes that learn with it alone lose it meanwhile.
        likelihood_every: steps from one of these errors to the next, which then counts as often.
    """

    mask_rate: float = Field(default=0.001, ge=0)
    loss: Literal["l2", "l1", "charbonnier", "log"] = "l1"
    depth_weight: float = Field(default=0.1, ge=0)
    likelihood_weight: float = Field(default=0.1, ge=0)
    likelihood_every: int = Field(default=3, ge=1)

    def code_rates(self) -> dict[str, float]:
        """See ``OptimiserSettings``; shutter and filters have latent values, masks have heights."""
        return {"codes": self.code_rate, "masks": self.mask_rate}


class SpectralDepthTrainSettings(TrainSettings):
    """A whole run of the spectral-depth camera."""

    camera: SpectralDepthCameraSettings = SpectralDepthCameraSettings()  # type: ignore[assignment]
    decoder: dict[str, Any] = Field(default={"kind": "two-headed"})
    data: SpectralDepthDataSettings = SpectralDepthDataSettings()
    codes: LearningSettings = LearningSettings()  # type: ignore[assignment]
    optimiser: SpectralDepthOptimiserSettings = SpectralDepthOptimiserSettings()

    @model_validator(mode="after")
    def _has_levels(self) -> SpectralDepthTrainSettings:
        if self.camera.levels is not None and self.camera.stroke is None:
            raise ValueError("camera.levels: beside camera.stroke alone")
        if (self.camera.bench or self.camera.stroke) and self.codes.start not in ("random", "one-hot"):
            raise ValueError("camera.bench, camera.stroke: nothing, codes.start brings its own")
        return self

    @model_validator(mode="after")
    def _has_patches(self) -> SpectralDepthTrainSettings:
        if self.camera.size != (self.data.patch, self.data.patch):
            raise ValueError(f"camera.size {self.camera.size}: the patches', ({self.data.patch}, {self.data.patch})")
        if self.data.bands != type(self.data).model_fields["bands"].default:
            raise ValueError("data.bands: nothing, the bands are those of camera.preset")
        return self


SPECTRAL_DEPTH_TRAININGS: dict[str, dict[str, Any]] = {
    # thesis 5.2: 25 bands, K = 4, D = 8, R = 4, patches of 256², Adam at 1e-3, everything learned end to end. Assumed,
    # as the thesis does not say: batches of 2, 200 epochs, L1 plus 0.1 times the depth error, the plain two-headed
    # U-Net and no other decoder to learn from, codes started at random, code rate 0.03 and mask rate 0.001, no noise;
    # and what `SpectralDepthCamera` assumes.
    "thesis": {
        "camera": {"preset": "thesis", "size": [256, 256], "learn": ["mask", "shutter", "filters"]},
        "decoder": {"kind": "two-headed", "start": "snapshot", "widths": [64, 128, 256]},
        "data": {"patch": 256, "batch": 2, "side": 512, "brightness": 0.0, "tint": 0.0},
        "optimiser": {"epochs": 200, "likelihood_weight": 0.0},
        "codes": {"frozen": 0.0},
        "precision": "32-true",
    },
    # a step takes under a second of one core (``benchmarks/training.py``)
    "quick": {
        "camera": {"preset": "quick", "size": [64, 64]},
        "codes": {"start": "one-hot"},
        "decoder": {"kind": "two-headed"},
        "noise": [{"read_noise": 0.002}],
        "data": {"patch": 64, "batch": 4, "pool": 256},
        "optimiser": {"steps": 400},
    },
}


def usual_margin(window: tuple[int, int], period: int) -> int:
    """Pixels of scene around a patch where none are given: as far as light reaches, in whole tiles.

    Args:
        window: (h, w) of the point spread functions.
        period: of the tile of shutter and filters, pixels.
    """
    return -(-(max(window) // 2) // period) * period


def spectral_depth_settings(
    preset: str | None = None, file: str | Path | None = None, changes: Mapping[str, Any] | None = None
) -> SpectralDepthTrainSettings:
    """Settings of a preset of ``SPECTRAL_DEPTH_TRAININGS``, replaced by a file's, replaced by single changes.

    Raises:
        SettingError: unknown preset or name, impossible value.
        DataError: the file cannot be read.
    """
    return settings_of(SpectralDepthTrainSettings, SPECTRAL_DEPTH_TRAININGS, preset, file, changes)
