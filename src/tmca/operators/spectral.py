"""The spectral camera's operators: single disperser (CASSI, thesis eqs 18–21), dual disperser, coloured codes, and the
single disperser slot by slot, for relay blur and scenes that move within the exposure (eqs 4, 14, 18)."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import conv2d

from tmca.errors import ShapeError, check_shape
from tmca.operators.kernels import Layout, backproject, project, sheared_code
from tmca.operators.linear import LinearOperator, exposure_weight
from tmca.operators.taps import TapOperator, Taps, sum_by_channel
from tmca.optics import Dispersion


def single_disperser(
    aperture: Tensor,
    shutter: Tensor,
    dispersion: Dispersion,
    response: Tensor | None = None,
    exposure: str = "equal",
) -> TapOperator:
    """Mask, prism, shuttered sensor: ``T̂_{i,j,ℓ} = (1/K) Σ_k S^k_{i,j+d_ℓ} T^k_{i,j}`` (20) and
    ``e_{m,n} = Σ_ℓ κ_ℓ T̂_{m,n-d_ℓ,ℓ} f_{m,n-d_ℓ,ℓ}`` (21).

    Where a band falls between two pixels its light meets two shutters: one code per tap, not an interpolated shutter.

    Args:
        aperture: (K, H, W) T^k in [0, 1].
        shutter: (K, H, W') S^k in [0, 1], W' = W + dispersion.extent.
        dispersion: displacement of every band, pixels.
        response: (L,) sensor response κ_ℓ; ones if None.
        exposure: ``"equal"`` or ``"per-slot"``.

    Raises:
        ShapeError: aperture, shutter, dispersion and response do not fit.
    """
    _check_wider("shutter", shutter, aperture, dispersion)
    bands, offsets, weights = zip(*dispersion.taps(), strict=True)
    code = sheared_code(aperture, shutter, [(0, offset) for offset in offsets])
    scale = exposure_weight(exposure, len(shutter)) * code.new_tensor(weights)
    return _operator(code, bands, offsets, scale, response, shutter.shape[2])


def dual_disperser(
    aperture: Tensor,
    shutter: Tensor,
    dispersion: Dispersion,
    response: Tensor | None = None,
    exposure: str = "equal",
) -> TapOperator:
    """Prism, mask, opposite prism: the spectrum is recombined before the sensor,
    ``T̂_{m,n,ℓ} = (1/K) Σ_k S^k_{m,n} T^k_{m,n-d_ℓ}`` (errata), snapshot as large as the scene, mask wider.

    Arguments and errors of ``single_disperser``, but for the planes: aperture (K, H, W + dispersion.extent), shutter
    (K, H, W).
    """
    _check_wider("aperture", aperture, shutter, dispersion)
    mirrored = Dispersion(tuple(-d for d in dispersion.displacement))
    bands, offsets, weights = zip(*mirrored.taps(), strict=True)
    taps = sheared_code(shutter, aperture, [(0, offset) for offset in offsets])
    code = sum_by_channel(taps * taps.new_tensor(weights)[:, None, None], bands, dispersion.bands)
    scale = code.new_full((len(code),), exposure_weight(exposure, len(shutter)))
    return _operator(code, tuple(range(len(code))), (0,) * len(code), scale, response, shutter.shape[2])


def coloured_code(code: Tensor, dispersion: Dispersion, response: Tensor | None = None) -> TapOperator:
    """Single disperser behind any code cube: coloured filters, or a T̂ that was computed elsewhere.

    Args:
        code: (L, H, W) transmittance of the mask in every band.
        dispersion: displacement of every band, pixels.
        response: (L,) sensor response κ_ℓ; ones if None.

    Raises:
        ShapeError: the code or the response has another number of bands than the dispersion.
    """
    check_shape("coloured code", code, (dispersion.bands, "H", "W"))
    bands, offsets, weights = zip(*dispersion.taps(), strict=True)
    picked = code[list(bands)]
    return _operator(picked, bands, offsets, picked.new_tensor(weights), response, code.shape[2] + dispersion.extent)


def _operator(
    code: Tensor,
    bands: tuple[int, ...],
    offsets: tuple[int, ...],
    scale: Tensor,
    response: Tensor | None,
    width: int,
) -> TapOperator:
    """The operator of taps (t, H, W), each scaled, on snapshots of ``width`` columns; the code is a cube of its own."""
    scale = _with_response(scale, bands, response)
    # scaled in place, a pass over fresh memory is saved
    scaled = code * scale if scale.requires_grad else code.mul_(scale)
    return TapOperator(Taps(scaled, bands, offsets, len(set(bands)), width))


def _with_response(scale: Tensor, bands: tuple[int, ...], response: Tensor | None) -> Tensor:
    """(t, 1, 1) scale of every tap times the sensor's response to its band."""
    if response is not None:
        check_shape("response", response, (len(set(bands)),), "one value per band")
        scale = scale * response.to(scale)[list(bands)]
    return scale[:, None, None]


def _check_wider(where: str, plane: Tensor, narrow: Tensor, dispersion: Dispersion) -> None:
    slots, rows, columns = narrow.shape
    remedy = f"it is the other plane's {tuple(narrow.shape)} widened by a dispersion of {dispersion.extent}"
    check_shape(where, plane, (slots, rows, columns + dispersion.extent), remedy)


class SlotwiseDisperser(LinearOperator):
    """Single disperser without collapsing the slots, for relay blur and moving scenes.

    Where the light of a slot cannot be collapsed into one code cube, every slot is imaged on its own and the shutter
    integrates them: ``e = (1/K) Σ_k S^k Σ_ℓ κ_ℓ shift_ℓ(h_ℓ * (T^k f^k_ℓ))``. Light that the relay throws beyond the
    frame is lost. ``A_dagger`` iterates (conjugate gradients).

    Args:
        aperture, shutter, dispersion, response, exposure: see ``single_disperser``.
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
        _check_wider("shutter", shutter, aperture, dispersion)
        if blur is not None and (
            blur.ndim != 3 or len(blur) != dispersion.bands or not all(side % 2 for side in blur.shape[1:])
        ):
            raise ShapeError("relay blur", f"shape {tuple(blur.shape)}", f"({dispersion.bands}, odd, odd)")
        bands, offsets, weights = zip(*dispersion.taps(), strict=True)
        scale = torch.tensor(weights).to(aperture) * exposure_weight(exposure, len(aperture))
        self.moving = moving
        for name, values in {"aperture": aperture, "shutter": shutter, "blur": blur}.items():
            self.register_buffer(name, values)
        self.register_buffer("scale", _with_response(scale, bands, response))
        slots, rows, width = shutter.shape
        still = (dispersion.bands, *aperture.shape[1:])
        self.scene_shape = (slots, *still) if moving else still
        self.snapshot_shape = (1, rows, width)
        self._layout: Layout = (bands, offsets, dispersion.bands, width, 1)

    def A(self, scene: Tensor) -> Tensor:
        self._check("scene", scene)
        slots = scene if self.moving else scene[:, None]
        # conv2d correlates: the flipped kernel makes it the convolution of eq. 18
        kernel = None if self.blur is None else self.blur.flip(1, 2)
        light = _filtered((self.aperture[:, None] * slots).flatten(0, 1), kernel)
        snapshots = project(light, self._weights(), self._layout).unflatten(0, (-1, len(self.aperture)))
        return (self.shutter[:, None] * snapshots).sum(1)

    def A_adjoint(self, snapshot: Tensor) -> Tensor:
        self._check("snapshot", snapshot)
        behind = (self.shutter[:, None] * snapshot[:, None]).flatten(0, 1)
        light = _filtered(backproject(behind, self._weights(), self._layout), self.blur)
        slots = self.aperture[:, None] * light.unflatten(0, (-1, len(self.aperture)))
        return slots if self.moving else slots.sum(1)

    def _weights(self) -> Tensor:
        return self.scale.expand(-1, *self.aperture.shape[1:])


def _filtered(light: Tensor, kernel: Tensor | None) -> Tensor:
    """Every band (B·K, L, H, W) correlated with a kernel (L, h, w) of its own."""
    if kernel is None:
        return light
    light = light.contiguous(memory_format=torch.channels_last)  # 4 times faster there, slots as the batch
    half = (kernel.shape[1] // 2, kernel.shape[2] // 2)
    return conv2d(light, kernel[:, None], padding=half, groups=len(kernel)).contiguous()
