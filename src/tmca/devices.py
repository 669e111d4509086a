"""Where decoders and searches compute: a device by its name, the one that is used where none is named, and what its
memory lacks."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

import torch

from tmca.arguments import described, reason
from tmca.errors import SettingError

_KINDS = ("cpu", "cuda")
_USUAL: ContextVar[torch.device | None] = ContextVar("device", default=None)


def device_of(name: str | torch.device) -> torch.device:
    """A device by its name, ``"cpu"``, ``"cuda"`` or ``"cuda:1"``.

    Raises:
        SettingError: no such device, one that this machine does not have, or one without any free memory.
    """
    try:
        device = torch.device(name)
        if device.type in _KINDS:
            with enough_memory(device):
                torch.zeros(1, device=device)
            return device
    except (RuntimeError, AssertionError, TypeError):
        pass
    there = ["cpu", *(["cuda"] if torch.cuda.is_available() else [])]
    raise SettingError("device", described(name), f"one of this machine: {', '.join(there)}")


def computes_half(device: torch.device) -> bool:
    """Whether a device computes with bfloat16; others emulate it, many times slower than float32."""
    if device.type == "cuda":
        return bool(torch.cuda.is_bf16_supported(including_emulation=False))
    known = torch.cpu.get_capabilities().items() if torch.backends.mkldnn.is_available() else ()
    return any(there and name.endswith("bf16") for name, there in known)


def usual_device() -> torch.device | None:
    """That of ``computing_on``; None outside of it: then decoders compute where the snapshot lies."""
    return _USUAL.get()


def search_device() -> torch.device:
    """Where searches of codes and masks compute: the device of ``computing_on``, the processor outside of it."""
    return usual_device() or torch.device("cpu")


@contextmanager
def computing_on(name: str | torch.device | None) -> Iterator[None]:
    """Within it decoders and searches compute on a device, where none is named; None changes nothing.

    Raises:
        SettingError: as `device_of`, or too little memory for what is computed within.
    """
    device = usual_device() if name is None else device_of(name)
    token = _USUAL.set(device)
    try:
        with enough_memory(device or torch.device("cpu")):
            yield
    finally:
        _USUAL.reset(token)


@contextmanager
def enough_memory(device: torch.device) -> Iterator[None]:
    """Raises SettingError where the memory of a device is too small for what is computed within."""
    try:
        yield
    except torch.OutOfMemoryError as error:
        found = f"{device}, whose memory is too small ({reason(error)})"
        raise SettingError("device", found, "room for the work", "compute on the cpu, or close other work") from None
