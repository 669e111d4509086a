"""Options of a bench with a mask before the sensor, in metres."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Group, Parameter

from tmca.cli.options.output import warned
from tmca.errors import SettingError

if TYPE_CHECKING:
    from tmca.optics import MaskGeometry

_BENCH = Group("Bench", sort_key=2)
_Metres = Annotated[float | None, Parameter(group=_BENCH)]
_NEEDED = ("aperture_distance", "aperture_width", "pixel_pitch")


@Parameter(name="*")
@dataclass(frozen=True)
class LightFieldBenchOptions:
    """Where the mask stands, in the place of --shear and --mask-scale; nothing, or at least the first three."""

    aperture_distance: _Metres = None
    "From the sensor to the aperture of the lens, metres."
    aperture_width: _Metres = None
    "Of the aperture, which the views share out evenly, metres."
    pixel_pitch: _Metres = None
    "Of the sensor, metres."
    mask_distance: _Metres = None
    "From the sensor to the mask, metres; without it that at which --mask-pitch fits, or --shear."
    mask_pitch: _Metres = None
    "Of the mask's pixels, metres. [default: (1-s)·p, so that they fall on sensor pixels]"

    def given(self) -> bool:
        """Whether there is any."""
        return any(value is not None for value in vars(self).values())

    def chosen(self, views: tuple[int, int], camera: dict[str, Any]) -> dict[str, Any]:
        """Arguments of the camera with the bench's shear and mask scale; they are said on standard error.

        Args:
            views: (V, U).
            camera: arguments that were given by other options; ``shear`` is one of the bench's.

        Raises:
            SettingError: a length that is missing or impossible, or beside another that says the same.
        """
        if not self.given():
            return camera
        own = dict(camera)
        if "mask_scale" in own:
            raise SettingError("--mask-scale", "beside a bench", "one of them", "leave it out: the bench says it")
        bench = self._bench(views, own.pop("shear", None))
        shear = bench.shear(self.mask_pitch)
        warned(
            f"mask of pitch {(self.mask_pitch or bench.mask_pitch) * 1e6:.5g} µm at {bench.mask_distance * 1e3:.5g} mm "
            f"from the sensor: {shear.step[0]:.5g} mask pixels per view, {shear.scale:.6g} per sensor pixel"
        )
        return {**own, "shear": shear.step, "mask_scale": shear.scale}

    def _bench(self, views: tuple[int, int], shear: tuple[float, float] | None) -> MaskGeometry:
        from tmca.optics import MaskGeometry

        own: dict[str, Any] = {name: getattr(self, name) for name in _NEEDED}
        gone = [f"--{name.replace('_', '-')}" for name, value in own.items() if value is None]
        if gone:
            raise SettingError(gone[0], "none", "a bench needs it", "give it in metres")
        own["views"] = views[0]
        if shear is not None and (self.mask_distance is not None or self.mask_pitch is not None):
            raise SettingError("--shear", "beside --mask-distance or --mask-pitch", "one of them")
        if self.mask_distance is not None:
            return MaskGeometry(self.mask_distance, **own)
        if self.mask_pitch is not None:
            return MaskGeometry.for_pitch(self.mask_pitch, **own)
        if shear is not None and shear[0] != shear[1]:
            raise SettingError("--shear", f"{shear[0]:g},{shear[1]:g}", "one number beside a bench")
        return MaskGeometry.for_shear(1.0 if shear is None else shear[0], **own)
