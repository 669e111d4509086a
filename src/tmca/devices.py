"""Where decoders compute: a device by its name, and the one that is used where none is named."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

import torch

from tmca.errors import SettingError

_USUAL: ContextVar[torch.device | None] = ContextVar("device", default=None)


def device_of(name: str | torch.device) -> torch.device:
    """A device by its name, ``"cpu"``, ``"cuda"``, ``"cuda:1"`` or ``"mps"``.

    Raises:
        SettingError: no such device, or one that this machine does not have.
    """
    try:
        device = torch.device(name)
        torch.zeros(1, device=device)
    except (RuntimeError, AssertionError, NotImplementedError):
        there = ["cpu", *(["cuda"] if torch.cuda.is_available() else [])]
        raise SettingError("device", repr(str(name)), f"one of this machine: {', '.join(there)}") from None
    return device


def usual_device() -> torch.device | None:
    """That of ``computing_on``; None outside of it: then decoders compute where the snapshot lies."""
    return _USUAL.get()


@contextmanager
def computing_on(name: str | None) -> Iterator[None]:
    """Within it decoders compute on a device, where none is named; None changes nothing.

    Raises:
        SettingError: as `device_of`.
    """
    token = _USUAL.set(usual_device() if name is None else device_of(name))
    try:
        yield
    finally:
        _USUAL.reset(token)
