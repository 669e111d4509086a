"""The light-field camera: a mask in front of the sensor that changes K times within one exposure (thesis chapter 3)."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor, nn

from tmca.cameras.coded import CodedCamera
from tmca.cameras.presets import LIGHT_FIELD
from tmca.cameras.specs import LightFieldSpec
from tmca.cameras.stored import (
    check_complete,
    code_planes,
    code_settings,
    common_attributes,
    json_attribute,
    made_from,
    tensors,
)
from tmca.codes import Codes
from tmca.errors import SettingError, ShapeError
from tmca.operators import TapOperator, code_through_mask, coded_mask, exposure_weight, mask_code
from tmca.optics import MaskGeometry, ViewShear, view_coordinates, view_grid

if TYPE_CHECKING:
    import xarray as xr

_COLOURS = ("red", "green", "blue")


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
        coding: parts of the description of the codes, see ``Codes``: ``aperture``, ``shutter``, ``period``, ….

    Raises:
        SettingError, ShapeError: an impossible value or codes that do not fit, naming both sizes.
    """

    kind = "light-field"
    channel = "view"
    presets = LIGHT_FIELD
    Spec = LightFieldSpec
    needed = ("aperture", "shutter", "vignetting")
    stated = ("exposure", "shear", "mask_scale", "full_scale", "sensor")
    page = "docs/light-field.md"

    def __init__(
        self,
        views: int | tuple[int, int] | None = None,
        size: tuple[int, int] | None = None,
        slots: int = 8,
        *,
        codes: Codes | nn.Module | None = None,
        exposure: str = "equal",
        shear: float | tuple[float, float] = 1.0,
        mask_scale: float = 1.0,
        vignetting: Tensor | Sequence[Sequence[float]] | None = None,
        sensor: nn.Module | None = None,
        **coding: Any,
    ) -> None:
        super().__init__((270, 480) if size is None else size, slots, exposure, sensor)
        self.unbound = frozenset(name for name, value in (("views", views), ("size", size)) if value is None)
        grid = view_grid(5 if views is None else views)
        self.shear = ViewShear(grid, shear, mask_scale)  # type: ignore[arg-type]
        self._vignetted = vignetting is not None
        self.register_buffer("response", _weights(vignetting, grid).flatten())
        self._hold_codes(codes, self.mask_size, self.size, **coding)

    def arguments(self) -> dict[str, Any]:
        """See ``Camera``."""
        bound = "views" not in self.unbound
        return {
            "views": self.views if bound else None, "size": None if "size" in self.unbound else self.size,
            "slots": self.slots, "codes": self._codes_argument(), "exposure": self.exposure, "shear": self.shear.step,
            "mask_scale": self.shear.scale, "vignetting": self.vignetting if bound or self._vignetted else None,
            "sensor": self.sensor,
        }  # fmt: skip

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
    def views(self) -> tuple[int, int]:
        """(V, U)."""
        return self.shear.views

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
        """(1, H, W)."""
        return (1, *self.size)

    @property
    def channel_names(self) -> list[str]:
        """Places of the views on the aperture, rows then columns."""
        rows, columns = (view_coordinates(n) for n in self.views)
        return [f"view {v}, {u}" for v in rows for u in columns]

    def code_cube(self) -> Tensor:
        """(V, U, H, W) the time-multiplexed code T̂ of eq. (12), without vignetting."""
        return mask_code(*self.codes(), self.shear) * exposure_weight(self.exposure, self.slots)

    def code_through_mask(self) -> Tensor:
        """(V, U, Hm, Wm) the code as seen from the mask, eq. (10): response to the rays through each mask pixel, in the
        units of `code_cube`."""
        return code_through_mask(*self.codes(), self.shear) * self.exposures

    def build_operator(self, depth: Tensor | None = None) -> TapOperator:
        """See ``Camera``; on scenes (B, V·U, H, W), their views row by row."""
        if depth is not None:
            raise SettingError("depth", "a depth map", "none for a light-field camera")
        return coded_mask(*self.codes(), self.shear, self.vignetting, self.exposure)

    def A(self, scene: Tensor, depth: Tensor | None = None) -> Tensor:
        """(B, V, U, H, W) → exact snapshot (B, 1, H, W)."""
        self._check_scene(scene, "light field")
        return self.operator(depth).A(scene.flatten(1, 2))

    def A_adjoint(self, snapshot: Tensor, depth: Tensor | None = None) -> Tensor:
        """(B, 1, H, W) → (B, V, U, H, W)."""
        return self.operator(depth).A_adjoint(snapshot).unflatten(1, self.views)

    def A_dagger(self, snapshot: Tensor, depth: Tensor | None = None) -> Tensor:
        """(B, 1, H, W) → least-norm light field (B, V, U, H, W); ``A Aᵀ`` is diagonal."""
        return self.operator(depth).A_dagger(snapshot).unflatten(1, self.views)

    def exact(
        self, scene: Tensor, depth: Tensor | None = None, progress: Callable[[float], None] | None = None
    ) -> Tensor:
        """Exact snapshot of (B, V, U, H, W), one colour channel, or of (B, K, V, U, H, W) that changes from slot to
        slot; colours are folded into B."""
        if scene.ndim != 6:
            return super().exact(scene, depth)
        if scene.shape[1] != self.slots:
            raise ShapeError("scene", f"shape {tuple(scene.shape)}", f"(batch, {self.slots} slots, …)")
        aperture, shutter = self.codes()
        total, weight = self.response.new_zeros(()), exposure_weight(self.exposure, self.slots)
        for k in range(self.slots):
            self._check_scene(scene[:, k], "light field")
            planes = aperture[k : k + 1], shutter[k : k + 1]
            total = total + weight * coded_mask(*planes, self.shear, self.vignetting).A(scene[:, k].flatten(1, 2))
        return total

    def label(self, scenes: Tensor, name: str = "", unit: str = "relative irradiance") -> xr.DataArray:
        """See ``Camera``: (view_v, view_u, y, x), with the three colours of a batch first."""
        from tmca.data import label_light_field

        values = scenes.numpy(force=True)
        return label_light_field(values if len(values) > 1 else values[0], {"long_name": name, "quantity": unit})

    def snapshot_axes(self, snapshots: Tensor) -> tuple[str, ...]:
        """See ``Camera``: a batch of three is the colours."""
        return ("colour", "y", "x") if len(snapshots) > 1 else ("y", "x")

    def variables(self) -> xr.Dataset:
        """``aperture`` (slot, y_mask, x_mask), ``shutter`` (slot, y, x) and ``vignetting`` (view_v, view_u).
        Attributes: exposure, shear and scale of the mask, sensor."""
        import xarray as xr

        parts: dict[str, Any] = {
            **code_planes(self, ("y_mask", "x_mask"), ("y", "x")),
            "vignetting": (("view_v", "view_u"), self.vignetting.numpy(force=True), {"units": "1"}),
        }
        coordinates = {
            name: (name, np.array(view_coordinates(count), dtype=float), {"units": "view steps"})
            for name, count in zip(("view_v", "view_u"), self.views, strict=True)
        }
        optics = {"shear": json.dumps(list(self.shear.step)), "mask_scale": self.shear.scale}
        return xr.Dataset(parts, coordinates, {**common_attributes(self), **optics})

    @classmethod
    def from_variables(cls, dataset: xr.Dataset, where: str) -> LightFieldCamera:
        """See ``Camera``."""
        check_complete(dataset, where, cls)
        settings = code_settings(dataset, where)
        return made_from(
            cls, dataset, where, "aperture, shutter and shear that fit",
            views=dataset["vignetting"].shape,
            size=tuple(settings["shutter"].shape[-2:]),
            shear=json_attribute(dataset.attrs, "shear", 1.0, where),
            mask_scale=float(dataset.attrs["mask_scale"]),
            **tensors(dataset, "vignetting"), **settings,
        )  # fmt: skip

    def _geometry(self) -> tuple[object, ...]:
        return (self.shear,)


def _weights(vignetting: Tensor | Sequence[Sequence[float]] | None, grid: tuple[int, int]) -> Tensor:
    if vignetting is None:
        return torch.ones(grid)
    try:
        values = vignetting if isinstance(vignetting, Tensor) else torch.tensor(np.array(vignetting, dtype=np.float32))
    except (TypeError, ValueError):
        raise ShapeError("vignetting", "rows of unequal length, or no numbers", f"{grid}, one value per view") from None
    if tuple(values.shape) != grid:
        raise ShapeError("vignetting", f"shape {tuple(values.shape)}", f"{grid}, one value per view")
    if not bool(torch.isfinite(values).all()) or values.min() < 0 or values.max() <= 0:
        raise SettingError("vignetting", str(values.tolist()), "finite numbers ≥ 0, not all zero")
    return values
