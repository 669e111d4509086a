"""Two-headed U-Nets for spectrum and depth: from the snapshot alone, or from what the patch likelihood makes of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from tmca.cameras import SpectralDepthCamera
from tmca.decoders.decoder import Progress
from tmca.decoders.likelihood import (
    REACH,
    TEMPERATURE,
    DepthPosterior,
    DepthRaw,
    PatchLikelihood,
    check_window,
)
from tmca.decoders.nets.network import LEVEL_REACH, RESIDUAL, local_level, noise_maps, settings_of
from tmca.decoders.nets.unet import ConvolutionalBody
from tmca.errors import SettingError, check_choice, check_shape
from tmca.operators.window_moments import CONTAMINATION, WINDOW
from tmca.optics import DepthPlanes
from tmca.priors import GaussianPrior
from tmca.sensor import Noise

DEPTH_STARTS = ("snapshot", "likelihood")
_LEAST_LIKELY = -10.0


@dataclass(frozen=True)
class DepthEstimate:
    """What a two-headed network makes of snapshots.

    Args:
        cube: (B, L, H, W).
        logits: (B, D, H, W) log-probability of every plane, from far to near, up to a constant.
    """

    cube: Tensor
    logits: Tensor

    def place(self) -> Tensor:
        """(B, 1, H, W) inverse depth as a share of the range, 0 at the farthest plane: mean over planes."""
        count = self.logits.shape[1]
        return (self.logits.softmax(1) * _places(count, self.logits)[:, None, None]).sum(1, keepdim=True)

    def expected_error(self, place: Tensor) -> Tensor:
        """(B, 1, H, W) mean absolute error of a plane that is drawn, against a true place (B, 1, H, W)."""
        away = (_places(self.logits.shape[1], self.logits)[:, None, None] - place).abs()
        return (self.logits.softmax(1) * away).sum(1, keepdim=True)

    def surprise(self, place: Tensor) -> Tensor:
        """(B, 1, H, W) minus the log-probability of the planes around a true place (B, 1, H, W), in nats.

        Between two planes both count by their nearness. Unlike the error of the mean it has a slope where the network
        is sure of the wrong plane.
        """
        count = self.logits.shape[1]
        true = (place * max(1, count - 1)).clamp(0, count - 1)
        index = torch.arange(count, device=place.device)[:, None, None]
        nearness = (1 - (index - true).abs()).clamp_min(0)
        return -(nearness * self.logits.log_softmax(1)).sum(1, keepdim=True)

    def decoded(self, planes: DepthPlanes) -> DepthRaw:
        """In metres: the median, and the probability of its plane and its neighbours, as of the patch likelihood."""
        depth = DepthPosterior.of(self.logits, planes)
        cube = self.cube.clamp_min(0)
        logs = self.logits.log_softmax(1)
        return DepthRaw(cube, None, depth.metres, depth.confidence, logs, depth_deviation=depth.deviation)


def _places(count: int, like: Tensor) -> Tensor:
    return torch.linspace(0, 1, count, device=like.device) if count > 1 else torch.full((1,), 0.5, device=like.device)


class TwoHeadedBody(nn.Module):
    """A `ConvolutionalBody` with a second way up: (B, inputs, H, W) → two pictures from one encoder.

    Args:
        inputs: channels.
        outputs: channels of the first and the second picture.
        widths, blocks, gather: see `ConvolutionalBody`.
    """

    def __init__(
        self, inputs: int, outputs: tuple[int, int], widths: tuple[int, ...], blocks: int = 2, gather: int = 2
    ) -> None:
        super().__init__()
        self.first = ConvolutionalBody(inputs, outputs[0], widths, blocks, gather)
        self.second = ConvolutionalBody(inputs, outputs[1], widths, blocks, gather)
        del self.second.enter, self.second.descent, self.second.down
        self.reach, self.multiple = self.first.reach, self.first.multiple

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        coarse, finer_levels = self.first.descend(x)
        size = (int(x.shape[2]), int(x.shape[3]))
        return self.first.ascend(coarse, finer_levels, size), self.second.ascend(coarse, finer_levels, size)


class TwoHeadedUNet(nn.Module):
    """A U-Net with one encoder and two heads, spectrum and depth (thesis 5.2).

    It sees the snapshot relative to its local brightness, the shutter and the filter over every pixel, and the noise.
    With ``start="likelihood"`` it also sees a physics-based first stage: the log-probability of every depth plane under
    the exact model and the linear MMSE cube over the likely ones (`PatchLikelihood`), and learns what to add.

    Args:
        bands: L.
        planes: D.
        channels: C of the sensor.
        slots: K.
        filters: R.
        start: one of ``DEPTH_STARTS``.
        window: of the patch likelihood, pixels; ``temperature``, ``reach`` and ``contamination`` are its too.
        widths: channels of each level, finest first.
        blocks: residual blocks on each level.
        gather: pixels gathered along each axis at the entrance.

    Raises:
        SettingError: unknown start, or sizes below 1.
    """

    kind = "two-headed"

    def __init__(
        self,
        *,
        bands: int,
        planes: int,
        channels: int,
        slots: int,
        filters: int,
        start: str = "likelihood",
        window: int = WINDOW,
        temperature: float = TEMPERATURE,
        reach: int = REACH,
        contamination: float = CONTAMINATION,
        widths: Sequence[int] = (48, 64, 96),
        blocks: int = 2,
        gather: int = 2,
    ) -> None:
        settings = settings_of(locals())
        super().__init__()
        check_choice("start", start, DEPTH_STARTS)
        self.settings, self.bands, self.planes, self.start, self.window = settings, bands, planes, start, window
        first = bands + planes if start == "likelihood" else 0
        inputs = channels + slots + filters + 2 + first
        self.body = TwoHeadedBody(inputs, (bands, planes), tuple(widths), blocks, gather)
        self.trust = nn.Parameter(torch.tensor(1.0)) if first else None
        self.reach, self.multiple = self.body.reach + LEVEL_REACH, self.body.multiple

    def forward(
        self, snapshot: Tensor, camera: SpectralDepthCamera, noise: Noise, start: Tensor | None = None
    ) -> DepthEstimate:
        """Spectrum and depth of snapshots (B, C, H, W).

        Args:
            snapshot: in snapshot units, its first pixel the first of the tile.
            camera: whose shutter and filters took it; any size.
            noise: of the sensor.
            start: (B, L + D, H, W) of ``first_stage``, where the network wants one.

        Raises:
            ShapeError: a first stage of another shape.
        """
        height, width = snapshot.shape[-2:]
        white = float(white_level(camera))
        level = local_level(snapshot) / white
        maps = _code_maps(camera, (height, width)).expand(len(snapshot), -1, -1, -1)
        seen = [snapshot / (level * white), maps, noise_maps(noise, level * white)]
        if start is None:
            logits, cube = snapshot.new_zeros(1), snapshot.new_zeros(1)
        else:
            check_shape("first stage", start, (len(snapshot), self.bands + self.planes, height, width))
            cube, logits = start[:, : self.bands], start[:, self.bands :]
            seen += [cube / level, logits / -_LEAST_LIKELY]
        colours, depths = self.body(torch.cat(seen, 1))
        scale = RESIDUAL if start is not None else 1.0
        trusted = logits if self.trust is None else self.trust * logits
        return DepthEstimate(cube + scale * level * colours.float(), trusted + depths.float())


def first_likelihood(network: TwoHeadedUNet, prior: GaussianPrior, camera: SpectralDepthCamera) -> PatchLikelihood:
    """The patch likelihood that a network starts from, as it was when it was trained.

    Raises:
        SettingError, ShapeError: see `PatchLikelihood`.
    """
    settings = {name: network.settings[name] for name in ("window", "temperature", "reach", "contamination")}
    check_window(settings["window"], camera, "window of the weights", "name weights that were trained for such codes")
    return PatchLikelihood(prior, camera, **settings)


@torch.no_grad()
def first_stage(likelihood: PatchLikelihood, snapshot: Tensor, progress: Progress | None = None) -> Tensor:
    """(B, L + D, H, W) LMMSE cube and log-probability of every plane, the likeliest at zero."""
    first = likelihood(snapshot, progress)
    assert first.planes is not None
    first.planes -= first.planes.amax(1, keepdim=True)  # in place: of whole frames every copy counts
    return torch.cat((first.values, first.planes.clamp_min_(_LEAST_LIKELY)), 1).to(snapshot)


@torch.no_grad()
def white_level(camera: SpectralDepthCamera) -> Tensor:
    """Mean level of a white scene behind filters and shutter, over pixels and channels, snapshot units."""
    colour, shutters = camera.tile()
    light = shutters.mean(1) if camera.exposure == "equal" else shutters.sum(1)
    return (colour.sum(1) * light.mean(0)).mean()


def _code_maps(camera: SpectralDepthCamera, size: tuple[int, int]) -> Tensor:
    """(1, K + R, H, W) shutter and share of every filter over every pixel, tile by tile."""
    side = slice(0, camera.tile_size)
    tile = torch.cat((camera.shutter.part(side, side), camera.filters.plane.part(side, side)))
    rows, columns = (-(-length // camera.tile_size) for length in size)
    return tile.repeat(1, rows, columns)[None, :, : size[0], : size[1]]


def camera_sizes(camera: SpectralDepthCamera) -> dict[str, int]:
    """What a network and a camera have to agree on."""
    return {
        "bands": camera.bands, "planes": camera.planes.count, "channels": camera.snapshot_shape[0],
        "slots": getattr(camera.shutter, "slots", camera.slots),
        "filters": len(camera.filters.filters),
    }  # fmt: skip


def check_sizes(network: TwoHeadedUNet, camera: SpectralDepthCamera) -> None:
    """Raises SettingError unless a network has a camera's bands, planes, channels, slots and filters."""
    for name, wanted in camera_sizes(camera).items():
        if network.settings[name] != wanted:
            found = f"a network with {name} = {network.settings[name]}"
            raise SettingError("weights", found, f"{wanted}, as the snapshot's camera", "name other weights")
