"""Options of a search for phase masks: the bench, the device that shows them, and what is searched."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Group, Parameter

from tmca.cli.options.numbers import MaybeWhole, Whole
from tmca.cli.options.sheets import whole_numbers
from tmca.cli.spectral_depth import depth_range

if TYPE_CHECKING:
    from tmca.design import MaskEffort

_BENCH = Group("Camera", sort_key=0)
_SEARCH = Group("Search", sort_key=2)
_Metres = Annotated[float | None, Parameter(group=_BENCH)]
_Text = Annotated[str | None, Parameter(group=_BENCH)]


@Parameter(name="*")
@dataclass(frozen=True)
class MaskCameraOptions:
    """The camera of the masks, and the device that shows them."""

    preset: Annotated[str, Parameter(group=_BENCH)] = "quick"
    "Camera whose bench, bands and planes are taken: quick or thesis."
    depth: _Text = None
    "NEAR,FAR of the depth planes, metres. [default: 0.4,2]"
    planes: Annotated[MaybeWhole, Parameter(group=_BENCH)] = None
    "Number of depth planes, even in inverse depth. [default: 8]"
    bands: Annotated[Whole, Parameter(group=_BENCH)] = 4
    "Bands that are searched, evenly over those of the preset; more take longer."
    filters: Annotated[str, Parameter(group=_BENCH)] = "clear"
    "Colour filters over the pixels: clear, gaussian or rgbw."
    channels: Annotated[str, Parameter(group=_BENCH)] = "monochrome"
    "Of the sensor: monochrome or rgb."
    period: Annotated[MaybeWhole, Parameter(group=_BENCH)] = None
    "Tile of shutter and filters, pixels. [default: 4]"
    stroke: _Metres = None
    "Largest height range that the device can show, metres. [default: any]"
    levels: Annotated[MaybeWhole, Parameter(group=_BENCH)] = None
    "Number of heights that the device can show, evenly within --stroke. [default: any]"

    def described(self) -> dict[str, Any]:
        """Arguments of ``design_spectral_depth``."""
        camera = {name: getattr(self, name) for name in ("filters", "channels", "planes", "period")}
        camera = {name: value for name, value in camera.items() if value is not None}
        if self.depth is not None:
            camera["depth"] = depth_range(self.depth)
        own = {name: getattr(self, name) for name in ("preset", "bands", "stroke", "levels")}
        return {**own, "camera": camera}


@Parameter(name="*")
@dataclass(frozen=True)
class MaskSearchOptions:
    """What is searched."""

    prior: Annotated[Path | None, Parameter(group=_SEARCH)] = None
    "Gaussian prior of the searched bands, instead of SCENES."
    slots: Annotated[str | None, Parameter(group=_SEARCH)] = None
    "Numbers of slots to try, separated by commas; 1 is always tried. [default: those of 1, 2, 4 that fit the exposure]"
    shutter: Annotated[str, Parameter(group=_SEARCH)] = "one-hot"
    "Beside several slots: one-hot, random, open, complementary or blue-noise; with one slot it is open."
    mask: Annotated[str, Parameter(group=_SEARCH)] = "zernike"
    "Family of the masks: zernike, free-form or rotational."
    rms_nm: Annotated[float | None, Parameter(group=_SEARCH)] = None
    "Of the random masks that searches start from, nm. [default: 100, less where the stroke is small]"
    modes: Annotated[Whole, Parameter(group=_SEARCH)] = 18
    "Zernike modes of the masks, from defocus on; 18 are those of a mirror with 40 actuators."
    learn: Annotated[str, Parameter(group=_SEARCH)] = "mask"
    "What is searched: some of mask, shutter, filters, separated by commas."
    window: Annotated[Whole, Parameter(group=_SEARCH)] = 8
    "Side of the windows of a snapshot that are judged, pixels."
    starts: Annotated[Whole, Parameter(group=_SEARCH)] = 3
    "Descents for every number of slots."
    steps: Annotated[Whole, Parameter(group=_SEARCH)] = 40
    "Of every descent."
    seed: Annotated[Whole, Parameter(group=_SEARCH)] = 0
    "Of random masks, shutter and filters."
    overwrite: Annotated[bool, Parameter(group=_SEARCH, negative="")] = False
    "Replace files that exist."

    def search(self) -> dict[str, Any]:
        """Arguments of ``design_spectral_depth``."""
        own = {
            name: getattr(self, name) for name in ("prior", "shutter", "mask", "modes", "window", "seed", "overwrite")
        }
        learn = [part for part in self.learn.split(",") if part not in ("", "none")]
        rms = None if self.rms_nm is None else self.rms_nm * 1e-9
        told = {"effort": self._effort(), "command": ["tmca", *sys.argv[1:]]}
        return {**own, **told, "slots": whole_numbers(self.slots), "learn": learn, "rms": rms}

    def _effort(self) -> MaskEffort:
        from tmca.design import MaskEffort

        return MaskEffort(self.starts, self.steps)
