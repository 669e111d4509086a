"""Which arithmetic a run's network uses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import torch

if TYPE_CHECKING:
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
    has = _cuda_has_bfloat16() if _on_cuda(accelerator) else _cpu_has_bfloat16()
    return "bf16-mixed" if has else "32-true"


def mixed_precision(accelerator: str = "auto") -> MixedPrecision:
    """Lightning Fabric's half precision for the layers of a network alone.

    Fabric itself would round scenes and their truth to 8 bits before they are imaged.

    Args:
        accelerator: ``"cpu"``, ``"cuda"`` or ``"auto"``, as Lightning Fabric reads them.
    """
    from lightning_fabric.plugins import MixedPrecision

    class Layers(MixedPrecision):
        def convert_input(self, data: Any) -> Any:
            return data

    return Layers("bf16-mixed", "cuda" if _on_cuda(accelerator) else "cpu")


def _on_cuda(accelerator: str) -> bool:
    return accelerator in ("auto", "cuda", "gpu") and torch.cuda.is_available()


def _cuda_has_bfloat16() -> bool:
    return bool(torch.cuda.is_bf16_supported(including_emulation=False))


def _cpu_has_bfloat16() -> bool:
    """Whether any of the processor's instruction sets multiplies bfloat16: AMX and AVX-512 on x86, BF16 on ARM."""
    return any(there and name.endswith("bf16") for name, there in torch.cpu.get_capabilities().items())
