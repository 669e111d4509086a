"""The spectral-depth camera: a phase mask that changes K times within one exposure, filters and shutter on the sensor
(thesis section 5)."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor, nn

from tmca.cameras.camera import Camera
from tmca.cameras.checks import band_wavelengths, learned_parts
from tmca.cameras.phase_parts import filter_array, mask_maps, shutter_plane
from tmca.cameras.presets import SPECTRAL_DEPTH
from tmca.cameras.sensor_tiles import SensorTile, bounded_tiles
from tmca.cameras.specs import SpectralDepthSpec
from tmca.cameras.stored import (
    check_complete,
    common_attributes,
    common_settings,
    compact,
    json_attribute,
    made_from,
    tensors,
    wavelength_coordinates,
)
from tmca.errors import DataError, SettingError, ShapeError, check_choice
from tmca.operators.spectral_depth import (
    LayeredOperator,
    check_pixel,
    coded_exposure,
    composited,
    equivalent_psf,
    framed,
    layered,
    transfer_functions,
)
from tmca.optics import (
    MODES,
    DepthPlanes,
    HeightMaps,
    PhaseMaskBench,
    PointSpread,
    Stroke,
    changed_bench,
)
from tmca.sensor import ColourCodedAperture, channel_response

if TYPE_CHECKING:
    import xarray as xr

IMAGE_FORMATIONS = ("linear", "occlusion")
LEARNABLE = ("mask", "shutter", "filters")
_SHARED = ("size", "exposure", "image_formation", "sensor", "shutter", "filters")
"""Parts that leave the optics as they are."""
MEANING_OF_HEIGHTS = {"units": "m", "long_name": "height of the mask, larger = longer path: on a mirror, deeper"}


class SpectralDepthCamera(Camera):
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
        point_spread: the optics with their mask as a module, in the place of what describes them.

    Raises:
        SettingError, ShapeError: an impossible value, or parts that do not fit.
    """

    kind = "spectral-depth"
    channel = "band"
    presets = SPECTRAL_DEPTH
    Spec = SpectralDepthSpec
    needed = ("heights", "shutter", "filters", "cells", "response", "wavelength")
    stated = ("exposure", "bench", "depth", "energy", "full_scale", "sensor")
    page = "docs/spectral-depth.md"
    response: Tensor

    def __init__(
        self,
        bands: int | Sequence[float] | None = None,
        size: tuple[int, int] | None = None,
        slots: int = 4,
        *,
        depth: tuple[float, float] = (0.4, 2.0),
        planes: int = 8,
        bench: PhaseMaskBench | None = None,
        mask: str | Tensor | HeightMaps = "zernike",
        rms: float = 0.1e-6,
        modes: int = MODES,
        stroke: Stroke | None = None,
        shutter: str | Tensor | nn.Module = "one-hot",
        filters: str | Tensor | ColourCodedAperture = "clear",
        cells: Tensor | None = None,
        period: int = 4,
        channels: str | Tensor = "monochrome",
        exposure: str = "equal",
        energy: str = "unit",
        image_formation: str = "linear",
        sensor: nn.Module | None = None,
        seed: int = 0,
        learnable: bool | str | Collection[str] = False,
        point_spread: PointSpread | None = None,
    ) -> None:
        super().__init__((96, 96) if size is None else size, slots, exposure, sensor)
        self.unbound = frozenset(name for name, value in (("bands", bands), ("size", size)) if value is None)
        self._given = {"mask": mask, "rms": rms, "modes": modes, "stroke": stroke, "shutter": shutter, "cells": cells,
                       "filters": filters, "channels": channels, "seed": seed, "learnable": learnable}  # fmt: skip
        learned = learned_parts(learnable, LEARNABLE)
        self.wavelengths = band_wavelengths(8 if bands is None else bands)
        self.planes = DepthPlanes(float(depth[0]), float(depth[1]), planes)
        self.bench, self.period = bench or PhaseMaskBench(), int(period)
        check_choice("image formation", image_formation, IMAGE_FORMATIONS)
        self.image_formation = image_formation
        self.register_buffer("response", channel_response(channels, self.wavelengths))
        if point_spread is None:
            drawn = {"rms": rms, "modes": modes, "seed": seed}
            heights = mask_maps(mask, slots, self.bench, stroke, learnable="mask" in learned, **drawn)
            point_spread = self.bench.point_spread(heights, self.wavelengths, self.planes, energy)
        self.point_spread = point_spread
        self.shutter = shutter_plane(shutter, slots, self.size, self.period, seed, "shutter" in learned)
        self.filters = filter_array(
            filters, self.wavelengths, self.size, self.period, cells, seed, "filters" in learned,
            required=not isinstance(learnable, bool),
        )  # fmt: skip

    def arguments(self) -> dict[str, Any]:
        """See ``Camera``."""
        shared = {
            "size": None if "size" in self.unbound else self.size, "slots": self.slots,
            "depth": (self.planes.near, self.planes.far), "planes": self.planes.count, "bench": self.bench,
            "period": self.period, "exposure": self.exposure, "energy": self.point_spread.energy,
            "image_formation": self.image_formation, "sensor": self.sensor,
        }  # fmt: skip
        if self.unbound:
            return {"bands": None if "bands" in self.unbound else self.wavelengths, **shared, **self._given}
        made = {"shutter": self.shutter, "filters": self.filters, "channels": self.response}
        return {"bands": self.wavelengths, **shared, **made, "point_spread": self.point_spread}

    def replace(self, **parts: Any) -> SpectralDepthCamera:
        """See ``Camera``; optics, shutter and filters are made anew where what describes them changes."""
        if "point_spread" not in parts and set(parts) - {*_SHARED}:
            parts = {**self._given, "point_spread": None, **parts}
        return super().replace(**parts)

    def _more_arguments(self) -> tuple[str, ...]:
        return tuple(self._given)

    @property
    def white(self) -> float:
        """Level of a white scene in the channel that sees most."""
        return float(self.response.detach().sum(1).max())

    @property
    def bands(self) -> int:
        """L."""
        return len(self.wavelengths)

    @property
    def channel_names(self) -> list[str]:
        """Wavelengths of the bands."""
        return [f"{w * 1e9:.0f} nm" for w in self.wavelengths]

    @property
    def scene_shape(self) -> tuple[int, int, int]:
        """(L, H, W)."""
        return (self.bands, *self.size)

    @property
    def snapshot_shape(self) -> tuple[int, int, int]:
        """(C, H, W)."""
        return (len(self.response), *self.size)

    def codes(self) -> tuple[Tensor, Tensor]:
        """(height maps (K, Hm, Wm) in metres, shutter (K, H, W) of zeros and ones)."""
        return self.point_spread.heights(), self.shutter()

    def colour(self) -> Tensor:
        """(C, L, H, W) filters over every pixel times the response of the sensor's channels."""
        return self.response[:, :, None, None] * self.filters()

    @property
    def tile_size(self) -> int:
        """Side Q of the tile of shutter and filters.

        Raises:
            SettingError: shutter patterns that do not repeat.
        """
        if self.shutter.period is None:
            raise SettingError("shutter", "patterns of the whole sensor", "a tile", "give (K, Q, Q) patterns")
        return self.period

    def tile(self) -> tuple[Tensor, Tensor]:
        """(colour (C, L, Q, Q), shutter (K, Q, Q)) of one tile."""
        side = slice(0, self.tile_size)
        return self._codes_over(side, side)

    def _codes_over(self, rows: slice, columns: slice) -> tuple[Tensor, Tensor]:
        """(colour (C, L, h, w), shutter (K, h, w)) over some pixels."""
        colour = self.response[:, :, None, None] * self.filters.part(rows, columns)
        return colour, self.shutter.part(rows, columns)

    def psf(self) -> Tensor:
        """(K, D, L, h, w) point spread functions, planes from far to near."""
        psf: Tensor = self.point_spread()
        return psf

    def equivalent_psf(self, pixel: tuple[int, int], plane: int) -> Tensor:
        """(C, L, h, w) what a point at a pixel and depth plane leaves on the sensor, eq. (35)."""
        check_pixel(pixel, self.size)
        rows, columns = (
            slice(max(0, place - side), min(length, place + side + 1))
            for place, side, length in zip(pixel, self.bench.window, self.size, strict=True)
        )
        colour, shutter = self._codes_over(rows, columns)
        place = (pixel[0] - rows.start, pixel[1] - columns.start)
        return equivalent_psf(self.psf(), colour, shutter, place, plane, self.exposure)

    def throughput(self) -> float:
        """Share of a white scene's light that is recorded, mean over channels."""
        with torch.no_grad():
            open_share = self.shutter().mean(0)
            passed = (self.filters.filters @ self.response.T / self.response.sum(1)).mean(1)
            light = 1.0 if self.point_spread.energy == "unit" else float(self.point_spread.arrived().mean())
            return float((self.filters.plane() * open_share).mean((1, 2)) @ passed) * light

    def transfer(self) -> Tensor:
        """(K, D, L, H', W'/2+1) transfer functions in ``frame``; cached as long as nothing is learned."""
        return self._transfer(self.frame)

    def _transfer(self, frame: tuple[int, int]) -> Tensor:
        return self.cached(f"transfer {frame}", lambda: transfer_functions(self.psf(), frame))

    @property
    def frame(self) -> tuple[int, int]:
        """(H', W') that holds the scene and its blur."""
        return framed(self.size, self.bench.window)

    def build_operator(self, depth: Tensor | None = None) -> LayeredOperator:
        """The linear part at depth maps (B, 1, H, W) in metres, every pixel in its ``planes.nearest``.

        Raises:
            SettingError: no depth.
        """
        if depth is None:
            raise SettingError("depth", "none", "a depth map (B, 1, H, W) in metres, for a spectral-depth camera")
        weights = self.planes.weights(depth).to(self.response)
        return LayeredOperator(weights, self.transfer(), self.frame, self.colour(), self.shutter(), self.exposure)

    def exact(
        self, scene: Tensor, depth: Tensor | None = None, progress: Callable[[float], None] | None = None
    ) -> Tensor:
        """Exact snapshot (B, C, H, W), a large one in tiles; arguments as ``forward``.

        What lies outside the design range is imaged in the plane of that end, what is no depth in the farthest
        (``planes.nearest``).
        """
        if depth is None:
            raise SettingError("depth", "none", "a depth map (B, 1, H, W) in metres, for a spectral-depth camera")
        self._check(scene, depth)
        spectra = self.slots * self.planes.count * self.bands
        tiles, frame = bounded_tiles(self.size, self.bench.window, spectra)
        transfer, snapshot = self._transfer(frame), scene.new_empty(0)
        for count, tile in enumerate(tiles):
            part = self._exposed(scene, depth, transfer, frame, tile)
            if len(tiles) == 1:
                return part
            snapshot = snapshot if count else part.new_empty(*part.shape[:2], *self.size)
            snapshot[..., tile.rows, tile.columns] = part
            if progress is not None:
                progress((count + 1) / len(tiles))
        return snapshot

    def _exposed(
        self, scene: Tensor, depth: Tensor, transfer: Tensor, frame: tuple[int, int], tile: SensorTile
    ) -> Tensor:
        """(B, C, h, w) exact snapshot of a tile."""
        light, places = tile.padded(tile.cut(scene)), tile.cut(depth)
        moments = [slice(None)] if depth.ndim == 4 else [slice(k, k + 1) for k in range(self.slots)]
        seen, form = [], layered if self.image_formation == "linear" else composited
        for slots in moments:
            moving = light if depth.ndim == 4 else light[:, slots]
            weights = self.planes.weights(places if depth.ndim == 4 else places[:, slots.start]).to(scene)
            seen.append(form(moving, tile.padded(weights), transfer[slots], frame))
        return coded_exposure(
            tile.inside(seen[0] if len(seen) == 1 else torch.cat(seen, 1)),
            *self._codes_over(tile.rows, tile.columns),
            self.exposure,
        )

    def _check(self, scene: Tensor, depth: Tensor) -> None:
        moves = scene.ndim == 5 and scene.shape[1] == self.slots
        if tuple(scene.shape[2:] if moves else scene.shape[1:]) != self.scene_shape:
            expected = f"(batch, {', '.join(map(str, self.scene_shape))}), or (batch, {self.slots}, …)"
            raise ShapeError("scene", str(tuple(scene.shape)), expected, "give the camera its size and bands")
        plane, moving = (1, *self.size), (self.slots, 1, *self.size)
        if tuple(depth.shape[1:]) not in ({plane, moving} if scene.ndim == 5 else {plane}):
            raise ShapeError("depth", str(tuple(depth.shape)), f"(batch, {', '.join(map(str, plane))}) in metres")

    def label(self, scenes: Tensor, name: str = "", unit: str = "relative irradiance") -> xr.DataArray:
        """See ``Camera``: (wavelength, y, x)."""
        import xarray as xr

        attrs = {"quantity": unit, "units": "1", "long_name": name}
        coordinates = wavelength_coordinates(self.wavelengths)
        return xr.DataArray(scenes[0].numpy(force=True), coordinates, ("wavelength", "y", "x"), attrs=attrs)

    def snapshot_axes(self, snapshots: Tensor) -> tuple[str, ...]:
        """See ``Camera``."""
        return ("channel", "y", "x")

    def variables(self) -> xr.Dataset:
        """``heights`` (slot, y_mask, x_mask) in metres, ``shutter`` (slot, y_tile, x_tile), or (slot, y, x) where it
        does not repeat, ``filters`` (filter, wavelength), ``cells`` (y_tile, x_tile), the index of the filter over
        every pixel, and ``response`` (channel, wavelength).

        Attributes: exposure, bench, depth planes, energy, sensor.
        """
        import xarray as xr

        tile = ("y_tile", "x_tile")
        parts = {
            "heights": (("slot", "y_mask", "x_mask"), self.codes()[0].numpy(force=True), MEANING_OF_HEIGHTS),
            "shutter": (
                ("slot", *(tile if self.shutter.period is not None else ("y", "x"))),
                compact(self.shutter.tile().detach()),
                {"units": "1 = open"},
            ),
            "filters": (
                ("filter", "wavelength"),
                self.filters.filters.numpy(force=True),
                {"long_name": "transmittance"},
            ),
            "cells": (tile, self.filters.cells().numpy(force=True), {"long_name": "index of the filter"}),
            "response": (("channel", "wavelength"), self.response.numpy(force=True), {"long_name": "response"}),
        }
        optics = {
            "bench": json.dumps(asdict(self.bench)), "depth": json.dumps(asdict(self.planes)),
            "energy": self.point_spread.energy, "image_formation": self.image_formation,
        }  # fmt: skip
        return xr.Dataset(parts, wavelength_coordinates(self.wavelengths), {**common_attributes(self), **optics})

    @classmethod
    def from_variables(cls, dataset: xr.Dataset, where: str) -> SpectralDepthCamera:
        """See ``Camera``; without a snapshot beside it the size is that of the tile."""
        check_complete(dataset, where, cls)
        parts, attrs = tensors(dataset, "heights", "shutter", "filters", "response"), dataset.attrs
        planes, bench = json_attribute(attrs, "depth", {}, where), json_attribute(attrs, "bench", {}, where)
        try:
            geometry = {
                "bench": changed_bench(PhaseMaskBench(), bench),
                "depth": (float(planes["near"]), float(planes["far"])),
                "planes": int(planes["count"]),
            }
        except (KeyError, TypeError, ValueError) as error:
            remedy = "correct it"
            raise DataError(where, f"bench or depth that are none ({error})", "those of a camera", remedy) from error
        size = tuple(dataset.sizes.get(axis, parts["shutter"].shape[-1]) for axis in ("y", "x"))
        return made_from(
            cls, dataset, where, "heights, shutter, filters and bench that fit",
            bands=dataset["wavelength"].values.tolist(), size=size, slots=len(parts["heights"]), mask=parts["heights"],
            shutter=parts["shutter"], filters=parts["filters"], cells=torch.tensor(dataset["cells"].values),
            period=dataset["cells"].shape[0], channels=parts["response"], energy=str(attrs["energy"]),
            image_formation=str(attrs.get("image_formation", "linear")), **geometry, **common_settings(attrs, where),
        )  # fmt: skip
