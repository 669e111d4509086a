"""The engine of a run, Lightning Fabric: device, processes, and which arithmetic the network uses."""

from __future__ import annotations

import logging
import warnings
from typing import TYPE_CHECKING, Any, Literal

import torch

from tmca.devices import computes_half
from tmca.errors import SettingError
from tmca.training.settings import RunSettings

if TYPE_CHECKING:
    from lightning_fabric import Fabric
    from lightning_fabric.plugins import MixedPrecision

Precision = Literal["32-true", "bf16-mixed"]


def choose_precision(asked: Literal["auto"] | Precision, accelerator: str = "auto") -> Precision:
    """``asked``, or for ``"auto"`` half precision where the device computes it, single where it would be emulated.

    Emulated bfloat16 is many times slower than float32 (``benchmarks/training.py``).

    Args:
        asked: ``"auto"``, ``"32-true"`` or ``"bf16-mixed"``.
        accelerator: ``"cpu"``, ``"cuda"`` or ``"auto"``, as Lightning Fabric reads them.
    """
    if asked != "auto":
        return asked
    device = torch.device("cuda" if _on_cuda(accelerator) else "cpu")
    return "bf16-mixed" if computes_half(device) else "32-true"


def start_engine(settings: RunSettings, precision: Precision, accelerator: str, processes: int, nodes: int) -> Fabric:
    """The engine of a run; arguments as of `tmca.training.run.carry_out`.

    Raises:
        SettingError: a device that is not there, or a batch that the processes cannot share.
    """
    from lightning_fabric import Fabric

    logging.getLogger("lightning_fabric").setLevel(logging.WARNING)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            fabric = Fabric(
                accelerator=accelerator, devices=processes, num_nodes=nodes,
                strategy="ddp" if processes * nodes > 1 else "auto",
                plugins=[_mixed_precision(accelerator)] if precision == "bf16-mixed" else [],
            )  # fmt: skip
        except (ValueError, RuntimeError) as error:  # Fabric has no error of its own for a device that is not there
            raise SettingError("--accelerator", repr(accelerator), "one of this machine", str(error)) from None
        fabric.launch()
    if settings.data.batch % fabric.world_size:
        raise SettingError("data.batch", str(settings.data.batch), f"a multiple of the {fabric.world_size} processes")
    return fabric


def _mixed_precision(accelerator: str) -> MixedPrecision:
    """Half precision for the layers of a network alone: Fabric's would round scenes and their truth to 8 bits."""
    from lightning_fabric.plugins import MixedPrecision

    class Layers(MixedPrecision):
        def convert_input(self, data: Any) -> Any:
            return data

    return Layers("bf16-mixed", "cuda" if _on_cuda(accelerator) else "cpu")


def _on_cuda(accelerator: str) -> bool:
    return accelerator in ("auto", "cuda", "gpu") and torch.cuda.is_available()
