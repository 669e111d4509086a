"""A bench that runs: exposures decoded as they come, shown and recorded."""

from tmca.lab.live.exposures import Exposure, Exposures
from tmca.lab.live.loop import Live, Shown
from tmca.lab.live.recording import Recording, check_recording, frames_recorded, is_recording, last_recorded, recorded

__all__ = [
    "Exposure",
    "Exposures",
    "Live",
    "Recording",
    "Shown",
    "check_recording",
    "frames_recorded",
    "is_recording",
    "last_recorded",
    "recorded",
]
