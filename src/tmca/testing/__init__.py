"""What operators, cameras and decoders have to hold to: checks for a test suite of your own, with any test runner."""

from tmca.testing.cameras import check_camera
from tmca.testing.decoders import check_decoder
from tmca.testing.operators import check_operator

__all__ = ["check_camera", "check_decoder", "check_operator"]


def __dir__() -> list[str]:
    return sorted(__all__)
