"""What the training loop asks of a camera with its decoder; nothing in the loop knows which camera it is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from torch import Tensor, nn

from tmca.training.patches import Patch


class System(Protocol):
    """A camera and a decoder that learn together: an ``nn.Module`` with these methods."""

    frozen: bool
    """Whether the codes stay as they are for the rest of the run."""

    def __call__(
        self, patches: Sequence[Patch], step: int, indexes: Sequence[int], start: Tensor | None = None
    ) -> Tensor:
        """Loss of a batch, mean over its patches. All randomness follows from step and indexes.

        ``start`` holds their first estimates where they are known.
        """
        ...

    def start(self, patches: Sequence[Patch], step: int, indexes: Sequence[int]) -> Tensor:
        """First estimates of a batch, as the same step makes them."""
        ...

    def groups(self) -> dict[str, list[nn.Parameter]]:
        """``"decoder"`` and groups of codes, those of ``OptimiserSettings.code_rates``; any may be empty."""
        ...

    def anneal(self, slope: float) -> None:
        """Set the slope of the codes' surrogate derivative."""
        ...

    def hold(self) -> None:
        """Called after every step: bring the codes back to what is demanded of them."""
        ...

    def figures(self) -> dict[str, float]:
        """Numbers for the log, such as the light throughput."""
        ...

    def validate(self) -> dict[str, float]:
        """Figures of merit on the validation scenes; ``"score"``, else ``"psnr"``, chooses the best checkpoint."""
        ...
