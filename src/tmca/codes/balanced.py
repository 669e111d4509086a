"""Random choices among a few, each made equally often: small tiles of shutters and filters."""

from __future__ import annotations

import torch
from torch import Tensor

from tmca.errors import SettingError


def balanced_choice(count: int, size: tuple[int, int], seed: int = 0) -> Tensor:
    """(h, w) whole numbers from 0 to ``count - 1`` in random order, as often as each other, or once more.

    Raises:
        SettingError: nothing to choose from.
    """
    if count < 1:
        raise SettingError("choices", str(count), "1 or more")
    pixels = size[0] * size[1]
    order = torch.randperm(pixels, generator=torch.Generator().manual_seed(seed))
    return (torch.arange(pixels) % count)[order].reshape(size)


def one_hot_planes(choice: Tensor, count: int) -> Tensor:
    """(count, h, w) zeros and ones: one in the plane that every pixel of ``choice`` (h, w) names."""
    return torch.nn.functional.one_hot(choice.long(), count).movedim(-1, 0).to(torch.get_default_dtype())
