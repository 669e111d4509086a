"""Trained two-headed networks with the spectral-depth camera that they belong to."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from tmca.cameras import SpectralDepthCamera
from tmca.decoders.decoding import Progress
from tmca.decoders.networks.network import TILE, seen_by_tile
from tmca.decoders.networks.two_headed import DepthEstimate, TwoHeadedUNet, camera_sizes, first_likelihood, first_stage
from tmca.decoders.networks.weights_file import fill_network, read_weights, write_weights
from tmca.decoders.patch_based.depth_likelihood import DepthDecoded
from tmca.errors import DataError, SettingError
from tmca.optics import PhaseMaskBench, Stroke, changed_bench, family_parameters, restored_maps
from tmca.priors import GaussianPrior, block_of, find_prior

_FIRST = 0.8
"""Share of the time that the first stage takes, as a rule."""
_CODES, _OF_FAMILY = ("heights", "shutter", "filters", "cells", "response"), ("coefficients", "noll", "radii")
_NO_MATTER = ("size", "bands", "stroke", *_OF_FAMILY)
"""What a snapshot's camera may have otherwise."""


@dataclass
class DepthWeights:
    """A trained two-headed network with its camera.

    Args:
        network: decoder.
        camera: it was trained for, of any size.
        prior: of the first stage: ``"rendered"``, a file beside the weights, or ``""`` where none is needed.
        card: how it was trained and how good it is: JSON values.
        path: file it came from.
    """

    network: TwoHeadedUNet
    camera: SpectralDepthCamera
    prior: str = ""
    card: dict[str, Any] = field(default_factory=dict)
    path: Path | None = None

    def decoder(self, camera: SpectralDepthCamera) -> TwoHeadedDecoder:
        """For snapshots of a camera with these codes.

        Raises:
            SettingError, DataError: a camera of other sizes, or a prior that is gone.
        """
        return TwoHeadedDecoder(self.network, camera, self.load_prior())

    def same_codes(self, camera: SpectralDepthCamera) -> bool:
        """Whether a camera shows the masks, shutter and filters that the network was trained for."""
        return not {*_CODES} & {*self.differences(camera)}

    def differences(self, camera: SpectralDepthCamera) -> list[str]:
        """What a camera has otherwise than the one that the network was trained for, size, stroke and noise apart."""
        own, other = ({**_tensors(one), **_settings(one)} for one in (self.camera, camera))
        return [name for name, value in own.items() if name not in _NO_MATTER and not _alike(value, other[name])]

    def sized_camera(self, size: tuple[int, int], **changes: Any) -> SpectralDepthCamera:
        """The camera with these codes for scenes of (H, W); ``changes`` are arguments such as ``sensor``."""
        return _restored(_tensors(self.camera), _settings(self.camera) | {"size": size}, **changes)

    def load_prior(self) -> GaussianPrior | None:
        """The prior of the first stage.

        Raises:
            DataError: the file is gone, or holds no prior.
            SettingError: one of another kind.
        """
        if not self.prior:
            return None
        beside = None if self.prior == "rendered" else (self.path or Path()).parent / self.prior
        return find_prior(self.camera, beside, block=block_of(self.camera, window=self.network.window))

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write the file, whole or not at all; the network in half precision.

        Raises:
            OutputError: the file exists, or cannot be written.
        """
        about = {
            "kind": self.network.kind, "settings": self.network.settings, "camera": _settings(self.camera),
            "prior": self.prior, "card": self.card, "application": SpectralDepthCamera.kind,
        }  # fmt: skip
        return write_weights(path, self.network, _tensors(self.camera), about, overwrite=overwrite)

    @classmethod
    def load(cls, path: str | Path) -> DepthWeights:
        """Read what ``save`` wrote: a file, or the folder of a run.

        Raises:
            DataError: no such file, weights of another camera, or tensors that do not fit the network.
        """
        path, about, tensors = read_weights(path)
        if about.get("application") != SpectralDepthCamera.kind:
            found = f"weights of a {about.get('application', 'spectral')} camera"
            raise DataError(path, found, "those of a spectral-depth camera", "name other weights")
        parts = (*_CODES, *(name for name in _OF_FAMILY if name in tensors))
        camera = _restored({name: tensors[name] for name in parts}, about["camera"])
        network = TwoHeadedUNet(**about["settings"])
        fill_network(network, tensors, path)
        return cls(network.eval(), camera, about["prior"], about["card"], path)


class TwoHeadedDecoder:
    """A two-headed network with its first stage: ``decoder(snapshot) -> DepthDecoded``, any height and width.

    Args:
        network: trained.
        camera: that took the snapshots; it says their size, codes and noise.
        prior: of the first stage; None where the network needs none.
        tile: side in pixels of what passes the network at once; the estimate is the same to rounding.

    Raises:
        SettingError: a network of other sizes than the camera's, no prior for a network that needs one, or tiles of
            less than a pixel.
    """

    def __init__(
        self, network: TwoHeadedUNet, camera: SpectralDepthCamera, prior: GaussianPrior | None = None, tile: int = TILE
    ) -> None:
        if tile < 1:
            raise SettingError("tile", str(tile), "at least 1 pixel")
        if network.start == "likelihood" and prior is None:
            raise SettingError("prior", "none", "one for a network that starts from the likelihood")
        check_fits(network, camera)
        self.network, self.camera, self.tile = network.eval(), camera, tile
        wants = prior is not None and network.start == "likelihood"
        self.likelihood = first_likelihood(network, prior, camera) if wants and prior is not None else None

    @torch.no_grad()
    def __call__(self, snapshot: Tensor, progress: Progress | None = None) -> DepthDecoded:
        """Decode snapshots (B, C, H, W); ``progress`` is told the share that is done."""
        told = progress or (lambda share: None)
        start, begun = None, 0.0
        if self.likelihood is not None:
            start, begun = first_stage(self.likelihood, snapshot, lambda share: told(_FIRST * share)), _FIRST
        height, width = (int(side) for side in snapshot.shape[-2:])
        places = list(product(range(0, height, self.tile), range(0, width, self.tile)))
        cube = snapshot.new_empty(len(snapshot), self.network.bands, height, width)
        logits = snapshot.new_empty(len(snapshot), self.network.planes, height, width)
        for done, (top, left) in enumerate(places, start=1):
            rows, columns = slice(top, min(top + self.tile, height)), slice(left, min(left + self.tile, width))
            found = self._part(snapshot, start, rows, columns)
            cube[..., rows, columns], logits[..., rows, columns] = found.cube, found.logits
            told(begun + (1 - begun) * done / len(places))
        return DepthEstimate(cube, logits).decoded(self.camera.planes)

    def _part(self, snapshot: Tensor, start: Tensor | None, rows: slice, columns: slice) -> DepthEstimate:
        """One tile of the estimate, from a window with a margin as wide as the network sees."""
        period = self.camera.tile_size  # the network lays the tile of codes from the window's first pixel on
        first, last = seen_by_tile(self.network, rows.start, rows.stop, snapshot.shape[-2], period)
        near, far = seen_by_tile(self.network, columns.start, columns.stop, snapshot.shape[-1], period)
        window = (..., slice(first, last), slice(near, far))
        own = None if start is None else start[window]
        found = self.network(snapshot[window], self.camera, self.camera.noise, own)
        inner = (..., slice(rows.start - first, rows.stop - first), slice(columns.start - near, columns.stop - near))
        return DepthEstimate(found.cube[inner], found.logits[inner])


def check_fits(network: TwoHeadedUNet, camera: SpectralDepthCamera) -> None:
    """Raises SettingError unless a network has a camera's bands, planes, channels, slots and filters."""
    for name, wanted in camera_sizes(camera).items():
        if network.settings[name] != wanted:
            found = f"a network with {name} = {network.settings[name]}"
            raise SettingError("weights", found, f"{wanted}, as the snapshot's camera", "name other weights")


