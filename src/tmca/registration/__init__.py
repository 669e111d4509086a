"""In register by itself: where the mask lies, read from the snapshot alone."""

from tmca.registration.face import NotRegistered, Registered, register
from tmca.registration.placement import MaskPlacement

__all__ = ["MaskPlacement", "NotRegistered", "Registered", "register"]


def __dir__() -> list[str]:
    return sorted(__all__)
