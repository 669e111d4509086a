"""The light-field camera: a mask in front of the sensor that changes K times within one exposure (thesis chapter 3)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from tmca.cameras.checks import choice
from tmca.cameras.coded import CodedCamera
from tmca.cameras.presets import LIGHT_FIELD_PRESETS
from tmca.codes import MultiplexedCodes
from tmca.errors import SettingError, ShapeError
from tmca.operators import TapOperator, code_through_mask, coded_mask, mask_code
from tmca.operators.spectral import exposure_weight
from tmca.optics import MaskGeometry, ViewShear, shear_step, view_coordinates, view_grid
from tmca.sensor import Sensor


class LightFieldCamera(CodedCamera):
    """A snapshot light-field camera with a time-multiplexed coded mask.

    ``y_m = Σ_ℓ ω_ℓ T̂_{m,ℓ} x_{m,ℓ}`` with ``T̂_{m,ℓ} = (1/K) Σ_k S^k_m T^k_{m + shear·ℓ}`` (thesis eqs 8–13, errata),
    then noise. With ``slots=1, shutter="open"`` it is the camera of Marwah 2013.

    Args:
        views: number of views per axis, or (V, U); odd, up to 9.
        size: (H, W) of a view and of the sensor, pixels.
        slots: number of time slots K within the exposure.
        aperture: family of the mask codes (``tmca.codes.FAMILIES``) or patterns (K, Hm, Wm), with
            ``(Hm, Wm) = camera.mask_size``: the sensor and the views' shear around it.
        shutter: family of the shutter codes or patterns (K, H, W).
        exposure: ``"equal"``: the slots share one exposure time (mean); ``"per-slot"``: each has its own (sum).
        shear: mask pixels per view, along both axes or (along y, along x); any real number, the thesis has 1.
        mask_scale: mask pixels per sensor pixel as the sensor sees them, see ``ViewShear``; 1 for a mask of pitch
            (1-s)·p.
        vignetting: (V, U) share ω of the light of every view; ones if None.
        sensor: noise, full well, bits; an ideal sensor if None.
        transmittance: share of open mask pixels of a named family.
        duty: share of open shutter pixels of a named family.
        period: tile of the codes, pixels; full frame if None.
        seed: of the codes.
        learnable: ``True``, ``False``, ``"aperture"`` or ``"shutter"``.
        spread: of the logits of learned codes, see ``CodePlane``.

    Raises:
        SettingError, ShapeError: an impossible value or codes that do not fit, naming both sizes.
    """

    kind = "light-field"
    channel = "view"

    def __init__(
        self,
        views: int | tuple[int, int] = 5,
        size: tuple[int, int] = (270, 480),
        slots: int = 8,
        *,
        aperture: str | Tensor = "random",
        shutter: str | Tensor = "random",
        exposure: str = "equal",
        shear: float | tuple[float, float] = 1.0,
        mask_scale: float = 1.0,
        vignetting: Tensor | Sequence[Sequence[float]] | None = None,
        sensor: Sensor | None = None,
        transmittance: float = 0.5,
        duty: float = 0.5,
        period: int | tuple[int, int] | None = None,
        seed: int = 0,
        learnable: bool | str = False,
        spread: float = 0.0,
    ) -> None:
        super().__init__(size, slots, exposure, sensor)
        grid = view_grid(views)
        self.shear = ViewShear(grid, shear_step(shear), mask_scale)
        self.register_buffer("response", _weights(vignetting, grid).flatten())
        self.codes = MultiplexedCodes(
            slots, self.mask_size, self.size, aperture=aperture, shutter=shutter, transmittance=transmittance,
            duty=duty, period=period, seed=seed, learnable=learnable, spread=spread,
        )  # fmt: skip

    @classmethod
    def from_preset(cls, name: str, **changes: Any) -> LightFieldCamera:
        """A named camera: ``"thesis"`` (K = 8 random), ``"clfp"`` (its static camera), ``"one-hot"``, ``"quick"``.

        Args:
            name: of the preset.
            changes: arguments that replace the preset's.

        Raises:
            SettingError: unknown preset.
        """
        return cls(**{**LIGHT_FIELD_PRESETS[choice("preset", name, tuple(LIGHT_FIELD_PRESETS))], **changes})

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
        light = self.slots * exposure_weight(self.exposure, self.slots)
        return code_through_mask(*self.codes(), self.shear) * light

    def A(self, scene: Tensor) -> Tensor:
        """(B, V, U, H, W) → exact snapshot (B, 1, H, W)."""
        self._check(scene)
        return self.operator().A(scene.flatten(1, 2))

    def A_adjoint(self, snapshot: Tensor) -> Tensor:
        """(B, 1, H, W) → (B, V, U, H, W)."""
        return self.operator().A_adjoint(snapshot).unflatten(1, self.views)

    def A_dagger(self, snapshot: Tensor) -> Tensor:
        """(B, 1, H, W) → least-norm light field (B, V, U, H, W); ``A Aᵀ`` is diagonal."""
        return self.operator().A_dagger(snapshot).unflatten(1, self.views)

    def forward(self, scene: Tensor, generator: torch.Generator | int | None = None) -> Tensor:
        """Take a snapshot: ``A``, then the sensor.

        Args:
            scene: (B, V, U, H, W) relative irradiance, one colour channel; colours are folded into B. Or
                (B, K, V, U, H, W) for a scene that changes from slot to slot.
            generator: source of the sensor's randomness, or a seed.

        Returns:
            (B, 1, H, W) snapshot.

        Raises:
            ShapeError: wrong views, size or slots.
        """
        exact = self._moving(scene) if scene.ndim == 6 else self.A(scene)
        return self.record(exact, generator)

    def _moving(self, scene: Tensor) -> Tensor:
        if scene.shape[1] != self.slots:
            raise ShapeError("scene", f"shape {tuple(scene.shape)}", f"(batch, {self.slots} slots, …)")
        aperture, shutter = self.codes()
        weight = exposure_weight(self.exposure, self.slots)
        found = self.response.new_zeros(())
        for k in range(self.slots):
            self._check(scene[:, k])
            planes = aperture[k : k + 1], shutter[k : k + 1]
            found = found + weight * coded_mask(*planes, self.shear, self.vignetting).A(scene[:, k].flatten(1, 2))
        return found

    def _check(self, scene: Tensor) -> None:
        if scene.ndim != 5 or tuple(scene.shape[1:]) != self.scene_shape:
            wanted = f"(batch, {', '.join(map(str, self.scene_shape))})"
            raise ShapeError("light field", f"shape {tuple(scene.shape)}", wanted, "crop it, or take the centre views")

    def _geometry(self) -> tuple[object, ...]:
        return (self.shear,)

    def _collapsed(self) -> TapOperator:
        return coded_mask(*self.codes(), self.shear, self.vignetting, self.exposure)


def _weights(vignetting: Tensor | Sequence[Sequence[float]] | None, grid: tuple[int, int]) -> Tensor:
    try:
        values = (
            torch.ones(grid) if vignetting is None else torch.as_tensor(vignetting, dtype=torch.get_default_dtype())
        )
    except (TypeError, ValueError):
        raise ShapeError("vignetting", "rows of unequal length, or no numbers", f"{grid}, one value per view") from None
    if tuple(values.shape) != grid:
        raise ShapeError("vignetting", f"shape {tuple(values.shape)}", f"{grid}, one value per view")
    if not bool(torch.isfinite(values).all()) or values.min() < 0 or values.max() <= 0:
        raise SettingError("vignetting", str(values.tolist()), "finite numbers ≥ 0, not all zero")
    return values
