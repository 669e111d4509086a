"""A bench that runs: exposures decoded as they come, shown and recorded."""

from tmca.lab.live.exposures import Exposures, Taken
from tmca.lab.live.loop import Live, Shown
from tmca.lab.live.recording import Recording, recorded

__all__ = ["Exposures", "Live", "Recording", "Shown", "Taken", "recorded"]
