"""Specs of searches: for codes of a sensor, and for phase masks."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from tmca.specs.base import Distances, Length, Seed, Share, Spec, Whole, Wholes, Words


class CodeSearchSpec(Spec):
    """A search for codes; its fields are arguments of `tmca.reports.codes.design_codes`."""

    slots: Wholes | None = None
    "Numbers of slots to try, separated by commas. [default: those of 2, 4, 8, 16 that fit the exposure]"
    kinds: Words | None = None
    """Structures of codes to try: free, one-hot, complementary, blue-noise, s-matrix; open-shutter where each pixel
    cannot have a shutter of its own, static-aperture where the mask stands still; two-bucket with --buckets 2. A burst
    of two frames in the same time is always tried beside them. [default: free,one-hot, and two-bucket with --buckets
    2]"""
    throughput: Share | None = None
    "Share of light that codes shall let through, as near as their kind allows. [default: free]"
    light: Share | None = None
    """Mean irradiance that SCENES are dimmed to before codes are searched, share of white: the same scenes under less
    light, where noise weighs more. [default: as they are]"""
    within: Annotated[float, Field(ge=0, le=1)] = 0.1
    """Of codes whose gains differ by less than this share of the largest, or by less than 0.1 dB, those of the fewest
    slots are taken; 0: by less than 0.1 dB alone."""
    quick: bool = False
    """A first look in under a minute: all searches take a quarter of the survey's effort, on tiles of 16 pixels, and
    end some tenths of a dB lower."""
    seed: Seed = 0
    "Of random codes."


class MaskCameraSpec(Spec):
    """The camera of masks that are searched, and the device that shows them."""

    preset: str = "quick"
    "Camera whose bench, bands and planes are taken: quick or thesis."
    depth: Distances | None = None
    "NEAR,FAR of the depth planes, metres. [default: 0.4,2]"
    planes: Whole | None = None
    "Number of depth planes, even in inverse depth. [default: 8]"
    bands: Whole = 4
    "Bands that are searched, evenly over those of the preset; more take longer."
    filters: str = "clear"
    "Colour filters over the pixels: clear, gaussian or rgbw."
    channels: str = "monochrome"
    "Of the sensor: monochrome or rgb."
    period: Whole | None = None
    "Tile of shutter and filters, pixels. [default: 4]"
    stroke: Length | None = None
    "Largest height range that the device can show, metres. [default: any]"
    levels: Whole | None = None
    "Number of heights that the device can show, evenly within --stroke. [default: any]"

    def arguments(self) -> dict[str, Any]:
        """Arguments of `tmca.reports.masks.design_spectral_depth`."""
        camera = {name: getattr(self, name) for name in ("filters", "channels", "depth", "planes", "period")}
        device = {name: getattr(self, name) for name in ("preset", "bands", "stroke", "levels")}
        return {**device, "camera": {name: value for name, value in camera.items() if value is not None}}


class MaskSearchSpec(Spec):
    """A search for phase masks."""

    prior: Path | None = None
    "Gaussian prior of the searched bands, instead of SCENES."
    slots: Wholes | None = None
    "Numbers of slots to try, separated by commas; 1 is always tried. [default: those of 1, 2, 4 that fit the exposure]"
    shutter: str = "one-hot"
    """Beside several slots: one-hot, random, open, complementary or blue-noise; with one slot it is open, with two
    buckets balanced."""
    mask: str = "zernike"
    "Family of the masks: zernike, free-form or rotational."
    rms_nm: float | None = None
    "Of the random masks that searches start from, nm. [default: 100, less where the stroke is small]"
    modes: int = 18
    "Zernike modes of the masks, from defocus on; 18 are those of a mirror with 40 actuators."
    learn: Words = ("mask",)
    "What is searched: some of mask, shutter, filters, separated by commas."
    window: int = 8
    "Side of the windows of a snapshot that are judged, pixels."
    starts: Whole = 3
    "Descents for every number of slots."
    steps: Whole = 40
    "Of every descent."
    seed: Seed = 0
    "Of random masks, shutter and filters."

    def arguments(self) -> dict[str, Any]:
        """Arguments of `tmca.reports.masks.design_spectral_depth`, without the effort."""
        search = self.model_dump(exclude={"rms_nm", "starts", "steps", "learn"})
        learn = [part for part in self.learn if part != "none"]
        return {**search, "learn": learn, "rms": None if self.rms_nm is None else self.rms_nm * 1e-9}
