"""Options of a bench with a phase mask."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from cyclopts import Group, Parameter

from tmca.cli.options.numbers import MaybeWhole
from tmca.errors import SettingError

_BENCH = Group("Bench", sort_key=2)
_Metres = Annotated[float | None, Parameter(group=_BENCH)]
_Number = Annotated[MaybeWhole, Parameter(group=_BENCH)]
_ARGUMENTS = {"aperture": "diameter", "psf_window": "window"}
"""Options that `PhaseMaskBench` calls otherwise."""


@Parameter(name="*")
@dataclass(frozen=True)
class BenchOptions:
    """The bench of the masks; what is not given is the preset's."""

    aperture: _Metres = None
    "Diameter, metres."
    distance: _Metres = None
    "From the mask to the sensor, metres; of a 4f bench its focal length."
    focus: _Metres = None
    "Distance of sharp objects, metres."
    lens: Annotated[bool, Parameter(group=_BENCH)] = True
    "Whether there is a lens at the mask; without, the mask alone focuses."
    pitch: _Metres = None
    "Of the sensor's pixels, metres."
    material: Annotated[str | None, Parameter(group=_BENCH)] = None
    "Of the mask: mirror, a material such as PMMA, or a .yml file of refractiveindex.info."
    psf_window: _Number = None
    "Side of the point spread functions, pixels of the sensor, odd."
    mask_pixels: _Number = None
    "Along the aperture's diameter, of the height maps."
    oversampling: _Number = None
    "Samples per side of a pixel, over whose area light is summed."

    def named(self) -> list[str]:
        """The options that are given, as they are typed."""
        given = [f"--{name.replace('_', '-')}" for name, value in vars(self).items() if value is not None]
        return [name for name in given if name != "--lens"] + ([] if self.lens else ["--no-lens"])

    def changes(self) -> dict[str, Any]:
        """Arguments of `PhaseMaskBench`.

        Raises:
            SettingError: a focus without a lens, an aperture or a window that cannot be.
        """
        if self.aperture is not None and not 0 < self.aperture < float("inf"):
            raise SettingError("--aperture", f"{self.aperture:g} m", "finite metres above 0")
        if self.psf_window is not None and (self.psf_window < 1 or self.psf_window % 2 == 0):
            raise SettingError("--psf-window", str(self.psf_window), "an odd number of pixels")
        given = {name: value for name, value in vars(self).items() if value is not None and name != "lens"}
        if not self.lens:
            if self.focus is not None:
                raise SettingError("--focus", f"{self.focus:g} m beside --no-lens", "one of them")
            given["focus"] = None
        if self.psf_window is not None:
            given["psf_window"] = (self.psf_window, self.psf_window)
        return {_ARGUMENTS.get(name, name): value for name, value in given.items()}
