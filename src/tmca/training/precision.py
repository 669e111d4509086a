"""Which arithmetic a run's network uses."""

from __future__ import annotations

from typing import Literal

import torch

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
    cuda = accelerator in ("auto", "cuda", "gpu") and torch.cuda.is_available()
    return "bf16-mixed" if (_cuda_has_bfloat16() if cuda else _cpu_has_bfloat16()) else "32-true"


def _cuda_has_bfloat16() -> bool:
    return bool(torch.cuda.is_bf16_supported(including_emulation=False))


def _cpu_has_bfloat16() -> bool:
    """Whether any of the processor's instruction sets multiplies bfloat16: AMX and AVX-512 on x86, BF16 on ARM."""
    return any(there and name.endswith("bf16") for name, there in torch.cpu.get_capabilities().items())
