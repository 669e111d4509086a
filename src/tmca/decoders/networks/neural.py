"""A trained network as a decoder, and its file: one safetensors with everything needed to use it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any, cast

import torch
from torch import Tensor

from tmca.cameras import CodedCamera, LightFieldCamera, SpectralCamera
from tmca.decoders.networks.network import Network, build_network, seen_by_tile
from tmca.decoders.networks.start import first_estimate
from tmca.decoders.networks.weights_file import fill_network, read_weights, write_weights
from tmca.errors import DataError, SettingError, ShapeError
from tmca.operators import TapOperator
from tmca.priors import GaussianMixturePrior, GaussianPrior, find_prior
from tmca.sensor import Noise

_FIRST = 0.9  # share of the time that the first estimate takes, as a rule


@dataclass
class Weights:
    """A trained network with the codes it was trained for.

    Args:
        network: decoder.
        wavelengths: of its bands, metres; none for views.
        aperture: (K, h, w) codes, one tile of them.
        shutter: (K, h, w') codes.
        camera: settings of the camera that are no codes (``size``, ``period``, ``exposure``, ``dispersion``, …).
        prior: ``"rendered"``, a file beside the weights, or ``""`` where none is needed.
        card: how it was trained and how good it is: JSON values.
        path: file it came from.
        application: which camera, ``"spectral"`` or ``"light-field"``.
    """

    network: Network
    wavelengths: tuple[float, ...]
    aperture: Tensor
    shutter: Tensor
    camera: dict[str, Any]
    prior: str = ""
    card: dict[str, Any] = field(default_factory=dict)
    path: Path | None = None
    application: str = "spectral"

    def coded_camera(self, size: tuple[int, int] | None = None, **changes: Any) -> CodedCamera:
        """The camera with these codes, whichever it is."""
        if self.application == "light-field":
            return self.light_field_camera(size, **changes)
        return self.spectral_camera(size, **changes)

    def light_field_camera(self, size: tuple[int, int] | None = None, **changes: Any) -> LightFieldCamera:
        """The light-field camera with these codes; tiled codes fit any ``size`` (H, W).

        Raises:
            SettingError: weights of another camera.
            ShapeError: codes without a period have another size.
        """
        self.check("light-field")
        settings = self._settings(size, changes)
        return LightFieldCamera(slots=len(self.aperture), aperture=self.aperture, shutter=self.shutter, **settings)

    def check(self, wanted: str) -> None:
        """Raises SettingError unless they are those of this camera."""
        if self.application != wanted:
            found = f"those of a {self.application} camera"
            raise SettingError("weights", found, f"those of a {wanted} camera", "name other weights")

    def spectral_camera(self, size: tuple[int, int] | None = None, **changes: Any) -> SpectralCamera:
        """The spectral camera with these codes; tiled codes fit any ``size`` (H, W).

        Raises:
            SettingError: weights of another camera.
            ShapeError: codes without a period have another size.
        """
        self.check("spectral")
        settings = self._settings(size, changes)
        return SpectralCamera(
            bands=self.wavelengths, slots=len(self.aperture), aperture=self.aperture, shutter=self.shutter, **settings
        )

    def _settings(self, size: tuple[int, int] | None, changes: dict[str, Any]) -> dict[str, Any]:
        settings = {**self.camera, **changes}
        own = tuple(settings["size"])
        if size is None or tuple(size) == own:
            return settings
        if settings.get("period") is None:
            found = f"codes of {own[0]}×{own[1]} pixels that do not repeat"
            remedy = "crop the scene, or train with camera.size, or tiled codes (camera.period)"
            raise ShapeError("weights", found, f"{size[0]}×{size[1]} as the scene", remedy)
        return settings | {"size": size}

    def load_prior(self) -> GaussianPrior | GaussianMixturePrior | None:
        """The prior that the network starts from.

        Raises:
            DataError: the file is gone.
            SettingError: it holds a prior of another kind.
        """
        if not self.prior:
            return None
        kind = "mixture" if self.network.start == "mixture" else "gaussian"
        beside = None if self.prior == "rendered" else (self.path or Path()).parent / self.prior
        return cast(GaussianPrior | GaussianMixturePrior, find_prior(self.coded_camera(), beside, kind))

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write the file, whole or not at all; the network in half precision.

        Raises:
            OutputError: the file exists, or cannot be written.
        """
        codes = {name: _compact(getattr(self, name)) for name in ("aperture", "shutter")}
        about = {
            "kind": self.network.kind, "settings": self.network.settings, "wavelengths": list(self.wavelengths),
            "camera": self.camera, "prior": self.prior, "card": self.card, "application": self.application,
        }  # fmt: skip
        return write_weights(path, self.network, codes, about, overwrite=overwrite)

    @classmethod
    def load(cls, path: str | Path) -> Weights:
        """Read what ``save`` wrote: a file, or the folder of a run.

        Raises:
            DataError: no such file, no weights of a camera in it, or tensors that do not fit the network.
        """
        path, about, tensors = read_weights(path)
        application = about.get("application", "spectral")
        if application not in (SpectralCamera.kind, LightFieldCamera.kind):
            found = f"weights of a {application} camera"
            raise DataError(path, found, "those of a spectral or light-field camera", "name other weights")
        network = build_network(about["kind"], **about["settings"])
        fill_network(network, tensors, path)
        planes = (tensors["aperture"].float(), tensors["shutter"].float())
        camera = {**about["camera"], "size": tuple(about["camera"]["size"])}
        return cls(
            network.eval(), tuple(about["wavelengths"]), *planes, camera, about["prior"], about["card"], path,
            application,
        )  # fmt: skip


class NeuralDecoder:
    """A network with its prior: ``decoder(snapshot, operator, noise) -> estimate``, any height and width.

    Args:
        network: trained.
        prior: of the first estimate; None where it needs none.
        tile: rows of the scene that pass the network at once, no more than its own ``tile``, and as many columns where
            the optics mix no columns; None for all. The estimate is the same to rounding.

    Raises:
        SettingError: tiles of less than one row.
    """

    def __init__(
        self, network: Network, prior: GaussianPrior | GaussianMixturePrior | None, tile: int | None = 512
    ) -> None:
        if tile is not None and tile < 1:
            raise SettingError("tile", str(tile), "at least 1 row, or None for all")
        self.network, self.prior, self.tile = network, prior, tile

    @torch.no_grad()
    def __call__(
        self,
        snapshot: Tensor,
        operator: TapOperator,
        noise: Noise,
        progress: Callable[[float], None] | None = None,
    ) -> Tensor:
        """(B, 1, H, W') → (B, L, H, W).

        Args:
            snapshot: in snapshot units.
            operator: that took it.
            noise: of the sensor.
            progress: told the share that is done.
        """
        told = progress or (lambda share: None)
        start = first_estimate(
            self.network.start, snapshot, operator, noise, self.prior, progress=lambda share: told(_FIRST * share)
        )
        height, width = start.shape[2:]
        side = max(height, width) if self.tile is None else min(self.tile, self.network.tile)
        across = side if _keeps_columns(operator) else width
        lefts, tops = range(0, width, across), range(0, height, side)
        parts = []
        for done, (top, left) in enumerate(product(tops, lefts), start=1):
            place = (top, min(top + side, height), left, min(left + across, width))
            alone = zip(snapshot.split(1), start.split(1), strict=True)  # a batch would take as many times the memory
            parts.append(torch.cat([self._part(one, operator, noise, first, place) for one, first in alone]))
            told(_FIRST + (1 - _FIRST) * done / (len(tops) * len(lefts)))
        rows = [torch.cat(parts[i : i + len(lefts)], dim=3) for i in range(0, len(parts), len(lefts))]
        return torch.cat(rows, dim=2)

    def _part(
        self, snapshot: Tensor, operator: TapOperator, noise: Noise, start: Tensor, place: tuple[int, int, int, int]
    ) -> Tensor:
        """One tile (top, bottom, left, right) of the estimate, with a margin as wide as the network sees."""
        first, last = seen_by_tile(self.network, *place[:2], start.shape[2])
        near, far = seen_by_tile(self.network, *place[2:], start.shape[3])
        part = TapOperator(operator.taps.window(first, near, last - first, far - near))
        light = snapshot[:, :, first:last, near : near + part.snapshot_shape[2]]
        found = self.network(light, part, noise, start[:, :, first:last, near:far])
        return found[:, :, place[0] - first : place[1] - first, place[2] - near : place[3] - near]


def _compact(codes: Tensor) -> Tensor:
    """Binary codes as bytes, grey ones (a measured mask) as they are."""
    return codes.float() if bool(((codes != 0) & (codes != 1)).any()) else codes.to(torch.uint8)


def _keeps_columns(operator: TapOperator) -> bool:
    """Whether the light of every scene column falls on the sensor column of its own."""
    taps = operator.taps
    return not any(taps.offsets) and taps.snapshot_width == taps.scene_shape[2]


def same_bands(one: Sequence[float], other: Sequence[float]) -> bool:
    """Whether two lists of wavelengths in metres agree to a nanometre."""
    return len(one) == len(other) and all(abs(a - b) <= 1e-9 for a, b in zip(one, other, strict=True))
