"""A camera with other codes in the place of its own, and while one slot of them is shown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor, nn

from tmca.cameras import CodedCamera, PhaseCodes
from tmca.cameras.faulty import FaultyCodes, FaultyShutter
from tmca.errors import DeviceError
from tmca.lab.display.codes import Planes
from tmca.optics import ZernikeHeights
from tmca.optics.zernike import noll

_UNSEEN = 1e-12
"""Share of a slot below which a pattern is not seen: rounding."""


def showing(camera: Any, codes: Planes) -> Any:
    """The camera with the codes of an export in the place of its own.

    Raises:
        DeviceError: codes of another size.
    """
    if isinstance(camera, CodedCamera):
        own = dict(zip(("aperture", "shutter"), camera.codes(), strict=True))
        shown, slots = {name: codes.planes.get(name, plane) for name, plane in own.items()}, camera.slots
        if codes.slots != slots:  # one slot after the other, none of them masked
            shown["shutter"], slots = torch.ones_like(own["shutter"][:1]).expand(codes.slots, -1, -1), codes.slots
        for name, plane in shown.items():
            if plane.shape[1:] != own[name].shape[1:]:
                wanted = f"the camera's {tuple(own[name].shape)}"
                raise DeviceError("simulated bench", f"{name} of {tuple(plane.shape)}", wanted, "export them for it")
        return camera.replace(codes=_Shown(shown["aperture"], shown["shutter"]), slots=slots)
    if codes.modes:
        size, modes = camera.point_spread.heights.size, [noll(int(index)) for index in codes.modes["noll"]]
        heights = ZernikeHeights(codes.modes["coefficients"], modes, size)
        return camera.replace(codes=PhaseCodes(camera.point_spread.behind(heights), camera.shutter))
    return camera


def seen_in_frame(camera: Any, slot: int, settled: bool = False) -> tuple[list[int], Tensor]:
    """Patterns that a frame sees which an ordinary camera takes for one slot, and how long.

    Its shutter is open for all pixels while shutter pattern ``slot`` would be shown: late, row after row, while the
    aperture still turns to its next pattern, as the faults of the camera say.

    Args:
        camera: on its bench.
        slot: of the frame.
        settled: the frame waits for a pattern that stands still.

    Returns:
        Indices of n patterns, and (n, H) shares of a slot for every row of the sensor.
    """
    codes = camera.codes if isinstance(camera, CodedCamera) else camera.shutter
    faults = codes.faults if isinstance(codes, FaultyCodes | FaultyShutter) else None
    if settled or faults is None or not faults.timed:
        return [slot], torch.ones(1, camera.size[0])
    shares = faults.overlap[:, slot].T.float()
    seen = [pattern for pattern, share in enumerate(shares) if float(share.abs().max()) > _UNSEEN] or [slot]
    return seen, shares[seen]


def of_one_slot(camera: Any, seen: Sequence[int], shares: Tensor, share: int) -> Any:
    """The camera in the frame of one slot, the ``share``-th part of an exposure, its shutter open.

    A slot of an equal exposure lasts the K-th part of it: the sensor collects a K-th of the light, and what it reads is
    K-fold, so that snapshots of all slots, masked, average to that of the exposure, shot and read noise as they are.

    Args:
        camera: on its bench.
        seen: patterns that the frame sees.
        shares: (n, H) of a slot that each is seen for, see ``seen_in_frame``.
        share: K of the exposure.
    """
    opened = shares[:, :, None] * len(seen)  # a mean over these patterns is then their sum
    parts: dict[str, Any] = {"sensor": sub_exposed(camera, share), "slots": len(seen), "exposure": "equal"}
    if isinstance(camera, CodedCamera):
        return camera.replace(codes=_Seen(camera.codes, seen, opened), **parts)
    optics = camera.point_spread.behind(_Maps(camera.point_spread.heights, seen))
    return camera.replace(codes=PhaseCodes(optics, _Opened(camera.shutter, opened)), **parts)


class _Shown(nn.Module):
    """Fixed patterns of both planes."""

    learnable = False
    aperture: Tensor
    shutter: Tensor

    def __init__(self, aperture: Tensor, shutter: Tensor) -> None:
        super().__init__()
        self.register_buffer("aperture", aperture)
        self.register_buffer("shutter", shutter)

    def forward(self) -> tuple[Tensor, Tensor]:
        return self.aperture, self.shutter


class _Seen(nn.Module):
    """(aperture, shutter) of some patterns, the shutter open for a share of the time, row by row."""

    learnable = False
    opened: Tensor

    def __init__(self, codes: nn.Module, seen: Sequence[int], opened: Tensor) -> None:
        super().__init__()
        self.codes, self.seen = codes, list(seen)
        self.register_buffer("opened", opened)

    def forward(self) -> tuple[Tensor, Tensor]:
        aperture, shutter = self.codes()
        return aperture[self.seen], self.opened.expand(-1, -1, shutter.shape[2]).to(shutter)


class _Opened(nn.Module):
    """A shutter that is open for a share of the time in the place of a coded one."""

    period = None
    opened: Tensor

    def __init__(self, plane: nn.Module, opened: Tensor) -> None:
        super().__init__()
        self.plane = plane
        self.register_buffer("opened", opened)

    def forward(self) -> Tensor:
        known = self.plane()
        return self.opened.expand(-1, -1, known.shape[2]).to(known)

    def part(self, rows: slice, columns: slice) -> Tensor:
        return self()[:, rows, columns]


class _Maps(nn.Module):
    """The height maps of some slots."""

    def __init__(self, heights: nn.Module, seen: Sequence[int]) -> None:
        super().__init__()
        self.heights, self.seen, self.size = heights, list(seen), heights.size

    def forward(self) -> Tensor:
        found: Tensor = self.heights()[self.seen]
        return found


def sub_exposed(camera: Any, share: int) -> nn.Module:
    """The camera's sensor in one of the ``share`` exposures that emulate a coded one."""
    return camera.sensor if camera.exposure == "per-slot" else _SubExposure(camera.sensor, share)


class _SubExposure(nn.Module):
    """A sensor that is exposed for a share of the time and read with as much more gain."""

    def __init__(self, sensor: nn.Module, share: int) -> None:
        super().__init__()
        self.sensor, self.share = sensor, share

    def forward(self, irradiance: Tensor, full_scale: float, generator: Any = None, exposures: int = 1) -> Tensor:
        found: Tensor = self.sensor(irradiance / self.share, full_scale, generator, exposures)
        return found * self.share
