"""The spectral-depth camera: a phase mask that changes K times within one exposure, filters and shutter on the sensor
(thesis section 5)."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import Any

import torch
from torch import Tensor

from tmca.cameras.camera import Camera
from tmca.cameras.checks import band_wavelengths, check_one_hot, choice, learned_parts
from tmca.cameras.presets import SPECTRAL_DEPTH_PRESETS
from tmca.cameras.sensor_tiles import SensorTile, sensor_tiles
from tmca.codes import CodePlane, balanced_choice, one_hot_planes
from tmca.errors import SettingError, ShapeError
from tmca.operators.spectral_depth import (
    LayeredOperator,
    check_pixel,
    coded_exposure,
    composited,
    equivalent_psf,
    framed,
    layered,
    periodic_transfer_functions,
)
from tmca.optics import MODES, DepthPlanes, FreeForm, HeightMaps, PhaseMaskBench, Stroke, mask_heights
from tmca.sensor import ColourCodedAperture, Sensor, channel_response, feasible_filters

IMAGE_FORMATIONS = ("linear", "occlusion")
LEARNABLE = ("mask", "shutter", "filters")
TILE, TOGETHER = (256, 256), 2**29
"""Pixels of a tile of the sensor, and bytes of transfer functions above which it is imaged in tiles."""


class SpectralDepthCamera(Camera):
    """A snapshot camera for spectrum and depth with a time-multiplexed phase mask.

    ``e_{c,m,n} = (1/K) Σ_k S^k_{m,n} Σ_ℓ κ_{c,ℓ} C_{ℓ,m,n} Σ_d (p_{k,d,ℓ} * ω_d f_ℓ)_{m,n}`` (thesis eqs 30–36,
    errata), then noise. With ``slots=1, shutter="open", filters="clear"`` only the phase mask codes.

    Args:
        bands: number of bands L, or their wavelengths in metres. A number means even spacing from 400 to 700 nm.
        size: (H, W) of the scene and the sensor, pixels; dark around the scene, which darkens the linear model's rim.
        slots: number of time slots K within the exposure.
        depth: nearest and farthest plane, metres.
        planes: number of depth planes D, even in inverse depth.
        bench: distances, pitches and sizes.
        mask: family of the height maps (``tmca.optics.FAMILIES``), the maps (K, H, W) in metres, or ``HeightMaps``.
        rms: of random heights, metres.
        modes: number of Zernike modes of random heights.
        stroke: of the device that shows them; any height without, or that of ``HeightMaps``.
        shutter: family of the shutter codes (``tmca.codes.FAMILIES``; ``"one-hot"`` opens as many pixels of a tile in
            every slot) or patterns (K, H, W), or (K, Q, Q) of a tile.
        filters: family of the feasible filters (``tmca.sensor.FILTERS``) or transmittances (R, L).
        cells: (Q, Q) index of the filter over every pixel; random if None.
        period: tile Q of shutter and filters, pixels.
        channels: of the sensor: ``"monochrome"``, ``"rgb"``, or responses (C, L).
        exposure: ``"equal"``: the slots share one exposure time (mean); ``"per-slot"``: each has its own (sum).
        energy: of the point spread functions, see ``tmca.optics.PointSpread``.
        image_formation: ``"linear"``, or ``"occlusion"``: near layers hide far ones.
        sensor: noise, full well, bits; an ideal sensor if None.
        seed: of mask, shutter and filters.
        learnable: ``True``, ``False``, or some of ``"mask"``, ``"shutter"``, ``"filters"``.

    Raises:
        SettingError, ShapeError: an impossible value, or parts that do not fit.
    """

    kind = "spectral-depth"
    channel = "band"
    response: Tensor

    def __init__(
        self,
        bands: int | Sequence[float] = 8,
        size: tuple[int, int] = (96, 96),
        slots: int = 4,
        *,
        depth: tuple[float, float] = (0.4, 2.0),
        planes: int = 8,
        bench: PhaseMaskBench | None = None,
        mask: str | Tensor | HeightMaps = "zernike",
        rms: float = 0.1e-6,
        modes: int = MODES,
        stroke: Stroke | None = None,
        shutter: str | Tensor = "one-hot",
        filters: str | Tensor = "clear",
        cells: Tensor | None = None,
        period: int = 4,
        channels: str | Tensor = "monochrome",
        exposure: str = "equal",
        energy: str = "unit",
        image_formation: str = "linear",
        sensor: Sensor | None = None,
        seed: int = 0,
        learnable: bool | str | Collection[str] = False,
    ) -> None:
        super().__init__(size, slots, exposure, sensor)
        learned = learned_parts(learnable, LEARNABLE)
        self.wavelengths = band_wavelengths(bands)
        self.planes = DepthPlanes(float(depth[0]), float(depth[1]), planes)
        self.bench = bench or PhaseMaskBench()
        self.image_formation = choice("image formation", image_formation, IMAGE_FORMATIONS)
        self.register_buffer("response", channel_response(channels, self.wavelengths))
        heights = self._heights(mask, stroke, "mask" in learned, rms=rms, modes=modes, seed=seed)
        self.spread = self.bench.point_spread(heights, self.wavelengths, self.planes, energy)
        self.period = int(period)
        tile = None if isinstance(shutter, Tensor) and tuple(shutter.shape[1:]) == self.size else period
        self.shutter = CodePlane(
            shutter, slots, self.size, period=tile, seed=2 * seed + 1, learnable="shutter" in learned, name="shutter"
        )
        if isinstance(shutter, str) and shutter == "one-hot":
            check_one_hot(slots, period)
            self.shutter.show(one_hot_planes(balanced_choice(slots, (period, period), 2 * seed + 1), slots))
        given = feasible_filters(filters, self.wavelengths) if isinstance(filters, str) else filters
        if given.shape[-1] != len(self.wavelengths):
            raise ShapeError("filters", f"{given.shape[-1]} bands", f"{len(self.wavelengths)}, those of the camera")
        if cells is not None and tuple(cells.shape) != (period, period):
            raise ShapeError("cells", str(tuple(cells.shape)), f"({period}, {period}), the period")
        if len(given) == 1 and "filters" in learned and not isinstance(learnable, bool):
            raise SettingError("learnable", "filters, of which there is one", "two filters or more, such as gaussian")
        self.filters = ColourCodedAperture(
            given, self.size, period, cells=cells, seed=2 * seed, learnable="filters" in learned and len(given) > 1
        )
        self._kept: tuple[tuple[object, ...], Tensor] | None = None

    @classmethod
    def from_preset(cls, name: str, **changes: Any) -> SpectralDepthCamera:
        """A named camera: ``"thesis"``, ``"quick"``, or ``"diffractive"``, the thesis' with nothing but the mask.

        Args:
            name: of the preset.
            changes: arguments that replace the preset's.

        Raises:
            SettingError: unknown preset.
        """
        known = tuple(SPECTRAL_DEPTH_PRESETS)
        return cls(**{**SPECTRAL_DEPTH_PRESETS[choice("preset", name, known)], **changes})

    def _heights(
        self, mask: str | Tensor | HeightMaps, stroke: Stroke | None, learnable: bool, **drawn: Any
    ) -> HeightMaps:
        if isinstance(mask, str):
            return mask_heights(mask, self.slots, self.bench, stroke=stroke, learnable=learnable, **drawn)
        maps = mask if isinstance(mask, HeightMaps) else FreeForm(mask, stroke, learnable=learnable)
        if learnable and not list(maps.parameters()):
            maps = maps.repeated(self.slots, learnable=True)
        found, wanted = tuple(maps().shape), (self.slots, *self.bench.mask_size)
        if found != wanted:
            raise ShapeError("mask", str(found), f"{wanted}, (K, mask pixels, mask pixels)")
        return maps

    @property
    def white(self) -> float:
        """Level of a white scene in the channel that sees most."""
        return float(self.response.detach().sum(1).max())

    @property
    def learnable(self) -> bool:
        """Whether mask, shutter or filters are learned."""
        return any(True for _ in self.parameters())

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
        return self.spread.heights(), self.shutter()

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
        found: Tensor = self.spread()
        return found

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
            light = 1.0 if self.spread.energy == "unit" else float(self.spread.arrived().mean())
            return float((self.filters.plane() * open_share).mean((1, 2)) @ passed) * light

    def transfer(self) -> Tensor:
        """(K, D, L, H', W'/2+1) transfer functions in ``frame``; kept as long as nothing is learned."""
        return self._transfer(self.frame)

    def _transfer(self, frame: tuple[int, int]) -> Tensor:
        if self.learnable:
            return periodic_transfer_functions(self.psf(), frame)
        versions = (frame, *((t.data_ptr(), t._version) for t in self.spread.heights.buffers()))
        if self._kept is None or self._kept[0] != versions:
            self._kept = (versions, periodic_transfer_functions(self.psf(), frame))
        return self._kept[1]

    @property
    def frame(self) -> tuple[int, int]:
        """(H', W') that holds the scene and its blur."""
        return framed(self.size, self.bench.window)

    def operator(self, depth: Tensor) -> LayeredOperator:
        """The linear part at depth maps (B, 1, H, W) in metres, every pixel in its ``planes.nearest``."""
        weights = self.planes.weights(depth).to(self.response)
        return LayeredOperator(weights, self.transfer(), self.frame, self.colour(), self.shutter(), self.exposure)

    def A(self, scene: Tensor, depth: Tensor) -> Tensor:
        """(B, L, H, W) at depth (B, 1, H, W) → exact snapshot (B, C, H, W) of the linear model."""
        return self.operator(depth).A(scene)

    def A_adjoint(self, snapshot: Tensor, depth: Tensor) -> Tensor:
        """(B, C, H, W) → (B, L, H, W)."""
        return self.operator(depth).A_adjoint(snapshot)

    def A_dagger(self, snapshot: Tensor, depth: Tensor) -> Tensor:
        """(B, C, H, W) → least-norm scene (B, L, H, W), by iteration."""
        return self.operator(depth).A_dagger(snapshot)

    def exact(self, scene: Tensor, depth: Tensor, progress: Callable[[float], None] | None = None) -> Tensor:
        """Exact snapshot (B, C, H, W), a large one in tiles; arguments as ``forward``."""
        self._check(scene, depth)
        tiles, frame = self._tiles()
        transfer, found = self._transfer(frame), scene.new_empty(0)
        for count, tile in enumerate(tiles):
            own = self._exposed(scene, depth, transfer, frame, tile)
            if len(tiles) == 1:
                return own
            found = found if count else own.new_empty(*own.shape[:2], *self.size)
            found[..., tile.rows, tile.columns] = own
            if progress is not None:
                progress((count + 1) / len(tiles))
        return found

    def forward(
        self,
        scene: Tensor,
        depth: Tensor,
        generator: torch.Generator | int | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> Tensor:
        """Take a snapshot.

        Args:
            scene: (B, L, H, W) relative irradiance, or (B, K, L, H, W) where it changes from slot to slot.
            depth: (B, 1, H, W) metres, or (B, K, 1, H, W) beside such a scene. What lies outside the
                design range is imaged in the plane of that end, what is no depth in the farthest (``planes.nearest``).
            generator: source of the sensor's randomness, or a seed.
            progress: told the share that is done, where the sensor is imaged in tiles.

        Returns:
            (B, C, H, W) snapshot.

        Raises:
            ShapeError: other shapes.
        """
        return self.record(self.exact(scene, depth, progress), generator)

    def _tiles(self) -> tuple[list[SensorTile], tuple[int, int]]:
        """Tiles of the sensor, one where that does not take much memory, and the frame in which they are blurred."""
        (height, width), window = self.frame, self.bench.window
        if 8 * self.slots * self.planes.count * self.bands * height * (width // 2 + 1) <= TOGETHER:
            return sensor_tiles(self.size, self.size, (0, 0)), self.frame
        return sensor_tiles(self.size, TILE, (window[0] // 2, window[1] // 2)), framed(TILE, window)

    def _exposed(
        self, scene: Tensor, depth: Tensor, transfer: Tensor, frame: tuple[int, int], tile: SensorTile
    ) -> Tensor:
        """(B, C, h, w) exact snapshot of a tile."""
        light, places = tile.padded(tile.cut(scene)), tile.cut(depth)
        moments = [slice(None)] if depth.ndim == 4 else [slice(k, k + 1) for k in range(self.slots)]
        seen, form = [], layered if self.image_formation == "linear" else composited
        for slots in moments:
            own = light if depth.ndim == 4 else light[:, slots]
            weights = self.planes.weights(places if depth.ndim == 4 else places[:, slots.start]).to(scene)
            seen.append(form(own, tile.padded(weights), transfer[slots], frame))
        return coded_exposure(
            tile.inside(seen[0] if len(seen) == 1 else torch.cat(seen, 1)),
            *self._codes_over(tile.rows, tile.columns),
            self.exposure,
        )

    def _check(self, scene: Tensor, depth: Tensor) -> None:
        kept = scene.shape[2:] if scene.ndim == 5 and scene.shape[1] == self.slots else scene.shape[1:]
        if tuple(kept) != self.scene_shape:
            wanted = f"(batch, {', '.join(map(str, self.scene_shape))}), or (batch, {self.slots}, …)"
            raise ShapeError("scene", str(tuple(scene.shape)), wanted, "give the camera its size and bands")
        plane, moving = (1, *self.size), (self.slots, 1, *self.size)
        if tuple(depth.shape[1:]) not in ({plane, moving} if scene.ndim == 5 else {plane}):
            raise ShapeError("depth", str(tuple(depth.shape)), f"(batch, {', '.join(map(str, plane))}) in metres")

    def _apply(self, fn: Any, recurse: bool = True) -> SpectralDepthCamera:
        self._kept = None
        return super()._apply(fn, recurse)
