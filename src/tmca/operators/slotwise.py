"""Slot by slot: relay blur between mask and sensor, and scenes that move within the exposure.

Where the light of a slot cannot be collapsed into one code cube, every slot is imaged on its own and the shutter
integrates them: ``e = (1/K) Σ_k S^k Σ_ℓ κ_ℓ shift_ℓ(h_ℓ * (T^k f^k_ℓ))`` (thesis eqs 4, 14, 18).
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import conv2d

from tmca.errors import ShapeError
from tmca.operators.exposure import exposure_weight
from tmca.operators.linear import LinearOperator
from tmca.operators.tap_kernels import Layout, backproject, project
from tmca.optics import Dispersion


class SlotwiseDisperser(LinearOperator):
    """Single disperser without collapsing the slots, for relay blur and moving scenes.

    Light that the relay throws beyond the frame is lost. ``A_dagger`` iterates (conjugate gradients).

    Args:
        aperture: (K, H, W) T^k.
        shutter: (K, H, W') S^k.
        dispersion: displacement of every band, pixels.
        response: (L,) κ_ℓ; ones if None.
        exposure: ``"equal"`` or ``"per-slot"``.
        blur: (L, h, w) point spread of the relay in every band, odd h and w; None for a perfect relay.
        moving: scenes are (B, K, L, H, W), one per slot, instead of (B, L, H, W).

    Raises:
        ShapeError: planes, response or blur do not fit.
    """

    aperture: Tensor
    shutter: Tensor
    blur: Tensor | None
    scale: Tensor

    def __init__(
        self,
        aperture: Tensor,
        shutter: Tensor,
        dispersion: Dispersion,
        response: Tensor | None = None,
        exposure: str = "equal",
        blur: Tensor | None = None,
        moving: bool = False,
    ) -> None:
        super().__init__()
        slots, rows, columns = aperture.shape
        width = columns + dispersion.spread
        if tuple(shutter.shape) != (slots, rows, width):
            raise ShapeError("shutter", f"shape {tuple(shutter.shape)}", f"({slots}, {rows}, {width})")
        if blur is not None and (
            blur.ndim != 3 or blur.shape[0] != dispersion.bands or not all(s % 2 for s in blur.shape[1:])
        ):
            raise ShapeError("relay blur", f"shape {tuple(blur.shape)}", f"({dispersion.bands}, odd, odd)")
        self.register_buffer("aperture", aperture)
        self.register_buffer("shutter", shutter)
        self.register_buffer("blur", blur)
        bands, offsets, weights = zip(*dispersion.taps(), strict=True)
        scale = torch.tensor(weights).to(aperture) * exposure_weight(exposure, slots)
        if response is not None:
            scale = scale * response.to(scale)[list(bands)]
        self.register_buffer("scale", scale[:, None, None])
        self.moving = moving
        self._layout: Layout = (bands, offsets, dispersion.bands, width)
        still = (dispersion.bands, rows, columns)
        self.scene_shape = (slots, *still) if moving else still
        self.snapshot_shape = (1, rows, width)

    def A(self, scene: Tensor) -> Tensor:
        """(B, L, H, W), or (B, K, L, H, W) if moving → (B, 1, H, W')."""
        self._check(scene, self.scene_shape, "scene")
        slots = scene if self.moving else scene[:, None]
        light = self._relay((self.aperture[:, None] * slots).flatten(0, 1))
        snapshots = project(light, self._weights(), self._layout).unflatten(0, (-1, len(self.aperture)))
        return (self.shutter[:, None] * snapshots).sum(1)

    def A_adjoint(self, snapshot: Tensor) -> Tensor:
        """(B, 1, H, W') → (B, L, H, W), or (B, K, L, H, W) if moving."""
        self._check(snapshot, self.snapshot_shape, "snapshot")
        behind = (self.shutter[:, None] * snapshot[:, None]).flatten(0, 1)
        light = self._relay_adjoint(backproject(behind, self._weights(), self._layout))
        slots = self.aperture[:, None] * light.unflatten(0, (-1, len(self.aperture)))
        return slots if self.moving else slots.sum(1)

    def _weights(self) -> Tensor:
        return self.scale.expand(-1, *self.aperture.shape[1:])

    def _relay(self, light: Tensor) -> Tensor:
        if self.blur is None:
            return light
        # conv2d correlates: the flipped kernel makes it the convolution of eq. 18
        kernel = self.blur.flip(1, 2)[:, None]
        light = light.contiguous(memory_format=torch.channels_last)  # 4 times faster there, slots as the batch
        return conv2d(light, kernel, padding=_half(self.blur), groups=self.blur.shape[0]).contiguous()

    def _relay_adjoint(self, light: Tensor) -> Tensor:
        if self.blur is None:
            return light
        light = light.contiguous(memory_format=torch.channels_last)
        return conv2d(light, self.blur[:, None], padding=_half(self.blur), groups=self.blur.shape[0]).contiguous()


def _half(blur: Tensor) -> tuple[int, int]:
    return (blur.shape[1] // 2, blur.shape[2] // 2)
