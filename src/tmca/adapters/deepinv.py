"""deepinv: a camera as the physics of its solvers, and its reconstructors as decoders."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import torch
from torch import Tensor, nn

from tmca.arguments import described
from tmca.cameras import Camera
from tmca.decoders import Decoder, Raw
from tmca.decoders.decoder import Progress
from tmca.errors import SettingError
from tmca.operators import LinearOperator

_KINDS = frozenset({"spectral", "light-field"})


class _Maps:
    """The maps of an operator by deepinv's names and conventions."""

    operator: LinearOperator

    def A(self, x: Tensor, **_: Any) -> Tensor:
        """Scene (B, channels, H, W) → exact snapshot (B, C, H, W')."""
        return self.operator.A(x)

    def A_adjoint(self, y: Tensor, **_: Any) -> Tensor:
        """Snapshot → scene, the transpose of ``A``."""
        return self.operator.A_adjoint(y)

    def A_dagger(self, y: Tensor, **_: Any) -> Tensor:
        """Least-norm scene that explains a snapshot."""
        return self.operator.A_dagger(y)

    def prox_l2(self, z: Tensor | float | None, y: Tensor, gamma: float | Tensor, **_: Any) -> Tensor:
        """``argmin_x γ/2 ‖A x − y‖² + ½ ‖x − z‖²``; a number stands for a scene of it everywhere."""
        if not isinstance(z, Tensor):
            z = torch.full_like(self.operator.A_adjoint(y), 0.0 if z is None else float(z))
        return self.operator.prox_l2(z, y, 1 / gamma)


class PlainPhysics(_Maps, nn.Module):
    """The maps alone, for reconstructors that need no more of deepinv's physics.

    Args:
        operator: whose maps they are.
    """

    def __init__(self, operator: LinearOperator) -> None:
        super().__init__()
        self.operator = operator

    def forward(self, x: Tensor, **_: Any) -> Tensor:
        """The same as ``A``."""
        return self.operator.A(x)


def as_deepinv(camera: Camera | LinearOperator, *, depth: Tensor | None = None) -> Any:
    """A camera, or its operator, as a ``deepinv.physics.LinearPhysics``, which deepinv's solvers and losses take.

    Scenes are (B, channels, H, W); the views of a light field are channels, row by row. ``A_dagger`` and ``prox_l2``
    are the camera's own, which are closed where it has closed ones.

    Args:
        camera: with its codes; its read and shot noise become the noise model. An operator has none.
        depth: (B, 1, H, W) metres, for a camera that images depth.

    Raises:
        SettingError: deepinv is missing, or no camera.
    """
    physics = _imported("deepinv").physics
    operator = _operator(camera, depth)
    device = next((one.device for one in operator.buffers()), torch.device("cpu"))
    made = _class_over(physics.LinearPhysics)(img_size=tuple(operator.scene_shape), noise_model=_noise(physics, camera))
    made.operator = operator
    return made.to(device)


def from_deepinv(model: Callable[..., Tensor]) -> Decoder:
    """A decoder of a deepinv ``Reconstructor``, or of any ``model(y, physics) -> x`` of its form.

    It decodes spectral and light-field cameras: ``tmca.reconstruct(snapshot, from_deepinv(model))``. A model that needs
    no more of the physics than its linear maps works without deepinv.

    Args:
        model: takes snapshots (B, C, H, W') and the physics, and returns scenes (B, channels, H, W).

    Raises:
        SettingError: nothing that can be called.
    """
    if not callable(model):
        raise SettingError("model", described(model), "a deepinv Reconstructor, or a function of (y, physics)")
    return DeepinvDecoder(model)


@dataclass
class DeepinvDecoder(Decoder):
    """A model of deepinv; `from_deepinv` makes one.

    Args:
        model: ``model(y, physics) -> x``.
    """

    label, cameras = "deepinv", _KINDS
    model: Any = None

    def setup(self, camera: Any, prior: Any) -> Any:
        return as_deepinv(camera) if find_spec("deepinv") else PlainPhysics(camera.operator())

    def reconstruct(self, prepared: Any, values: Tensor, progress: Progress | None) -> Raw:
        model = self.model
        if isinstance(model, nn.Module):
            model = model.to(values.device).eval()
        return Raw(model(values, prepared), notes={"model": getattr(model, "__name__", type(model).__name__)})


DeepinvDecoder.name = "deepinv"  # not in its body: the registry has no decoder that cannot be made by its name alone


@cache
def _class_over(base: type) -> Any:
    """A class of deepinv with a camera's maps."""
    return type("TmcaPhysics", (_Maps, base), {"__doc__": "The linear part of a camera of tmca."})


def _operator(camera: Any, depth: Tensor | None) -> LinearOperator:
    if isinstance(camera, Camera):
        return camera.operator(depth)
    if isinstance(camera, LinearOperator):
        return camera
    raise SettingError("camera", described(camera), "a camera of tmca, or its operator")


def _noise(physics: Any, camera: Any) -> Any:
    """Read and shot noise of a camera as deepinv's noise model."""
    noise = camera.noise if isinstance(camera, Camera) else None
    if noise is not None and noise.shot:
        return physics.PoissonGaussianNoise(gain=noise.shot, sigma=noise.read)
    return physics.GaussianNoise(sigma=noise.read) if noise is not None and noise.read else physics.ZeroNoise()


def _imported(name: str) -> Any:
    """A library that tmca does not need itself.

    Raises:
        SettingError: it is missing; the remedy installs it.
    """
    try:
        return import_module(name)
    except ImportError as error:
        found = f"no {name}" if error.name == name else f"a {name} that cannot be imported ({error})"
        raise SettingError(name, found, f"the package {name}", f"pip install {name}") from error
