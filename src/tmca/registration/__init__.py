"""In register by itself: where the mask lies, read from the snapshot alone."""

from tmca.registration.placement import Placement
from tmca.registration.register import NotRegistered, Registered, register

__all__ = ["NotRegistered", "Placement", "Registered", "register"]
