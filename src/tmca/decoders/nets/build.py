"""Networks by their name and settings."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor
from torch.overrides import TorchFunctionMode

from tmca.arguments import described, reason
from tmca.cameras import SpectralDepthCamera
from tmca.decoders.likelihood import check_window, usual_window
from tmca.decoders.nets.network import Network
from tmca.decoders.nets.spatial_angular import SpatialAngular
from tmca.decoders.nets.subspace import SubspaceNetwork
from tmca.decoders.nets.two_headed import TwoHeadedUNet, camera_sizes
from tmca.decoders.nets.unet import UNet, Unrolled
from tmca.errors import SettingError, check_choice, check_range

NETWORKS: dict[str, type[Network]] = {
    network.kind: network for network in (UNet, Unrolled, SpatialAngular, SubspaceNetwork)
}


def build_network(kind: str, **settings: Any) -> Network:
    """A network by name: ``"unet"``, ``"unrolled"``, ``"spatial-angular"`` or ``"subspace"``.

    Args:
        kind: which one.
        settings: its keyword arguments.

    Raises:
        SettingError: unknown kind or argument.
    """
    check_choice("decoder", kind, NETWORKS)
    network: Network = _built(NETWORKS[kind], settings)
    return network


def restore_network(kind: str, settings: Mapping[str, Any], weights: Mapping[str, Tensor]) -> Any:
    """The network of any camera that a file describes, with its weights.

    It is built without memory and takes the weights as they are: what settings ask for beyond them is never allocated.

    Raises:
        SettingError: unknown kind or settings, or more parts than there are weights.
        RuntimeError: weights that are not those of the network.
    """
    network = {**NETWORKS, TwoHeadedUNet.kind: TwoHeadedUNet}
    check_choice("decoder", kind, network)
    for name in ("blocks", "stages"):
        check_range(name, settings.get(name, 1), high=len(weights))
    with torch.device("meta"), _NoStart():
        restored = _built(network[kind], settings)
    restored.load_state_dict(dict(weights), assign=True)
    return restored


class _NoStart(TorchFunctionMode):
    """Within it weights get no first values, which takes longer than to read them."""

    def __torch_function__(self, function: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        given = kwargs or {}
        if getattr(function, "__module__", "") == "torch.nn.init":
            return args[0] if args else given["tensor"]
        return function(*args, **given)


def _built(network: Any, given: Mapping[str, Any], **sizes: int) -> Any:
    """A network of some settings; ``sizes`` are those that nobody may give."""
    where = f"decoder {network.kind}"
    allowed = [name for name in inspect.signature(network).parameters if name not in sizes]
    if unknown := [name for name in given if name not in allowed]:
        raise SettingError(where, ", ".join(unknown), f"some of {', '.join(allowed)}")
    try:
        return network(**sizes, **given)
    except SettingError:
        raise
    except (TypeError, ValueError, RuntimeError, ArithmeticError, MemoryError) as error:
        raise SettingError(where, described(dict(given)), "numbers that make a network", reason(error)) from None


def build_depth_network(settings: dict[str, Any], camera: SpectralDepthCamera) -> TwoHeadedUNet:
    """A network for a camera; ``settings`` are those of `TwoHeadedUNet` that the camera does not say.

    Windows of a first stage are the camera's usual ones where the settings do not say.

    Raises:
        SettingError: unknown kind or setting, impossible sizes, or windows that do not fit the camera.
    """
    given = {"kind": TwoHeadedUNet.kind, "window": usual_window(camera), **settings}
    check_choice("decoder", given.pop("kind"), (TwoHeadedUNet.kind,))
    network: TwoHeadedUNet = _built(TwoHeadedUNet, given, **camera_sizes(camera))
    if network.start == "likelihood":
        check_window(network.window, camera, "decoder.window")
    return network