def _alike(one: Any, other: Any) -> bool:
    """Whether two parts of a camera are the same; heights, in metres, to a nanometre."""
    if isinstance(one, Tensor):
        return one.shape == other.shape and torch.allclose(one.float(), other.float(), rtol=1e-5, atol=1e-9)
    return bool(one == other)


def _tensors(camera: SpectralDepthCamera) -> dict[str, Tensor]:
    """What a camera shows, one tile of it."""
    with torch.no_grad():
        codes = {
            "heights": camera.spread.heights(), "shutter": camera.tile()[1], "filters": camera.filters.filters,
            "cells": camera.filters.cells(), "response": camera.response,
            **family_parameters(camera.spread.heights),
        }  # fmt: skip
    return {name: value.clone() for name, value in codes.items()}


def _settings(camera: SpectralDepthCamera) -> dict[str, Any]:
    """The rest of a camera, JSON values."""
    return {
        "bands": list(camera.wavelengths), "size": list(camera.size), "slots": camera.slots,
        "depth": [camera.planes.near, camera.planes.far], "planes": camera.planes.count,
        "bench": asdict(camera.bench), "period": camera.period, "exposure": camera.exposure,
        "energy": camera.spread.energy, "image_formation": camera.image_formation,
        "stroke": None if camera.spread.heights.stroke is None else asdict(camera.spread.heights.stroke),
    }  # fmt: skip


def _restored(codes: dict[str, Tensor], settings: dict[str, Any], **changes: Any) -> SpectralDepthCamera:
    given = {**settings, **changes}
    bench, said = changed_bench(PhaseMaskBench(), given.pop("bench")), given.pop("stroke", None)
    maps = restored_maps(codes["heights"], codes, None if said is None else Stroke(**said))
    return SpectralDepthCamera(
        **{**given, "size": tuple(given["size"]), "depth": tuple(given["depth"])}, bench=bench, mask=maps,
        shutter=codes["shutter"], filters=codes["filters"], cells=codes["cells"].long(), channels=codes["response"],
    )  # fmt: skip
