"""Slot by slot: relay blur between mask and sensor, and scenes that move within the exposure.

Where the light of a slot cannot be collapsed into one code cube, every slot is imaged on its own and the shutter
integrates them: ``e = (1/K) Σ_k S^k Σ_ℓ κ_ℓ shift_ℓ(h_ℓ * (T^k f^k_ℓ))`` (thesis eqs 4, 14, 18).
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import conv2d, conv_transpose2d

from tmca.errors import ShapeError
from tmca.operators.linear import LinearOperator
from tmca.operators.spectral import exposure_weight
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
        snapshot = scene.new_zeros(scene.shape[0], *self.snapshot_shape)
        weights = self.scale.expand(-1, *self.aperture.shape[1:])
        for k, (mask, open_) in enumerate(zip(self.aperture, self.shutter, strict=True)):
            light = self._relay(mask * (scene[:, k] if self.moving else scene))
            snapshot = snapshot + open_ * project(light, weights, self._layout)
        return snapshot

    def A_adjoint(self, snapshot: Tensor) -> Tensor:
        """(B, 1, H, W') → (B, L, H, W), or (B, K, L, H, W) if moving."""
        self._check(snapshot, self.snapshot_shape, "snapshot")
        weights = self.scale.expand(-1, *self.aperture.shape[1:])
        slots = [
            mask * self._relay_adjoint(backproject(open_ * snapshot, weights, self._layout))
            for mask, open_ in zip(self.aperture, self.shutter, strict=True)
        ]
        return torch.stack(slots, dim=1) if self.moving else torch.stack(slots).sum(0)

    def _relay(self, light: Tensor) -> Tensor:
        if self.blur is None:
            return light
        # conv2d correlates: the flipped kernel makes it the convolution of eq. 18
        kernel = self.blur.flip(1, 2)[:, None]
        return conv2d(light, kernel, padding=_half(self.blur), groups=self.blur.shape[0])

    def _relay_adjoint(self, light: Tensor) -> Tensor:
        if self.blur is None:
            return light
        kernel = self.blur.flip(1, 2)[:, None]
        return conv_transpose2d(light, kernel, padding=_half(self.blur), groups=self.blur.shape[0])


def _half(blur: Tensor) -> tuple[int, int]:
    return (blur.shape[1] // 2, blur.shape[2] // 2)
