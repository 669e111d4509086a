"""Trained networks with the camera that they belong to, and their file: one safetensors with everything to use them."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, cast
from warnings import warn

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

import tmca
from tmca.cameras import LightFieldCamera, SpectralCamera, SpectralDepthCamera
from tmca.decoders.nets.build import restore_network
from tmca.decoders.nets.two_headed import TwoHeadedUNet, check_sizes
from tmca.errors import DataError, SettingError, ShapeError
from tmca.optics import PhaseMaskBench, Stroke, changed_bench, family_parameters, restored_maps
from tmca.priors import GaussianMixturePrior, GaussianPrior, block_of, find_prior, load_prior

FORMAT = "tmca weights 1"
SHIPPED = ("static", "multiplexed")
FOLDER = Path(tmca.__file__).parent / "weights"
RENDERED = "rendered"
"""Name of the prior of the rendered scenes, which is in no file beside the weights."""
_OPTICS = {"spectral": ("disperser", "exposure", "dispersion"), "light-field": ("shear", "exposure")}
"""What a network of a collapsed camera cannot be told."""
_SHOWN = ("heights", "shutter", "filters", "cells", "response")
_NO_MATTER = ("size", "bands", "stroke", "coefficients", "noll", "radii")
"""What the camera behind a two-headed network may have otherwise."""


class OtherCodes(UserWarning):
    """A network that is not told the codes, behind other codes than it was trained for."""


@dataclass
class Weights:
    """A trained network with the camera that it was trained for.

    Args:
        network: a `Network`, or a `TwoHeadedUNet` of spectrum and depth.
        kind: of the camera.
        codes: tensors of the camera: ``aperture`` and ``shutter``, or ``heights``, ``shutter``, ``filters``, …; one
            tile of codes that repeat.
        settings: of the camera that are no tensors (``bands``, ``size``, ``period``, ``exposure``, …), JSON values.
        prior: ``"rendered"``, a file beside the weights, or ``""`` where none is needed.
        card: how it was trained and how good it is: JSON values.
        path: file it came from.
    """

    network: Any
    kind: str
    codes: dict[str, Tensor]
    settings: dict[str, Any]
    prior: str = ""
    card: dict[str, Any] = field(default_factory=dict)
    path: Path | None = None

    @classmethod
    def of(cls, network: Any, camera: Any, prior: str = "", card: dict[str, Any] | None = None) -> Weights:
        """A network with its camera as it is now; codes that repeat as one tile."""
        return cls(network, camera.kind, *_parts(camera, tiled=True), prior, card or {})

    def behind(self, camera: Any) -> Weights:
        """The same network with another camera than it was trained for, whose codes do not repeat."""
        codes, settings = _parts(camera, tiled=False)
        return replace(self, codes=codes, settings=settings)

    @property
    def slots(self) -> int:
        """K."""
        return len(self.codes["shutter"])

    @property
    def aperture(self) -> Tensor:
        """(K, h, w) of a collapsed camera."""
        return self.codes["aperture"]

    @property
    def shutter(self) -> Tensor:
        """(K, h, w')."""
        return self.codes["shutter"]

    @property
    def wavelengths(self) -> tuple[float, ...]:
        """Of the bands, metres; none for views."""
        return tuple(self.settings.get("bands", ()))

    @property
    def camera(self) -> Any:
        """The camera of the training, of the size that it had there."""
        return self.camera_for()

    def camera_for(self, size: tuple[int, int] | None = None, **changes: Any) -> Any:
        """The camera with these codes for scenes of (H, W); ``changes`` are arguments such as ``sensor``.

        Raises:
            ShapeError: codes without a period have another size.
        """
        settings = {**self.settings, **changes}
        trained = tuple(self.settings["size"])
        if size is not None and tuple(size) != trained and settings.get("period") is None:
            found = f"codes of {trained[0]}×{trained[1]} pixels that do not repeat"
            remedy = "crop the scene, or train with camera.size, or tiled codes (camera.period)"
            raise ShapeError("weights", found, f"{size[0]}×{size[1]} as the scene", remedy)
        settings["size"] = trained if size is None else tuple(size)
        return _CAMERAS[self.kind](self.codes, settings)

    def check_kind(self, kind: str) -> None:
        """Raises SettingError unless they are those of this kind of camera."""
        if self.kind != kind:
            wanted = f"those of a {kind} camera"
            raise SettingError("weights", f"those of a {self.kind} camera", wanted, "name other weights")

    def check(self, camera: Any) -> None:
        """Whether the network decodes snapshots of a camera.

        Raises:
            SettingError, ShapeError: another kind of camera, other bands, views or optics.

        Warns:
            OtherCodes: codes that it was not trained for and is not told.
        """
        self.check_kind(camera.kind)
        if isinstance(self.network, TwoHeadedUNet):
            check_sizes(self.network, camera)
        if self.wavelengths and not same_bands(self.wavelengths, camera.wavelengths):
            found, wanted = (_bands(one) for one in (self.wavelengths, camera.wavelengths))
            raise SettingError("weights", found, f"the camera's {wanted}", "train a network at the camera's bands")
        trained = self.camera
        if self.kind == "light-field" and trained.views != camera.views:
            raise ShapeError("weights", f"{trained.views[0]}×{trained.views[1]} views", f"the camera's {camera.views}")
        for name in _OPTICS.get(self.kind, ()):
            one, other = getattr(trained, name), getattr(camera, name)
            if one != other:
                shown = [getattr(value, "displacement", value) for value in (one, other)]
                raise SettingError("weights", f"{name} {shown[0]}", f"the camera's {shown[1]}", "train for this camera")
        if text := self._untold(camera):
            warn(text, OtherCodes, stacklevel=2)

    def _untold(self, camera: Any) -> str:
        """What the network cannot know of a camera, in words."""
        if isinstance(self.network, TwoHeadedUNet):
            other = ", ".join(self.differences(camera)).replace("_", " ")
            return other and f"the network was trained for a camera with other {other} than the snapshot's"
        if getattr(self.network, "codes", True) or self.same_codes(camera):
            return ""
        return f"{self.path or 'weights'}: this network is not told the codes, and was trained for others"

    def same_codes(self, camera: Any) -> bool:
        """Whether a camera shows the codes that the network was trained for."""
        if self.kind == "spectral-depth":
            return not {*_SHOWN} & {*self.differences(camera)}
        if tuple(camera.size) != tuple(self.settings["size"]) and not self.settings.get("period"):
            return False
        pairs = zip(camera.codes(), self.camera_for(camera.size).codes(), strict=True)
        return all(torch.equal(one.detach().cpu(), other) for one, other in pairs)

    def differences(self, camera: SpectralDepthCamera) -> list[str]:
        """What a spectral-depth camera has otherwise than the one of the training, size, stroke and noise apart."""
        trained, other = ({**codes, **settings} for codes, settings in (_parts(self.camera), _parts(camera)))
        return [name for name, value in trained.items() if name not in _NO_MATTER and not _alike(value, other[name])]

    def load_prior(self) -> GaussianPrior | GaussianMixturePrior | None:
        """The prior that the network starts from.

        Raises:
            DataError: the file is gone or holds a prior of the other kind.
        """
        if not self.prior:
            return None
        kind, camera = "mixture" if self.network.start == "mixture" else "gaussian", self.camera
        if self.prior == RENDERED and isinstance(self.network, TwoHeadedUNet):
            return find_prior(camera, block=block_of(camera, window=self.network.window))
        if self.prior == RENDERED:
            return cast(GaussianPrior, find_prior(camera, None, kind))
        beside = self.path.parent / self.prior if self.path is not None else Path(self.prior)
        prior = load_prior(beside)
        if prior.kind != kind:
            wanted = f"a prior to start from the {self.network.start}"
            raise DataError(self.prior, f"a {type(prior).__name__}", wanted)
        return cast(GaussianPrior, prior)

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write the file, whole or not at all; the network in half precision.

        Raises:
            OutputError: the file exists, or cannot be written.
        """
        from tmca.data import atomic_path, plain

        settings, about = dict(self.settings), {"kind": self.network.kind, "settings": self.network.settings}
        if self.kind != "spectral-depth":
            about["wavelengths"] = list(settings.pop("bands", ()))
        about |= {"camera": settings, "prior": self.prior, "card": self.card, "application": self.kind}
        network = {f"network.{name}": value.half() for name, value in self.network.state_dict().items()}
        codes = {name: _compact(code) if name in ("aperture", "shutter") else code for name, code in self.codes.items()}
        tensors = {name: value.detach().cpu().contiguous() for name, value in {**network, **codes}.items()}
        with atomic_path(path, overwrite=overwrite) as temporary:
            temporary.write_bytes(save(tensors, {"format": FORMAT, "tmca": json.dumps(plain(about))}))
        return Path(path)

    @classmethod
    def load(cls, path: str | Path) -> Weights:
        """Read what ``save`` wrote, by version 0.1 too: a file, or the folder of a run.

        Raises:
            DataError: no such file, no weights of a camera in it, or tensors that do not fit the network.
        """
        path, about, tensors = _read(path)
        kind = about.get("application", "spectral")
        if kind not in _CAMERAS:
            raise DataError(path, f"weights of a {kind} camera", f"those of one of {', '.join(_CAMERAS)}")
        network = restore_network(about["kind"], about["settings"])
        try:
            learned = {n.removeprefix("network."): v.float() for n, v in tensors.items() if n.startswith("network.")}
            network.load_state_dict(learned)
        except RuntimeError as error:
            raise DataError(path, f"tensors that do not fit its network ({error})", "whole weights") from error
        codes = {n: v.float() if v.dtype == torch.uint8 else v for n, v in tensors.items() if "." not in n}
        bands = {"bands": about["wavelengths"]} if about.get("wavelengths") else {}
        return cls(network.eval(), kind, codes, {**bands, **about["camera"]}, about["prior"], about["card"], path)

    @classmethod
    def find(cls, name: str | Path, slots: int = 8) -> Weights:
        """Weights by their file or the folder of their run, or those that come with the package.

        Args:
            name: file, folder, or ``"default"``: ``static.safetensors`` of the package for a camera of one slot, else
                ``multiplexed.safetensors``; ``weights/README.md`` beside them says what they are.
            slots: K of the camera that they are for.

        Raises:
            DataError: no such file, or no weights of a camera in it.
        """
        return cls.load(shipped_file(slots) if str(name) == "default" else name)


def shipped_file(slots: int) -> Path:
    """The weights that come with the package for a camera of as many slots: one, or several."""
    return FOLDER / f"{SHIPPED[slots > 1]}.safetensors"


def same_bands(one: Sequence[float], other: Sequence[float]) -> bool:
    """Whether two lists of wavelengths in metres agree to a nanometre."""
    return len(one) == len(other) and all(abs(a - b) <= 1e-9 for a, b in zip(one, other, strict=True))


def _bands(wavelengths: Sequence[float]) -> str:
    return f"{len(wavelengths)} bands of {min(wavelengths) * 1e9:.4g} to {max(wavelengths) * 1e9:.4g} nm"


def _read(path: str | Path) -> tuple[Path, dict[str, Any], dict[str, Tensor]]:
    """The file (of a run's folder, the one in it), what it is, and its tensors."""
    path = Path(path) / "weights.safetensors" if Path(path).is_dir() else Path(path)
    if not path.is_file():
        raise DataError(path, "no such file", "weights from `tmca train`", "train a network and name its file")
    try:
        with safe_open(path, "pt") as file:
            head = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError) as error:
        raise DataError(path, f"no readable weights ({error})", "a safetensors file", "copy it again") from error
    if head.get("format") != FORMAT:
        raise DataError(path, "a safetensors file of something else", "weights from `tmca train`")
    return path, json.loads(head["tmca"]), tensors


def _compact(codes: Tensor) -> Tensor:
    """Binary codes as bytes, grey ones (a measured mask) as they are."""
    return codes.float() if bool(((codes != 0) & (codes != 1)).any()) else codes.to(torch.uint8)


def _alike(one: Any, other: Any) -> bool:
    """Whether two parts of a camera are the same; heights, in metres, to a nanometre."""
    if isinstance(one, Tensor):
        return one.shape == other.shape and torch.allclose(one.float(), other.float(), rtol=1e-5, atol=1e-9)
    return bool(one == other)


@torch.no_grad()
def _parts(camera: Any, tiled: bool = True) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Tensors and JSON settings from which a camera can be made again, sensor apart."""
    if isinstance(camera, SpectralDepthCamera):
        return _depth_parts(camera)
    settings: dict[str, Any] = {"size": list(camera.size), "period": None, "exposure": camera.exposure}
    codes = dict(zip(("aperture", "shutter"), (plane.detach().cpu().clone() for plane in camera.codes()), strict=True))
    if tiled and camera.codes.aperture.period:
        planes = {"aperture": camera.codes.aperture, "shutter": camera.codes.shutter}
        codes = {name: plane.tile().detach().cpu().clone() for name, plane in planes.items()}
        settings["period"] = list(camera.codes.aperture.period)
    flat = bool((camera.response == 1).all())
    if isinstance(camera, LightFieldCamera):
        light = {} if flat else {"vignetting": camera.vignetting.cpu().tolist()}
        shear = {"shear": list(camera.shear.step), "mask_scale": camera.shear.scale}
        return codes, {**settings, "views": list(camera.views), **shear, **light}
    light = {} if flat else {"response": camera.response.cpu().tolist()}
    optics = {"dispersion": list(camera.dispersion.displacement), "disperser": camera.disperser}
    return codes, {"bands": list(camera.wavelengths), **settings, **optics, **light}


def _depth_parts(camera: SpectralDepthCamera) -> tuple[dict[str, Tensor], dict[str, Any]]:
    heights, stroke = camera.point_spread.heights, camera.point_spread.heights.stroke
    codes = {
        "heights": heights(), "shutter": camera.tile()[1], "filters": camera.filters.filters,
        "cells": camera.filters.cells(), "response": camera.response, **family_parameters(heights),
    }  # fmt: skip
    settings = {
        "bands": list(camera.wavelengths), "size": list(camera.size), "slots": camera.slots,
        "depth": [camera.planes.near, camera.planes.far], "planes": camera.planes.count,
        "bench": asdict(camera.bench), "period": camera.period, "exposure": camera.exposure,
        "energy": camera.point_spread.energy, "image_formation": camera.image_formation,
        "stroke": None if stroke is None else asdict(stroke),
    }  # fmt: skip
    return {name: value.detach().clone() for name, value in codes.items()}, settings


def _spectral(codes: dict[str, Any], settings: dict[str, Any]) -> SpectralCamera:
    return SpectralCamera(slots=len(codes["aperture"]), **codes, **settings)


def _light_field(codes: dict[str, Any], settings: dict[str, Any]) -> LightFieldCamera:
    return LightFieldCamera(slots=len(codes["aperture"]), **codes, **settings)


def _spectral_depth(codes: dict[str, Tensor], settings: dict[str, Any]) -> SpectralDepthCamera:
    settings = dict(settings)
    bench, stroke = changed_bench(PhaseMaskBench(), settings.pop("bench")), settings.pop("stroke", None)
    maps = restored_maps(codes["heights"], codes, None if stroke is None else Stroke(**stroke))
    return SpectralDepthCamera(
        **{**settings, "depth": tuple(settings["depth"])}, bench=bench, mask=maps, shutter=codes["shutter"],
        filters=codes["filters"], cells=codes["cells"].long(), channels=codes["response"],
    )  # fmt: skip


_CAMERAS: dict[str, Callable[[dict[str, Tensor], dict[str, Any]], Any]] = {
    "spectral": _spectral, "light-field": _light_field, "spectral-depth": _spectral_depth,
}  # fmt: skip
