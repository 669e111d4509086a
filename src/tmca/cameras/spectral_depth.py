"""The spectral-depth camera: a phase mask that changes K times within one exposure, filters, shutter (thesis 5)."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import torch
from torch import Tensor, nn

from tmca.arguments import Count, Float, Floats, Int, Names, Pair, Seed, Size, checked
from tmca.attributes import attributes_of
from tmca.cameras.attributes import CameraAttributes
from tmca.cameras.coded import BandCamera
from tmca.cameras.phase_settings import FAMILIES, phase_settings
from tmca.cameras.sensor_tiles import exposed_in_tiles
from tmca.codes import shutter_plane
from tmca.codes.arrays import Array
from tmca.codes.buckets import bucket_shutters
from tmca.codes.files import TILE, by_bucket, compact, slotted, tensors
from tmca.errors import SettingError, check_choice
from tmca.operators.spectral_depth import LayeredOperator, check_pixel, equivalent_psf, framed, transfer_functions
from tmca.optics import (
    MODES,
    DepthPlanes,
    HeightMaps,
    PhaseAttributes,
    PhaseMaskBench,
    PointSpread,
    Stroke,
    family_parameters,
    mask_maps,
)
from tmca.sensor import ColourCodedAperture, channel_response
from tmca.specs import SpectralDepthSpec

_RESPONSE = {"units": "1", "long_name": "response of a channel of the sensor"}

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from tmca.plots.thumbnails import Panel

IMAGE_FORMATIONS = ("linear", "occlusion")
LEARNABLE = ("mask", "shutter", "filters")
PROBE = (512, 512)
"""Pixels of a camera that is only asked what it is, or whether it can be: any tile fits."""
_SHARED = {"size", "buckets", "exposure", "image_formation", "sensor", "filters"}
"""Parts that leave optics and codes as they are."""
_THESIS: dict[str, Any] = {
    # thesis 5.2: 25 bands from 440 to 680 nm, K = 4, eight planes from 0.4 to 2.0 m, R = 4 filters, 256×256 patches.
    # Assumed, as the thesis does not say: a mirror in the pupil of a lens of 50 mm focused in the middle of the range,
    # an aperture of 3.5 mm, pixels of 8 µm, Q = 4, pass bands side by side as filters, a camera's RGB response, equal
    # exposure time, point spread functions of unit energy, dark around the patch, no noise.
    "bands": tuple((440 + 10 * band) * 1e-9 for band in range(25)),
    "size": (256, 256),
    "slots": 4,
    "depth": (0.4, 2.0),
    "planes": 8,
    "bench": PhaseMaskBench(diameter=3.5e-3, distance=50e-3, pitch=8e-6, window=(63, 63), mask_pixels=96),
    "mask": "zernike",
    "shutter": "random",
    "filters": "gaussian",
    "period": 4,
    "channels": "rgb",
}
_MASK_ONLY: dict[str, Any] = {"slots": 1, "shutter": "open", "filters": "clear"}
_QUICK: dict[str, Any] = {
    # a step of training takes about a second on a processor, less where codes are fixed
    "bands": tuple((440 + 240 / 7 * band) * 1e-9 for band in range(8)),
    "size": (96, 96),
    "bench": PhaseMaskBench(),
}
PRESETS: dict[str, dict[str, Any]] = {
    "thesis": _THESIS,
    "diffractive": {**_THESIS, **_MASK_ONLY},  # its baseline, a phase mask only (Baek 2021)
    "quick": {**_THESIS, **_QUICK},
    "quick-diffractive": {**_THESIS, **_QUICK, **_MASK_ONLY},
}


class SpectralDepthAttributes(CameraAttributes, PhaseAttributes):
    """Of the whole camera."""

    image_formation: str = "linear"


class PhaseCodes(nn.Module):
    """Height maps, with the point spread functions that they make, and shutter patterns (K, H, W): what a camera shows.

    Called, it gives the height maps (K, Hm, Wm) in metres and the shutter.
    """

    def __init__(self, optics: PointSpread, shutter: nn.Module) -> None:
        super().__init__()
        self.optics, self.shutter = optics, shutter

    def forward(self) -> tuple[Tensor, Tensor]:
        return self.optics.heights(), self.shutter()


class SpectralDepthCamera(BandCamera):
    """A snapshot camera for spectrum and depth with a time-multiplexed phase mask.

    ``e_{c,m,n} = (1/K) Σ_k S^k_{m,n} Σ_ℓ κ_{c,ℓ} C_{ℓ,m,n} Σ_d (p_{k,d,ℓ} * ω_d f_ℓ)_{m,n}`` (thesis eqs 30–36,
    errata), then noise. With ``slots=1, shutter="open", filters="clear"`` only the phase mask codes.

    >>> camera = SpectralDepthCamera.from_preset("quick", size=(32, 40))
    >>> camera(torch.rand(1, 8, 32, 40), torch.full((1, 1, 32, 40), 0.8)).shape
    torch.Size([1, 3, 32, 40])

    Args:
        bands: number of bands L, or their wavelengths in metres. A number means even spacing from 400 to 700 nm; left
            out, 8 until the camera is bound to a scene.
        size: (H, W) of the scene and the sensor, pixels; dark around the scene, which darkens the linear model's rim.
            Left out, 96×96 until the camera is bound to a scene.
        slots: number of time slots K within the exposure.
        depth: nearest and farthest plane, metres.
        planes: number of depth planes D, even in inverse depth.
        bench: distances, pitches and sizes.
        mask: family of the height maps (``tmca.optics.FAMILIES``), the maps (K, H, W) in metres, or ``HeightMaps``.
        rms: of random heights, metres.
        modes: number of Zernike modes of random heights.
        stroke: of the device that shows them; any height without, or that of ``HeightMaps``.
        shutter: family of the shutter codes (``tmca.codes.FAMILIES``; ``"one-hot"`` opens as many pixels of a tile in
            every slot) or patterns (K, H, W), or (K, Q, Q) of a tile, or a module that gives patterns (K, H, W).
        filters: family of the feasible filters (``tmca.sensor.FILTERS``), transmittances (R, L), or a
            ``ColourCodedAperture``.
        cells: (Q, Q) index of the filter over every pixel; random if None.
        period: tile Q of shutter and filters, pixels.
        channels: of the sensor: ``"monochrome"``, ``"rgb"``, or responses (C, L).
        exposure: ``"equal"``: the slots share one exposure time (mean); ``"per-slot"``: each has its own (sum).
        energy: of the point spread functions, see ``tmca.optics.PointSpread``.
        image_formation: ``"linear"``, or ``"occlusion"``: near layers hide far ones.
        sensor: noise, full well, bits; an ideal sensor if None.
        seed: of mask, shutter and filters.
        learnable: ``True``, ``False``, or some of ``"mask"``, ``"shutter"``, ``"filters"``.
        codes: masks with their optics, and shutter, as a module, in the place of what describes them.
        buckets: R of a pixel: with one, the light of closed slots is lost; with two, it is in the second.

    Raises:
        SettingError, ShapeError: an impossible value, or parts that do not fit.
    """

    kind = "spectral-depth"
    Spec = SpectralDepthSpec
    drawn: ClassVar = {"rms": ("mask",), "modes": ("mask",), "seed": ("mask", "shutter", "filters")}
    presets = PRESETS
    plane_names = ("heights", "shutter")
    needed = ("heights", "shutter", "filters", "cells", "response", "wavelength")
    attributes = SpectralDepthAttributes
    response: Tensor

    @checked
    def __init__(
        self,
        bands: Int | Floats | None = None,
        size: Size | None = None,
        slots: Count = 4,
        *,
        depth: Pair = (0.4, 2.0),
        planes: Int = 8,
        bench: PhaseMaskBench | None = None,
        mask: str | Array | HeightMaps = "zernike",
        rms: Float = 0.1e-6,
        modes: Int = MODES,
        stroke: Stroke | None = None,
        shutter: str | Array | nn.Module = "one-hot",
        filters: str | Array | ColourCodedAperture = "clear",
        cells: Array | None = None,
        period: Count = 4,
        channels: str | Array = "monochrome",
        exposure: str = "equal",
        energy: str = "unit",
        image_formation: str = "linear",
        sensor: Annotated[nn.Module | None, "a Sensor"] = None,
        seed: Seed = 0,
        learnable: bool | Names = False,
        codes: PhaseCodes | None = None,
        buckets: Count = 1,
    ) -> None:
        super().__init__((96, 96) if size is None else size, slots, exposure, sensor, buckets)
        named = (learnable,) if isinstance(learnable, bool) else learnable
        for part in named:
            check_choice("learnable", part, (True, False, *LEARNABLE))
        learned = LEARNABLE if True in named else named
        self._hold_bands(8 if bands is None else bands)
        self.planes = DepthPlanes(*depth, planes)
        self.bench, self.period = bench or PhaseMaskBench(), period
        self.psf_window = self.bench.window
        check_choice("image_formation", image_formation, IMAGE_FORMATIONS)
        self.image_formation = image_formation
        self.register_buffer("response", channel_response(channels, self.wavelengths))
        if codes is None:
            drawn: dict[str, Any] = {"rms": rms, "modes": modes, "seed": seed, "stroke": stroke}
            heights = mask_maps(mask, slots, self.bench, learnable="mask" in learned, **drawn)
            optics = self.bench.point_spread(heights, self.wavelengths, self.planes, energy)
        self.point_spread = optics if codes is None else codes.optics
        given = shutter if codes is None else codes.shutter
        self.shutter = shutter_plane(given, slots, buckets, self.size, self.period, seed, "shutter" in learned)
        self.filters = ColourCodedAperture.of(
            filters, self.wavelengths, self.size, self.period, cells, seed, learnable="filters" in learned
        )
        if "filters" in named and len(self.filters.filters) == 1:
            raise SettingError("learnable", "filters, of which there is one", "two filters or more, such as gaussian")

    def _check_parts(self, parts: Mapping[str, Any]) -> None:
        super()._check_parts(parts)
        if self._given.get("codes") is not None and "codes" not in parts:
            for name in ("mask", "stroke", "shutter"):
                if name in parts:
                    raise SettingError(name, "a part of codes that are a module", "codes as a whole", "replace codes")

    def _described(self, parts: Mapping[str, Any]) -> dict[str, Any]:
        made, stale = super()._described(parts), self._outdated(parts)
        codes, filters = made.get("codes"), made.get("filters")
        shown = {} if codes is None else {"mask": codes, "shutter": codes}
        drawn = not isinstance(filters, nn.Module) and (made.get("cells") is None or "cells" in stale)
        return {**made, **shown, "filters": "drawn" if drawn else filters}

    def _outdated(self, parts: Mapping[str, Any]) -> set[str]:
        """Cells count the filters that they were drawn for."""
        filters = parts.get("filters")
        named = isinstance(filters, str | nn.Module)
        table = not named and filters is not None and len(filters) == len(self.filters.filters)
        return set() if filters is None or table or "cells" in parts else {"cells"}

    def _shared(self, parts: set[str]) -> dict[str, Any]:
        """Optics, shutter and filters are made anew where what describes them changes."""
        if self.unbound or ("codes" not in parts and parts - _SHARED):
            return super()._shared(parts)
        made = {"codes": self.codes, "filters": self.filters, "channels": self.response}
        return {**super()._shared(parts), **made}

    @property
    def codes(self) -> PhaseCodes:
        """Masks and shutter."""
        return PhaseCodes(self.point_spread, self.shutter)

    @property
    def white(self) -> float:
        """Level of a white scene in the channel that sees most."""
        return float(self.response.detach().sum(1).max())

    @property
    def snapshot_shape(self) -> tuple[int, int, int]:
        """(R·C, H, W) of R buckets."""
        return (self.buckets * len(self.response), *self.size)

    def colour(self) -> Tensor:
        """(C, L, H, W) filters over every pixel times the response of the sensor's channels."""
        return self.response[:, :, None, None] * self.filters()

    @property
    def tile_size(self) -> int:
        """Side Q of the tile of shutter and filters; SettingError for shutter patterns that do not repeat."""
        if self.shutter.period is None:
            raise SettingError("shutter", "patterns of the whole sensor", "a tile", "give (K, Q, Q) patterns")
        return self.period

    def tile(self) -> tuple[Tensor, Tensor]:
        """(colour (C, L, Q, Q), shutters (R, K, Q, Q) of the buckets) of one tile; see ``codes_over``."""
        side = slice(0, self.tile_size)
        return self.codes_over(side, side)

    def codes_over(self, rows: slice, columns: slice) -> tuple[Tensor, Tensor]:
        """(colour (C, L, h, w), shutters (R, K, h, w) of the buckets) over some pixels."""
        colour = self.response[:, :, None, None] * self.filters.part(rows, columns)
        return colour, bucket_shutters(self.shutter.part(rows, columns), self.slots, self.buckets)

    def psf(self) -> Tensor:
        """(K, D, L, h, w) point spread functions, planes from far to near."""
        psf: Tensor = self.point_spread()
        return psf

    def equivalent_psf(self, pixel: tuple[int, int], plane: int) -> Tensor:
        """(R·C, L, h, w) what a point at a pixel and depth plane leaves on the sensor, eq. (35)."""
        check_pixel(pixel, self.size)
        rows, columns = (
            slice(max(0, place - side), min(length, place + side + 1))
            for place, side, length in zip(pixel, self.bench.window, self.size, strict=True)
        )
        colour, shutters = self.codes_over(rows, columns)
        place = (pixel[0] - rows.start, pixel[1] - columns.start)
        psf = self.psf()
        seen = [equivalent_psf(psf, colour, one, place, plane, self.exposure) for one in shutters]
        return torch.cat(seen)

    def throughput(self) -> float:
        """Share of a white scene's light that is recorded, mean over channels."""
        with torch.no_grad():
            open_share = bucket_shutters(self.shutter(), self.slots, self.buckets).sum(0).mean(0)
            passed = (self.filters.filters @ self.response.T / self.response.sum(1)).mean(1)
            light = 1.0 if self.point_spread.energy == "unit" else float(self.point_spread.arrived().mean())
            return float((self.filters.plane() * open_share).mean((1, 2)) @ passed) * light

    def transfer(self, frame: tuple[int, int] | None = None) -> Tensor:
        """(K, D, L, H', W'/2+1) transfer functions in a ``frame``, the camera's own if None; cached unless learned."""
        frame = frame or self.frame
        return self.cached(f"transfer {frame}", lambda: transfer_functions(self.psf(), frame))

    @property
    def frame(self) -> tuple[int, int]:
        """(H', W') that holds the scene and its blur."""
        return framed(self.size, self.bench.window)

    def build_operator(self, depth: Tensor | None = None) -> LayeredOperator:
        """The linear part at depth maps (B, 1, H, W) in metres, every pixel in its ``planes.nearest``."""
        weights = self.planes.weights(_required(depth)).to(self.response)
        shown = bucket_shutters(self.shutter(), self.slots, self.buckets)
        return LayeredOperator(weights, self.transfer(), self.frame, self.colour(), shown, self.exposure)

    def exact(
        self, scene: Tensor, depth: Tensor | None = None, progress: Callable[[float], None] | None = None
    ) -> Tensor:
        """Exact snapshot (B, C, H, W), a large one in tiles; arguments as ``forward``.

        What lies outside the design range is imaged in the plane of that end, what is no depth in the farthest
        (``planes.nearest``).
        """
        return exposed_in_tiles(self, scene, _required(depth), progress)

    def fitted(self, scene: Any) -> Any:
        """See ``Camera``; depth beyond the camera's range is mapped onto it."""
        from tmca.data.fitting import fit_depth_scene

        return fit_depth_scene(scene, self.wavelengths, self.size, self.planes.near, self.planes.far)

    def _panels(self) -> list[Panel]:
        return self._plane_panels(self.codes())

    def plot(self) -> Figure:
        """Heights and shutter of every slot, filters over the pixels of a tile, and what filters and sensor pass."""
        from tmca.plots.codes import phase_codes_figure

        with torch.no_grad():
            shown = bucket_shutters(self.shutter(), self.slots, self.buckets)
            parts = (self.codes.optics.heights(), shown, self.filters.cells(), self.filters.filters, self.response)
            heights, shutter, cells, filters, response = (part.numpy(force=True) for part in parts)
        return phase_codes_figure(heights, shutter, cells, filters, response, self.wavelengths)

    def snapshot_axes(self, snapshots: Tensor) -> tuple[str, ...]:
        return (*super().snapshot_axes(snapshots)[:-2], "channel", "y", "x")

    def _variables(self, tiled: bool) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
        """``heights`` (slot, y_mask, x_mask) in metres, ``shutter`` (slot, y_tile, x_tile), or (slot, y, x) where it
        does not repeat, ``filters`` (filter, wavelength), ``cells`` (y_tile, x_tile), the index of the filter over
        every pixel, and ``response`` (channel, wavelength); tiled, also the parameters of the masks' family.

        Attributes: exposure, bench, depth planes, energy, sensor.
        """
        heights, passed = self.point_spread.heights, self.filters.filters.numpy(force=True)
        shown = {"units": "m", "long_name": "height of the mask, larger = longer path: on a mirror, deeper"}
        patterns, axes = by_bucket(self.shutter.tile(), self.slots, TILE if self.shutter.period else ("y", "x"))
        parts: dict[str, Any] = {
            "heights": (("slot", "y_mask", "x_mask"), heights().numpy(force=True), shown),
            "shutter": (slotted(axes), compact(patterns), {"units": "1 = open", "long_name": "shutter codes S"}),
            "filters": (("filter", "wavelength"), passed, {"units": "1", "long_name": "transmittance of a filter"}),
            "cells": (TILE, self.filters.cells().numpy(force=True), {"units": "1", "long_name": "filter over a pixel"}),
            "response": (("channel", "wavelength"), self.response.numpy(force=True), _RESPONSE),
        }
        optics = {
            "bench": json.dumps(asdict(self.bench)), "depth": json.dumps(asdict(self.planes)),
            "energy": self.point_spread.energy, "image_formation": self.image_formation,
        }  # fmt: skip
        if tiled:
            self.tile()  # refuses patterns that do not repeat
            for name, values in family_parameters(heights).items():
                parts[name] = (FAMILIES[name][0], values.numpy(force=True), FAMILIES[name][1])
            optics |= {} if heights.stroke is None else {"stroke": json.dumps(asdict(heights.stroke))}
        return parts, self._band_coordinates(), optics

    @classmethod
    def _settings(cls, dataset: xr.Dataset, where: str) -> dict[str, Any]:
        """Without a snapshot or a size beside it the size is that of the tile."""
        parts = tensors(dataset, where, "shutter", "filters", "response")
        stated = attributes_of(SpectralDepthAttributes, dataset.attrs, where)
        return {
            **phase_settings(dataset, where, stated),
            "bands": dataset["wavelength"].values.tolist(),
            "size": tuple(dataset.sizes.get(axis, parts["shutter"].shape[-1]) for axis in ("y", "x")),
            "filters": parts["filters"],
            "channels": parts["response"],
            "image_formation": stated.image_formation,
        }


def _required(depth: Tensor | None) -> Tensor:
    if depth is None:
        raise SettingError("depth", "none", "a depth map (B, 1, H, W) in metres, for a spectral-depth camera")
    return depth
