"""Specs of benches: where a mask stands before the sensor, and a phase mask's optics."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import AfterValidator, Field

from tmca.errors import SettingError
from tmca.specs.base import Length, Spec

_NEEDED = ("aperture_distance", "aperture_width", "pixel_pitch")


class MaskPlaceSpec(Spec):
    """Where the mask stands, in the place of --shear and --mask-scale; nothing, or at least the first three."""

    aperture_distance: Length | None = None
    "From the sensor to the aperture of the lens, metres."
    aperture_width: Length | None = None
    "Of the aperture, which the views share out evenly, metres."
    pixel_pitch: Length | None = None
    "Of the sensor, metres."
    mask_distance: Length | None = None
    "From the sensor to the mask, metres; without it that at which --mask-pitch fits, or --shear."
    mask_pitch: Length | None = None
    "Of the mask's pixels, metres. [default: (1-s)·p, so that they fall on sensor pixels]"

    def lengths(self) -> dict[str, float]:
        """Those that every bench needs.

        Raises:
            SettingError: one that is missing.
        """
        for name in _NEEDED:
            if getattr(self, name) is None:
                raise SettingError(name, "none", "a length in metres: a bench needs it")
        return self.given("mask_distance", "mask_pitch")


def _odd(pixels: int) -> int:
    if pixels % 2 == 0:
        raise ValueError("an odd number of pixels")
    return pixels


class PhaseBenchSpec(Spec):
    """The bench of a phase mask; what is not given is the preset's."""

    aperture: Length | None = None
    "Diameter, metres."
    distance: Length | None = None
    "From the mask to the sensor, metres; of a 4f bench its focal length."
    focus: Annotated[float, Field(gt=0, allow_inf_nan=True)] | None = None
    "Distance of sharp objects, metres."
    lens: bool = True
    "Whether there is a lens at the mask; without, the mask alone focuses."
    pitch: Length | None = None
    "Of the sensor's pixels, metres."
    material: str | None = None
    "Of the mask: mirror, a material such as PMMA, or a .yml file of refractiveindex.info."
    psf_window: Annotated[int, Field(ge=1, le=8191), AfterValidator(_odd)] | None = None
    "Side of the point spread functions, pixels of the sensor, odd."
    mask_pixels: Annotated[int, Field(le=16384)] | None = None
    "Along the aperture's diameter, of the height maps."
    oversampling: Annotated[int, Field(le=64)] | None = None
    "Samples per side of a pixel, over whose area light is summed."

    def arguments(self) -> dict[str, Any]:
        """Arguments of `tmca.optics.PhaseMaskBench` that were given.

        Raises:
            SettingError: a focus without a lens.
        """
        given = self.given("lens", "aperture", "psf_window")
        if not self.lens and self.focus is not None:
            raise SettingError("focus", f"{self.focus:g} m beside --no-lens", "one of them")
        given |= {} if self.lens else {"focus": None}
        given |= {"diameter": self.aperture} if self.aperture is not None else {}
        return given | ({"window": (self.psf_window, self.psf_window)} if self.psf_window is not None else {})
