"""The light-field camera: a mask in front of the sensor that changes K times within one exposure (thesis chapter 3)."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Annotated, Any

import torch
from pydantic import Json
from torch import Tensor, nn

from tmca.arguments import Count, Float, Int, IntPair, Pair, Size, checked
from tmca.attributes import attributes_of
from tmca.cameras.attributes import CodedAttributes
from tmca.cameras.coded import CodedCamera
from tmca.codes import Codes
from tmca.codes.arrays import Array
from tmca.codes.files import tensors
from tmca.errors import check_shape
from tmca.operators import TapOperator, code_through_mask, coded_mask, exposure_weight, mask_code, of_buckets
from tmca.optics import MaskGeometry, ViewShear, view_coordinates, view_grid
from tmca.specs import LightFieldSpec

if TYPE_CHECKING:
    import xarray as xr

PRESETS: dict[str, dict[str, Any]] = {
    # thesis 3.2: 5×5 views of 480×270, K = 8. Assumed, as the thesis does not say: a mask of pitch (1-s)·p one mask
    # pixel per view from the sensor, no vignetting, codes of transmittance and duty one half, no noise.
    "thesis": {"views": 5, "size": (270, 480), "slots": 8, "aperture": "random", "shutter": "random"},
    # its static camera, compressive light-field photography (Marwah 2013)
    "clfp": {"views": 5, "size": (270, 480), "slots": 1, "aperture": "static", "shutter": "open"},
    "one-hot": {"views": 5, "size": (270, 480), "slots": 4, "aperture": "random", "shutter": "one-hot"},
    "two-bucket": {"views": 5, "size": (270, 480), "slots": 4, "shutter": "balanced", "buckets": 2},
    # its rival of the same sensor: two frames one after the other
    "burst": {"views": 5, "size": (270, 480), "slots": 2, "shutter": "burst", "buckets": 2},
    "quick": {"views": 5, "size": (96, 96), "slots": 4, "aperture": "random", "shutter": "one-hot"},
}


class LightFieldAttributes(CodedAttributes):
    """What a file says of the light-field camera."""

    shear: Json[float | tuple[float, float]] = 1.0
    mask_scale: float


class LightFieldCamera(CodedCamera):
    """A snapshot light-field camera with a time-multiplexed coded mask.

    ``y_m = Σ_ℓ ω_ℓ T̂_{m,ℓ} x_{m,ℓ}`` with ``T̂_{m,ℓ} = (1/K) Σ_k S^k_m T^k_{m + shear·ℓ}`` (thesis eqs 8–13, errata),
    then noise. With ``slots=1, shutter="open"`` it is the camera of Marwah 2013.

    >>> camera = LightFieldCamera(views=5, size=(48, 64), slots=4, shutter="one-hot", period=16)
    >>> camera(torch.rand(1, 5, 5, 48, 64)).shape
    torch.Size([1, 1, 48, 64])

    Args:
        views: number of views per axis, or (V, U); odd, up to 9; left out, 5 until the camera is bound to a scene.
        size: (H, W) of a view and of the sensor, pixels; left out, 270×480 until the camera is bound to a scene.
        slots: number of time slots K within the exposure.
        codes: mask (K, Hm, Wm) with ``(Hm, Wm) = camera.mask_size``, the sensor and the views' shear around it, and
            shutter (K, H, W): their description, or a module that gives both.
        exposure: ``"equal"``: the slots share one exposure time (mean); ``"per-slot"``: each has its own (sum).
        shear: mask pixels per view, along both axes or (along y, along x); any real number, the thesis has 1.
        mask_scale: mask pixels per sensor pixel as the sensor sees them, see ``ViewShear``; 1 for a mask of pitch
            (1-s)·p.
        vignetting: (V, U) share ω of the light of every view; ones if None.
        sensor: noise, full well, bits; an ideal sensor if None.
        buckets: R of a pixel: with one, the light of closed slots is lost; with two, it is in the second.
        coding: parts of the description of the codes, see ``Codes``: ``aperture``, ``shutter``, ``period``, ….

    Raises:
        SettingError, ShapeError: an impossible value or codes that do not fit, naming both sizes.
    """

    kind = "light-field"
    Spec = LightFieldSpec
    channel = "view"
    views: tuple[int, int]  # (V, U)
    presets = PRESETS
    from_scene = ("views", "size")
    needed = ("aperture", "shutter", "vignetting")
    attributes = LightFieldAttributes

    @checked
    def __init__(
        self,
        views: Int | IntPair | None = None,
        size: Size | None = None,
        slots: Count = 8,
        *,
        codes: Codes | nn.Module | None = None,
        exposure: str = "equal",
        shear: Float | Pair = 1.0,
        mask_scale: Float = 1.0,
        vignetting: Array | Sequence[Sequence[float]] | None = None,
        sensor: Annotated[nn.Module | None, "a Sensor"] = None,
        buckets: Count = 1,
        **coding: Any,
    ) -> None:
        super().__init__((270, 480) if size is None else size, slots, exposure, sensor, buckets)
        self.views = view_grid(5 if views is None else views)
        self.shear = ViewShear(self.views, shear, mask_scale)  # type: ignore[arg-type]
        self._hold_response(torch.ones(self.views) if vignetting is None else vignetting, "vignetting", self.views)
        self._hold_codes(codes, self.mask_size, self.size, **coding)

    def _shared(self, parts: set[str]) -> dict[str, Any]:
        return {**super()._shared(parts), **({} if "views" in parts else {"vignetting": self.vignetting})}

    @classmethod
    def from_geometry(
        cls, geometry: MaskGeometry, size: tuple[int, int], mask_pitch: float | None = None, **settings: Any
    ) -> LightFieldCamera:
        """The camera of a bench.

        Args:
            geometry: distances and pitch, metres.
            size: (H, W) of the sensor, pixels.
            mask_pitch: of the mask's pixels, metres; (1-s)·p if None.
            settings: further arguments of the camera.

        Raises:
            SettingError: a pitch that is not positive, or an impossible setting.
        """
        shear = geometry.shear(mask_pitch)
        return cls(shear.views, size, shear=shear.step, mask_scale=shear.scale, **settings)

    @property
    def mask_size(self) -> tuple[int, int]:
        """(Hm, Wm): the sensor and ``2 ⌈|shear| (U-1)/2⌉`` pixels per axis."""
        return self.shear.mask_size(self.size)

    @property
    def vignetting(self) -> Tensor:
        """(V, U) share of the light of every view."""
        return self.response.reshape(self.views)

    @property
    def scene_shape(self) -> tuple[int, int, int, int]:
        """(V, U, H, W)."""
        return (*self.views, *self.size)

    @property
    def snapshot_shape(self) -> tuple[int, int, int]:
        """(R, H, W) of R buckets."""
        return (self.buckets, *self.size)

    @property
    def channel_names(self) -> list[str]:
        """Places of the views on the aperture, rows then columns."""
        rows, columns = (view_coordinates(n) for n in self.views)
        return [f"view {v}, {u}" for v in rows for u in columns]

    def code_cube(self) -> Tensor:
        """(V, U, H, W) the time-multiplexed code T̂ of eq. (12), without vignetting; with several buckets (R, V, U, H,
        W)."""
        aperture, shutters = self.bucket_codes()
        cubes = [mask_code(aperture, shown, self.shear) for shown in shutters]
        return (cubes[0] if self.buckets == 1 else torch.stack(cubes)) * exposure_weight(self.exposure, self.slots)

    def code_through_mask(self) -> Tensor:
        """(V, U, Hm, Wm) the code as seen from the mask, eq. (10): response to the rays through each mask pixel, in the
        units of `code_cube`; of the first bucket."""
        aperture, shutters = self.bucket_codes()
        return code_through_mask(aperture, shutters[0], self.shear) * self.exposures

    def build_operator(self, depth: Tensor | None = None) -> TapOperator:
        """The linear part, on scenes (B, V·U, H, W), their views row by row."""
        self._check_no_depth(depth)
        return self._masked(*self.bucket_codes(), self.exposure)

    def exact(
        self, scene: Tensor, depth: Tensor | None = None, progress: Callable[[float], None] | None = None
    ) -> Tensor:
        """Exact snapshot of (B, V, U, H, W), one colour channel, or of (B, K, V, U, H, W) that changes from slot to
        slot; colours are folded into B."""
        if scene.ndim != 6:
            return super().exact(scene, depth)
        check_shape("scene", scene, ("batch", self.slots, *self.scene_shape))
        aperture, shutters = self.bucket_codes()
        alone = [self._masked(aperture[k : k + 1], shutters[:, k : k + 1]) for k in range(self.slots)]
        slots = [operator.A(scene[:, k].flatten(1, 2)) for k, operator in enumerate(alone)]
        return torch.stack(slots).sum(0) * exposure_weight(self.exposure, self.slots)

    def _masked(self, aperture: Tensor, shutters: Tensor, exposure: str = "equal") -> TapOperator:
        """The operator of some slots, shutters (R, K, H, W) of every bucket."""
        how = (self.shear, self.vignetting, exposure)
        return of_buckets([coded_mask(aperture, shown, *how) for shown in shutters])

    def fitted(self, scene: Any) -> Any:
        """See ``Camera``; the views in the middle of the grid."""
        from tmca.data.fitting import fit_views

        return fit_views(scene, self.views, self.size)

    def label(self, scenes: Tensor, name: str = "", unit: str = "relative irradiance") -> xr.DataArray:
        """(view_v, view_u, y, x), with the three colours of a batch first."""
        from tmca.data import label_light_field

        values = scenes.numpy(force=True)
        return label_light_field(values if len(values) > 1 else values[0], {"long_name": name, "quantity": unit})

    def snapshot_axes(self, snapshots: Tensor) -> tuple[str, ...]:
        """A batch of three is the colours."""
        axes = super().snapshot_axes(snapshots)
        return ("colour", *axes) if len(snapshots) == 3 else axes

    def _variables(self, tiled: bool) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
        """``aperture`` (slot, y_mask, x_mask), ``shutter`` (slot, y, x) and ``vignetting`` (view_v, view_u).
        Attributes: exposure, shear and scale of the mask, sensor."""
        from tmca.data.axes import view_axes

        parts, attributes = self._planes(tiled, ("y_mask", "x_mask"), ("y", "x"))
        weights = {"units": "1", "long_name": "weight of a view"}
        parts["vignetting"] = (("view_v", "view_u"), self.vignetting.numpy(force=True), weights)
        optics = {"shear": json.dumps(list(self.shear.step)), "mask_scale": self.shear.scale}
        return parts, view_axes(self.views), {**attributes, **optics}

    @classmethod
    def _settings(cls, dataset: xr.Dataset, where: str) -> dict[str, Any]:
        settings, stated = super()._settings(dataset, where), attributes_of(LightFieldAttributes, dataset.attrs, where)
        return {
            **settings,
            "size": tuple(settings["shutter"].shape[-2:]),
            "views": dataset["vignetting"].shape,
            "shear": stated.shear,
            "mask_scale": stated.mask_scale,
            **tensors(dataset, where, "vignetting"),
        }
