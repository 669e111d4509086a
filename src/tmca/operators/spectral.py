"""The spectral camera's operators: single disperser (CASSI, thesis eqs 18–21), dual disperser, coloured codes."""

from __future__ import annotations

from torch import Tensor

from tmca.errors import ShapeError
from tmca.operators.exposure import exposure_weight
from tmca.operators.sheared_code import sheared_code
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
        shutter: (K, H, W') S^k in [0, 1], W' = W + dispersion.spread.
        dispersion: displacement of every band, pixels.
        response: (L,) sensor response κ_ℓ; ones if None.
        exposure: ``"equal"`` or ``"per-slot"``.

    Raises:
        ShapeError: aperture, shutter and dispersion do not fit.
    """
    _check_planes(aperture, shutter, "aperture", "shutter", dispersion)
    channels, offsets, weights = _columns(dispersion)
    code = sheared_code(aperture, shutter, [(0, offset) for offset in offsets])
    scale = exposure_weight(exposure, len(shutter)) * code.new_tensor(weights)
    return _operator(code, channels, offsets, scale, response, shutter.shape[2])


def dual_disperser(
    aperture: Tensor,
    shutter: Tensor,
    dispersion: Dispersion,
    response: Tensor | None = None,
    exposure: str = "equal",
) -> TapOperator:
    """Prism, mask, opposite prism: the spectrum is recombined before the sensor,
    ``T̂_{m,n,ℓ} = (1/K) Σ_k S^k_{m,n} T^k_{m,n-d_ℓ}`` (errata), snapshot as large as the scene, mask wider.

    Args:
        aperture: (K, H, W + dispersion.spread) T^k.
        shutter: (K, H, W) S^k.
        dispersion: displacement of every band on the mask, pixels.
        response: (L,) sensor response κ_ℓ; ones if None.
        exposure: ``"equal"`` or ``"per-slot"``.

    Raises:
        ShapeError: aperture, shutter and dispersion do not fit.
    """
    _check_planes(shutter, aperture, "shutter", "aperture", dispersion)
    mirrored = Dispersion(tuple(-d for d in dispersion.displacement))
    channels, offsets, weights = _columns(mirrored)
    taps = sheared_code(shutter, aperture, [(0, offset) for offset in offsets])
    code = sum_by_channel(taps * taps.new_tensor(weights)[:, None, None], channels, dispersion.bands)
    scale = code.new_full((len(code),), exposure_weight(exposure, len(shutter)))
    return _operator(code, tuple(range(len(code))), (0,) * len(code), scale, response, shutter.shape[2])


def coloured_code(code: Tensor, dispersion: Dispersion, response: Tensor | None = None) -> TapOperator:
    """Single disperser behind any code cube: coloured filters, or a T̂ that was computed elsewhere.

    Args:
        code: (L, H, W) transmittance of the mask in every band.
        dispersion: displacement of every band, pixels.
        response: (L,) sensor response κ_ℓ; ones if None.

    Raises:
        ShapeError: the code has another number of bands than the dispersion.
    """
    if code.ndim != 3 or code.shape[0] != dispersion.bands:
        raise ShapeError("coloured code", f"shape {tuple(code.shape)}", f"({dispersion.bands}, H, W)")
    channels, offsets, weights = _columns(dispersion)
    picked = code[list(channels)]
    scale = picked.new_tensor(weights)
    return _operator(picked, channels, offsets, scale, response, code.shape[2] + dispersion.spread)


def _columns(dispersion: Dispersion) -> tuple[tuple[int, ...], tuple[int, ...], tuple[float, ...]]:
    bands, offsets, weights = zip(*dispersion.taps(), strict=True)
    return bands, offsets, weights


def _operator(
    code: Tensor,
    channels: tuple[int, ...],
    offsets: tuple[int, ...],
    scale: Tensor,
    response: Tensor | None,
    width: int,
) -> TapOperator:
    """The operator of taps (t, H, W), each scaled, on snapshots of ``width`` columns; the code is a cube of its own."""
    bands = len(set(channels))
    if response is not None:
        if response.shape != (bands,):
            raise ShapeError("response", f"shape {tuple(response.shape)}", f"({bands},), one value per band")
        scale = scale * response.to(scale)[list(channels)]
    # scaled in place, a pass over fresh memory is saved
    scaled = code * scale[:, None, None] if scale.requires_grad else code.mul_(scale[:, None, None])
    return TapOperator(Taps(scaled, channels, offsets, bands, width))


def _check_planes(near: Tensor, wide: Tensor, near_name: str, wide_name: str, dispersion: Dispersion) -> None:
    expected = (near.shape[0], near.shape[1], near.shape[2] + dispersion.spread)
    if tuple(wide.shape) != expected:
        raise ShapeError(
            wide_name,
            f"shape {tuple(wide.shape)}",
            f"{expected}: the {near_name}'s {tuple(near.shape)} widened by a dispersion of {dispersion.spread}",
        )
