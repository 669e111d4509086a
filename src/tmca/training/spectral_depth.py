"""Training of the spectral-depth camera."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import Field, model_validator
from torch import Tensor

from tmca.cameras import SpectralDepthCamera
from tmca.decoders import Weights
from tmca.decoders.nets.build import build_depth_network
from tmca.decoders.nets.tiles import TwoHeadedNetwork
from tmca.decoders.nets.two_headed import TwoHeadedUNet
from tmca.errors import DataError
from tmca.operators.window_moments import needed_block
from tmca.optics import check_mask
from tmca.priors import block_of
from tmca.specs.base import Share, Whole
from tmca.training.camera_training import CameraTraining, NeededPrior
from tmca.training.depth_system import DepthSystem
from tmca.training.depth_windows import SIDE
from tmca.training.patches import CubeStore, Load, PatchSource
from tmca.training.settings import CameraSettings, DataSettings, OptimiserSettings, TrainSettings
from tmca.training.starting_masks import starting_camera

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

_CROPS = 2
"""Crops of every validation scene along either axis."""


class SpectralDepthCameraSettings(CameraSettings):
    """The spectral-depth camera of a run; names as in `SpectralDepthCamera`, what is None as in the preset, and
    so is the number of slots that is not given."""

    preset: str = "quick"
    "Camera that says what is not said here."
    size: tuple[int, int] = (64, 64)
    "Of the patches: point spread functions and tiles fit any."
    slots: Whole = 4
    depth: tuple[float, float] | None = None
    "Nearest and farthest plane, metres."
    planes: int | None = Field(default=None, ge=2)
    "Depth planes, even in inverse depth."
    mask: str | None = None
    "Family of the phase masks."
    rms: float | None = Field(default=None, ge=0)
    "Of a random mask's heights, metres."
    modes: Whole | None = None
    "Zernike modes of a random mask."
    stroke: tuple[float, float] | None = None
    "Lowest and highest that the device can show, metres."
    levels: int | None = Field(default=None, ge=2)
    "Heights that the device can show, evenly within ``stroke``."
    bench: dict[str, Any] = Field(default={})
    "Replaces arguments of `PhaseMaskBench`."
    shutter: str | None = None
    "Family of the shutter codes."
    filters: str | None = None
    "Colour filters over the pixels."
    channels: str | None = None
    "Of the sensor."
    period: Whole | None = None
    "Tile of shutter and filters, pixels."
    image_formation: Literal["linear", "occlusion"] = "linear"
    "Whether near layers hide far ones."
    learn: Literal["none"] | tuple[Literal["mask", "shutter", "filters"], ...] = "none"
    "Which are learned: none, or some of mask, shutter and filters."


class SpectralDepthDataSettings(DataSettings):
    """Scenes with depth and patches."""

    train: tuple[str, ...] = ()
    "Rendered scenes, RGB-D scenes, spectral scenes with depth, cubes, or split files (``.txt``) of them."
    from_rgb: bool = False
    "Make up spectra of measured reflectances for RGB-D scenes."
    placed: str | None = None
    "How cubes without depth are put at drawn depths, a kind of ``tmca.data.place_cube``."
    side: int = Field(default=256, ge=16)
    "Scenes from files are averaged down while their shorter side keeps at least this many pixels."
    redrawn: Share = 0.5
    "Share of patches at drawn depths."
    margin: int | None = Field(default=None, ge=0)
    """Pixels of scene around every patch, whose light falls into it; None for as many as light reaches. A patch in the
    dark would show its depth by the blur of its rim."""
    motion: Literal[0] = 0
    batch: Whole = 4


class SpectralDepthOptimiserSettings(OptimiserSettings):
    """Length of the run, learning rates, losses."""

    mask_rate: float = Field(default=0.001, ge=0)
    """Learning rate of heights or coefficients (Adam), in units of the larger of a micrometre and the highest: 0.001
    moves every one by up to a nanometre in a step."""
    loss: Literal["l2", "l1", "charbonnier", "log"] = "l1"
    depth_weight: float = Field(default=0.1, ge=0)
    "Of the error of inverse depth, as a share of the range, beside the loss of the cube."
    likelihood_weight: float = Field(default=0.1, ge=0)
    """Of the same error of the patch likelihood, while masks, shutter or filters learn: a network may be long in seeing
    depth, and codes that learn with it alone lose it meanwhile."""
    likelihood_every: Whole = 3
    "Steps from one of these errors to the next, which then counts as often."

    def code_rates(self) -> dict[str, float]:
        """See ``OptimiserSettings``; shutter and filters have latent values, masks have heights."""
        return {"codes": self.code_rate, "masks": self.mask_rate}


class SpectralDepthTrainSettings(TrainSettings):
    """A whole run of the spectral-depth camera."""

    kind = "spectral-depth"
    camera: SpectralDepthCameraSettings = SpectralDepthCameraSettings()
    decoder: dict[str, Any] = Field(default={"kind": "two-headed"})
    data: SpectralDepthDataSettings = SpectralDepthDataSettings()
    optimiser: SpectralDepthOptimiserSettings = SpectralDepthOptimiserSettings()

    @model_validator(mode="after")
    def _has_levels(self) -> Self:
        if self.camera.levels is not None and self.camera.stroke is None:
            raise ValueError("camera.levels: beside camera.stroke alone")
        if (self.camera.bench or self.camera.stroke) and self.codes.start not in ("random", "one-hot"):
            raise ValueError("camera.bench, camera.stroke: nothing, codes.start brings its own")
        return self

    @model_validator(mode="after")
    def _has_patches(self) -> Self:
        if self.camera.size != (self.data.patch, self.data.patch):
            raise ValueError(f"camera.size {self.camera.size}: the patches', ({self.data.patch}, {self.data.patch})")
        if self.data.bands != type(self.data).model_fields["bands"].default:
            raise ValueError("data.bands: nothing, the bands are those of camera.preset")
        return self


class SpectralDepthTraining(CameraTraining):
    """Scenes are data sets of ``radiance`` (wavelength, y, x) and ``depth`` (y, x) in metres."""

    kind, settings = "spectral-depth", SpectralDepthTrainSettings

    def reader(self, settings: SpectralDepthTrainSettings) -> Load:
        from tmca.data.depth_scenes import load_any_depth_scene

        camera, how = starting_camera(settings), settings.data.model_dump(include={"side", "placed", "from_rgb"})
        how |= {"wavelengths": camera.wavelengths, "near": camera.planes.near, "far": camera.planes.far}
        return lambda name: load_any_depth_scene(name, **how)

    def camera(self, settings: SpectralDepthTrainSettings, first: Callable[[], Any]) -> SpectralDepthCamera:
        """See `CameraTraining`; it sees a patch with its margin."""
        return starting_camera(settings)

    def channels(self, scene: xr.Dataset, camera: SpectralDepthCamera) -> NDArray[np.float32]:
        """See `CameraTraining`: (L + 1, H, W)."""
        return depth_channels(scene, camera)

    def network(self, settings: SpectralDepthTrainSettings, camera: SpectralDepthCamera) -> TwoHeadedUNet:
        return build_depth_network(settings.decoder, camera)

    def needed_prior(
        self, settings: SpectralDepthTrainSettings, camera: SpectralDepthCamera, network: TwoHeadedUNet
    ) -> NeededPrior | None:
        """See `CameraTraining`: for the windows of the network and of codes that learn from the likelihood."""
        learns = bool(camera.learnable)
        if network.start != "likelihood" and not (learns and settings.optimiser.likelihood_weight):
            return None
        window = max(network.window, SIDE, camera.tile_size) if learns else network.window
        return NeededPrior("gaussian", needed_block(window, camera.bench.window), block_of(camera, window=window))

    def validation(self, name: str, channels: NDArray[np.float32], camera: SpectralDepthCamera) -> list[Tensor]:
        """See `CameraTraining`: crops of the camera's size, spread over the scene."""
        (height, width), side = channels.shape[1:], camera.size[0]
        if min(height, width) < side:
            wanted = f"at least {side}×{side}, a patch and its margin, to validate on"
            raise DataError(name, f"{height}×{width} pixels", wanted, "use smaller patches or name another scene")
        shares = [(place + 0.5) / _CROPS for place in range(_CROPS)]
        places = [(round((height - side) * y), round((width - side) * x)) for y in shares for x in shares]
        return [torch.from_numpy(channels[:, y : y + side, x : x + side].copy()) for y, x in places]

    def source(self, settings: Any, store: CubeStore, camera: SpectralDepthCamera) -> PatchSource:
        """See `CameraTraining`; patches have a margin, and depth."""
        data = settings.data
        return PatchSource(store, camera.size[0], settings.seed, data.brightness, data.tint, redrawn=data.redrawn)

    def build_system(self, settings: Any, *given: Any, **how: Any) -> DepthSystem:
        """See `CameraTraining`; captures have no margin."""
        weights = settings.optimiser.model_dump(include={"depth_weight", "likelihood_weight", "likelihood_every"})
        simulated = isinstance(settings, SpectralDepthTrainSettings)
        margin = (given[0].size[0] - settings.data.patch) // 2 if simulated else 0
        return DepthSystem(*given, margin=margin, **weights, **how)

    def check(self, settings: SpectralDepthTrainSettings, weights: Weights) -> None:
        """See `CameraTraining`.

        Warns:
            StrayLight, Undersampled: learned masks send light beside their windows, or are steeper than their pixels.
        """
        if "mask" in settings.camera.learn:
            check_mask(weights.camera.point_spread)

    def truth(self, path: str, camera: SpectralDepthCamera, colours: bool) -> xr.Dataset:
        from tmca.data.depth_scenes import load_spectral_depth

        near, far = camera.planes.near, camera.planes.far
        scene = load_spectral_depth(path, camera.wavelengths, near=near, far=far, fitted=False)
        metres = scene["depth"].values
        if not camera.planes.within(torch.from_numpy(np.array(metres))).any():
            found = f"depths of {np.nanmin(metres):.3g} to {np.nanmax(metres):.3g} m"
            wanted = f"some of the camera's {near:g} to {far:g} m"
            raise DataError(path, found, wanted, "capture nearer or farther scenes")
        return scene

    def exact(self, batch: Tensor, camera: SpectralDepthCamera) -> Tensor:
        return camera.A(batch[:, :-1], camera.planes.depth_of(batch[:, -1:]))

    def decode(
        self, network: TwoHeadedUNet, prior: Any, values: Tensor, camera: SpectralDepthCamera
    ) -> NDArray[np.float32]:
        raw = TwoHeadedNetwork(network, camera, prior)(values)
        return np.concatenate((raw.values.numpy(), camera.planes.share_of(raw.depth).numpy()), axis=1)

    def figure(
        self, batches: Mapping[str, NDArray[np.float32]], truth: NDArray[np.float32], camera: SpectralDepthCamera
    ) -> Figure:
        from tmca.plots.depth import before_after

        def parts(batch: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
            return batch[0, :-1], camera.planes.depth_of(torch.from_numpy(batch[0, -1])).numpy()

        pairs = {name: parts(batch) for name, batch in batches.items()}
        return before_after(pairs, parts(truth), list(camera.wavelengths), (camera.planes.near, camera.planes.far))


def depth_channels(scene: xr.Dataset, camera: SpectralDepthCamera) -> NDArray[np.float32]:
    """(L + 1, H, W): cube, and inverse depth as a share of the range, NaN where it is unknown or outside."""
    depth, planes = torch.from_numpy(np.array(scene["depth"].values, dtype=np.float64)), camera.planes
    place = torch.where(planes.within(depth), planes.share_of(depth), torch.full_like(depth, torch.nan))
    return np.concatenate((scene["radiance"].values, place.numpy()[None])).astype(np.float32)
