"""What other packages name in entry points: cameras, priors, decoders, which register themselves once imported."""

from __future__ import annotations

from functools import cache
from importlib.metadata import entry_points
from warnings import warn


class BrokenPlugin(UserWarning):
    """A camera, prior or decoder of another package that cannot be loaded."""


@cache
def load_plugins(group: str) -> None:
    """Import, once, what other packages name in an entry-point group; what fails is warned of and left out.

    Args:
        group: such as ``tmca.decoders``.
    """
    for point in entry_points(group=group):
        try:
            point.load()
        except (Exception, SystemExit) as error:
            what, reason = group.removeprefix("tmca.").removesuffix("s"), f"{type(error).__name__}: {error}"
            warn(f"{what} {point.name} ({point.value}) cannot be loaded: {reason}", BrokenPlugin, stacklevel=2)
