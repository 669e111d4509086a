"""Trained networks with the camera that they belong to, and their file: one safetensors with everything to use them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any
from warnings import warn

import numpy as np
import torch
from pydantic import Field, Json, JsonValue
from pydantic_core import to_json
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from tmca.arguments import reason
from tmca.attributes import Attributes, Beside, FiniteJson, attributes_of, json_of
from tmca.cameras import CAMERAS
from tmca.codes.files import Frame, differing
from tmca.decoders.nets.bands import check_bands
from tmca.decoders.nets.build import restore_network
from tmca.decoders.nets.shipped import DEFAULT, FOLDER, KIND_OF_NAME, UNIVERSAL, shipped_file
from tmca.decoders.nets.two_headed import TwoHeadedUNet, check_sizes
from tmca.decoders.nets.weights_0_1 import of_version_0_1
from tmca.errors import DataError, SettingError, ShapeError, check_choice
from tmca.optics import DepthPlanes
from tmca.priors import block_of, find_prior
from tmca.stored_numbers import check_finite

if TYPE_CHECKING:
    import xarray as xr

FORMATS = ("tmca weights 1", "tmca weights 2")
"""Of version 0.1, and of this one."""
RENDERED = "rendered"
"""Name of the prior of the rendered scenes, which is in no file beside the weights."""
_OPTICS = ("disperser", "exposure", "dispersion", "shear")
"""What a network of a collapsed camera does not see."""
_SHOWN = {"aperture", "heights", "shutter", "filters", "cells"}
_NO_MATTER = {"sensor", "full_scale", "period", "tmca_version"}
"""Attributes that the camera behind a network may have otherwise."""


class OtherCodes(UserWarning):
    """A network that does not see the codes, behind other codes than it was trained for."""


class _Planes(Attributes):
    depth: Json[DepthPlanes]


@dataclass
class Weights:
    """A trained network with the camera that it was trained for.

    Args:
        network: a `Network`, or a `TwoHeadedUNet` of spectrum and depth.
        variables: dataset of the camera (``Camera.variables``), codes that repeat as one tile, its sensor ideal.
        prior: ``"rendered"``, a file beside the weights, or ``""`` where none is needed.
        card: how it was trained and how good it is: JSON values.
        path: file it came from.
    """

    network: Any
    variables: Any
    prior: str = ""
    card: dict[str, Any] = field(default_factory=dict)
    path: Path | None = None

    @classmethod
    def of(cls, network: Any, camera: Any, prior: str = "", card: dict[str, Any] | None = None) -> Weights:
        """A network with its camera as it is now."""
        return cls(network, camera.variables(tiled=True).copy(deep=True).assign_attrs(sensor="{}"), prior, card or {})

    @property
    def kind(self) -> str:
        """Of the camera."""
        return str(self.variables.attrs["camera"])

    @property
    def codes(self) -> dict[str, Tensor]:
        """``aperture`` or ``heights``, and ``shutter``, slot by slot, one tile where they repeat."""
        shown = [name for name in ("aperture", "heights", "shutter") if name in self.variables]
        return {name: torch.from_numpy(self.variables[name].values.astype(np.float32)) for name in shown}

    @property
    def aperture(self) -> Tensor:
        """(K, h, w) of a collapsed camera."""
        return self.codes["aperture"]

    @property
    def shutter(self) -> Tensor:
        """(K, h, w')."""
        return self.codes["shutter"]

    @property
    def slots(self) -> int:
        """K."""
        return len(next(iter(self.codes.values())))

    @property
    def size(self) -> tuple[int, int]:
        """(H, W) of the camera of the training."""
        return attributes_of(_Sized, self.variables.attrs, self.path or "weights").size

    @property
    def period(self) -> tuple[int, int] | None:
        """Of codes that repeat."""
        sizes = self.variables.sizes
        return (sizes["y_tile"], sizes["x_tile"]) if "y_tile" in sizes else None

    @property
    def wavelengths(self) -> tuple[float, ...]:
        """Of the bands, metres; none for views."""
        return tuple(self.variables["wavelength"].values.tolist()) if "wavelength" in self.variables else ()

    @property
    def planes(self) -> DepthPlanes:
        """Depth planes of a spectral-depth camera.

        Raises:
            DataError: none are described.
        """
        return attributes_of(_Planes, self.variables.attrs, self.path or "weights").depth

    @property
    def camera(self) -> Any:
        """The camera of the training, of the size that it had there."""
        return self.camera_for()

    def camera_for(
        self, size: tuple[int, int] | None = None, *, bands: Sequence[float] | None = None, **changes: Any
    ) -> Any:
        """The camera with these codes for scenes of (H, W), and of ``bands`` if given, wavelengths in metres;
        ``changes`` are arguments such as ``sensor``.

        Raises:
            ShapeError: codes without a period have another size.
            SettingError: a network of any codes, or codes for other bands.
        """
        self.check_codes()
        if bands is not None:
            check_bands(self.wavelengths, bands, "the scene's")
        wanted = self.size if size is None else tuple(size)
        if wanted != self.size and self.period is None:
            found = f"codes of {self.size[0]}×{self.size[1]} pixels that do not repeat"
            remedy = "crop the scene, or train with camera.size, or tiled codes (camera.period)"
            raise ShapeError("weights", found, f"{wanted[0]}×{wanted[1]} as the scene", remedy)
        return CAMERAS[self.kind].from_variables(self.variables, str(self.path or "weights"), size=wanted, **changes)

    def check_kind(self, kind: str) -> None:
        """Raises SettingError unless they are those of this kind of camera."""
        if self.kind != kind:
            wanted = f"those of a {kind} camera"
            raise SettingError("weights", f"those of a {self.kind} camera", wanted, "name other weights")

    def check_codes(self) -> None:
        """Raises SettingError where they bring no codes, as those of a network that serves any."""
        if self.any_bands:
            found, remedy = "a network of any codes, which brings none", "name codes, and take it to reconstruct"
            raise SettingError("weights", found, "those of a trained camera", remedy)

    def check(self, camera: Any) -> None:
        """Whether the network decodes snapshots of a camera.

        Raises:
            SettingError, ShapeError: another kind of camera, other bands, views or optics.

        Warns:
            OtherCodes: codes that it was not trained for and does not see.
        """
        self.check_kind(camera.kind)
        if self.any_bands:
            self.network_for(camera)
            return
        check_bands(self.wavelengths, getattr(camera, "wavelengths", ()), "the camera's")
        if isinstance(self.network, TwoHeadedUNet):
            check_sizes(self.network, camera)
            other = ", ".join(self.differences(camera)).replace("_", " ")
            text = other and f"the network was trained for a camera with other {other} than the snapshot's"
        else:
            self._check_optics(camera)
            fits = getattr(self.network, "codes", True) or self.same_codes(camera)
            others = f"{self.path or 'weights'}: this network does not see the codes, and was trained for others"
            text = "" if fits else others
        if text:
            warn(text, OtherCodes, stacklevel=2)

    @property
    def any_bands(self) -> bool:
        """Whether the network serves cameras of any bands, codes and buckets."""
        return bool(getattr(self.network, "any_bands", False))

    def network_for(self, camera: Any) -> Any:
        """The network at the bands of a camera.

        Raises:
            SettingError: bands outside of what a network of any bands learned.
        """
        return self.network.at(camera.wavelengths) if self.any_bands else self.network

    def _check_optics(self, camera: Any) -> None:
        trained = self.camera
        views, wanted = trained.scene_shape[:-2], camera.scene_shape[:-2]
        if views != wanted:
            found, expected = ("×".join(map(str, size)) for size in (views, wanted))
            raise ShapeError("weights", f"{found} {camera.channel}s", f"the camera's {expected}")
        if trained.buckets != camera.buckets:
            found = f"those of a sensor with buckets = {trained.buckets}"
            raise SettingError("weights", found, f"the camera's {camera.buckets}", "train for this camera")
        for name in _OPTICS:
            one, other = getattr(trained, name, None), getattr(camera, name, None)
            if one != other:
                shown = [getattr(value, "displacement", value) for value in (one, other)]
                raise SettingError("weights", f"{name} {shown[0]}", f"the camera's {shown[1]}", "train for this camera")

    def same_codes(self, camera: Any) -> bool:
        """Whether a camera shows the codes that the network was trained for."""
        fits = self.period is not None or tuple(camera.size) == self.size
        return fits and not _SHOWN & {*self.differences(camera)}

    def differences(self, camera: Any) -> list[str]:
        """Variables and attributes that a camera has otherwise than the one of the training, size and sensor apart."""
        one, other = self.camera_for(camera.size).variables(), camera.variables()
        return differing(one, other) + [
            name for name in one.attrs if name not in _NO_MATTER and one.attrs[name] != other.attrs[name]
        ]

    def load_prior(self, camera: Any = None) -> Any:
        """The prior that the network starts from; None where it needs none.

        Args:
            camera: that a network of any bands shall serve; the one of the training by default.

        Raises:
            DataError: the file is gone.
            SettingError: it holds a prior of another kind.
        """
        if not self.prior:
            return None
        kind = "mixture" if self.network.start == "mixture" else "gaussian"
        camera = self.camera if camera is None or not self.any_bands else camera
        block = block_of(camera, window=self.network.window) if isinstance(self.network, TwoHeadedUNet) else None
        beside = (Path() if self.path is None else self.path.parent) / self.prior
        return find_prior(camera, None if self.prior == RENDERED else beside, kind, block=block)

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write the file, whole or not at all; the network in half precision.

        Raises:
            OutputError: the file exists, or cannot be written.
        """
        from tmca.data import atomic_path, plain

        network = {"kind": self.network.kind, "settings": self.network.settings}
        about = {
            "network": network,
            "camera": self.variables.to_dict(data=False),
            "prior": self.prior,
            "card": self.card,
        }
        tensors = {f"network.{name}": value.half() for name, value in self.network.state_dict().items()}
        tensors |= {str(name): torch.tensor(part.values) for name, part in self.variables.variables.items()}
        tensors = {name: value.detach().cpu().contiguous() for name, value in tensors.items()}
        with atomic_path(path, overwrite=overwrite) as temporary:
            temporary.write_bytes(save(tensors, {"format": FORMATS[-1], "tmca": json.dumps(plain(about))}))
        return Path(path)

    @classmethod
    def load(cls, path: str | Path) -> Weights:
        """Read what ``save`` wrote, by version 0.1 too: a file, or the folder of a run.

        Raises:
            DataError: no such file, no weights of a camera in it, or tensors that do not fit the network.
        """
        path, about, tensors = _read(path)
        network = about.network or about
        try:
            arrays = {name: tensors.pop(name).numpy() for name in list(tensors) if "." not in name}
            weights = {name.removeprefix("network."): v.float() for name, v in tensors.items()}
            restored = restore_network(network.kind, network.settings, weights)
            variables = _variables(about.camera, arrays) if about.network else of_version_0_1(about, arrays, path)
        except (KeyError, ValueError, TypeError, RuntimeError, IndexError) as error:
            found = f"tensors that do not fit its network or camera ({reason(error)})"
            raise DataError(path, found, "whole weights") from error
        attributes_of(_Sized, variables.attrs, path)
        return cls(restored.eval(), variables, about.prior, about.card, path)

    @classmethod
    def find(cls, name: str | Path, slots: int = 8, kind: str = "spectral") -> Weights:
        """Weights by their file or the folder of their run, or those that come with the package: ``"default"`` for a
        kind of camera of as many slots, ``"default-light-field"`` and the like for that kind, ``"universal"`` for any
        spectral one; ``weights/README.md`` beside them says what they are.

        Raises:
            DataError: no such file, or no weights of a camera in it.
            SettingError: a kind of camera for which none come with the package.
        """
        return cls.load(cls.file(name, slots, kind))

    @staticmethod
    def file(name: str | Path, slots: int = 8, kind: str = "spectral") -> Path:
        """The file or run that ``find`` reads; SettingError as there."""
        if str(name) == UNIVERSAL:
            return FOLDER / f"{UNIVERSAL}.safetensors"
        named = KIND_OF_NAME.get(str(name), kind if str(name) == DEFAULT else None)
        return Path(name) if named is None else shipped_file(slots, named)


class _NetworkAttributes(Attributes):
    kind: str
    settings: dict[str, FiniteJson]


class _WeightsAttributes(Attributes):
    """What the head of a file of weights says; ``network`` apart, in version 0.1 what that says is here too."""

    network: _NetworkAttributes | None = None
    kind: str = ""
    settings: dict[str, FiniteJson] = Field(default_factory=dict)
    application: str = "spectral"
    wavelengths: tuple[float, ...] = ()
    camera: dict[str, FiniteJson]
    prior: Beside
    """A file beside the weights, the prior of the rendered scenes, or none."""
    card: dict[str, JsonValue]


class _Sized(Attributes):
    """Of the camera of weights: the frame of its training."""

    size: Json[Frame]


class _Variable(Attributes):
    dims: tuple[str, ...]
    attrs: dict[str, FiniteJson]


class _Described(Attributes):
    """``Dataset.to_dict(data=False)``."""

    attrs: dict[str, FiniteJson]
    coords: dict[str, _Variable]
    data_vars: dict[str, _Variable]


def weights_file(path: str | Path) -> Path:
    """The file of weights that a path names: itself, or that in the folder of a run."""
    return Path(path) / "weights.safetensors" if Path(path).is_dir() else Path(path)


def _read(path: str | Path) -> tuple[Path, _WeightsAttributes, dict[str, Tensor]]:
    """The file (of a run's folder, the one in it), what it is, and its tensors."""
    path = weights_file(path)
    if not path.is_file():
        raise DataError(path, "no such file", "weights from `tmca train`", "train a network and name its file")
    try:
        with safe_open(path, "pt") as file:
            head = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError) as error:
        raise DataError(
            path, f"no readable weights ({reason(error)})", "a safetensors file", "copy it again"
        ) from error
    if head.get("format") not in FORMATS or "tmca" not in head:
        raise DataError(path, "a safetensors file of something else", "weights from `tmca train`")
    for name, values in tensors.items():
        if values.is_floating_point():
            check_finite(values.float().numpy(), path, f"tensor {name[:60]}", "train again, or take an unchanged copy")
    return path, json_of(head["tmca"], path, _WeightsAttributes), tensors


def _variables(described: dict[str, Any], arrays: dict[str, np.ndarray]) -> xr.Dataset:
    """A camera's variables of their description (``Dataset.to_dict(data=False)``) and their values."""
    import xarray as xr

    said = _Described.model_validate_json(to_json(described))
    coords, variables = (
        {name: (one.dims, arrays[name], one.attrs) for name, one in part.items()}
        for part in (said.coords, said.data_vars)
    )
    check_choice("camera", said.attrs.get("camera"), [*CAMERAS])
    return xr.Dataset(variables, coords, said.attrs)
