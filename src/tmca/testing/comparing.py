"""Checks one after the other, and what they say where something is not as it should be."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor

Loop = Callable[[Tensor], Tensor]
"""A slow and plain image of one scene: what is to be imaged, without the batch → what has to come of it."""


def run(checks: Sequence[Callable[[Any], None]], subject: Any, name: str) -> None:
    """Run checks; AssertionError in one line that begins with a name and the check that failed."""
    for check in checks:
        where = f"{name}: {check.__name__.replace('_', ' ')}"
        try:
            check(subject)
        except AssertionError as error:
            raise AssertionError(f"{where}: {error}") from error
        except Exception as error:
            said = " ".join(str(error).split())
            raise AssertionError(f"{where}: {type(error).__name__}: {said}") from error


def say(holds: bool, otherwise: str) -> None:
    """AssertionError with a text unless something holds."""
    if not holds:
        raise AssertionError(otherwise)


def same_shape(found: Sequence[int], expected: Sequence[int], what: str) -> None:
    """AssertionError unless two shapes are equal."""
    say(tuple(found) == tuple(expected), f"{what} of shape {tuple(found)}, expected {tuple(expected)}")


def close(found: Tensor, expected: Tensor, what: str, *, rtol: float, atol: float) -> None:
    """AssertionError unless two tensors are as near as they should be, entry by entry."""
    same_shape(found.shape, expected.shape, what)
    error = (found - expected).abs()
    beyond = error - atol - rtol * expected.abs()
    if not bool((beyond <= 0).all()):
        worst = float(error.flatten()[int(beyond.flatten().argmax())])
        raise AssertionError(f"{what} differs by {worst:.2g} of values up to {float(expected.abs().max()):.2g}")


def refused(call: Callable[[], Any], kind: type[Exception], what: str) -> None:
    """AssertionError unless a call raises an error of a kind, which says it in one line."""
    try:
        call()
    except kind:
        return
    except Exception as error:
        raise AssertionError(f"{what} raises {type(error).__name__}, expected {kind.__name__}: {error}") from error
    raise AssertionError(f"{what} is taken, expected {kind.__name__}")


def drawn(*shape: int, dtype: torch.dtype, device: torch.device, seed: int = 0) -> Tensor:
    """Uniform numbers between 0 and 1, the same at every call."""
    source = torch.Generator().manual_seed(seed + sum(shape))
    return torch.rand(*shape, generator=source, dtype=torch.float64).to(device, dtype)
