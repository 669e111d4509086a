"""Layered image formation: every depth plane blurred by its own point spread functions (thesis eqs 30 to 36)."""

from __future__ import annotations

import torch
from scipy.fft import next_fast_len
from torch import Tensor
from torch.nn.functional import pad

from tmca.errors import ShapeError, check_shape
from tmca.operators.linear import LinearOperator, exposure_weight

Size = tuple[int, int]
_LEAST = 1e-6


def framed(size: Size, psf: Size) -> Size:
    """(H', W') of a frame that holds a scene (H, W) and its blur by PSFs (h, w): of small factors, even width."""
    height, width = size[0] + psf[0] - 1, size[1] + psf[1] - 1
    return next_fast_len(height, real=True), 2 * next_fast_len((width + 1) // 2, real=True)


def transfer_functions(psf: Tensor, frame: Size) -> Tensor:
    """Fourier transforms (..., H', W'/2+1) of PSFs (..., h, w), whose middle is their pixel (h//2, w//2).

    Scenes go on periodically after ``frame`` (H', W') pixels. In that of ``framed`` they are dark around: no light
    comes round.

    Raises:
        ShapeError: a PSF larger than the frame.
    """
    h, w = psf.shape[-2:]
    if h > frame[0] or w > frame[1]:
        raise ShapeError("psf", f"{h}×{w} pixels", f"at most the frame of {frame[0]}×{frame[1]}", "take larger patches")
    padded = pad(psf, (0, frame[1] - w, 0, frame[0] - h))
    return torch.fft.rfft2(padded.roll((-(h // 2), -(w // 2)), (-2, -1)))


def layered(scene: Tensor, weights: Tensor, transfer: Tensor, frame: Size) -> Tensor:
    """Irradiance g (B, K, L, H, W) of every slot in the linear model (eq. 30), summed in the Fourier domain.

    Band by band, so that the sums of all slots stay in the processor's cache.

    Args:
        scene: (B, L, H, W), or (B, K, L, H, W) where it changes from slot to slot.
        weights: ω (B, D, H, W), or (1, D, H, W) for any batch.
        transfer: (K, D, L, H', W'/2+1) of ``transfer_functions``.
        frame: (H', W').

    Raises:
        ShapeError: parts that do not fit each other.
    """
    moving = scene if scene.ndim == 5 else scene[:, None]
    _check(moving, weights, transfer, frame)
    filled, bands = _filled(weights), list[Tensor]()
    layers = weights[:, None, filled]
    for band, passed in zip(moving.unbind(2), transfer.unbind(2), strict=True):
        spectra, blurs = torch.fft.rfft2(band[:, :, None] * layers, s=frame).unbind(2), passed.unbind(1)
        total = spectra[0] * blurs[filled[0]]
        for spectrum, depth in zip(spectra[1:], filled[1:], strict=True):
            total.addcmul_(spectrum, blurs[depth])
        bands.append(torch.fft.irfft2(total, s=frame)[..., : scene.shape[-2], : scene.shape[-1]])
    return torch.stack(bands, 2)


def composited(scene: Tensor, weights: Tensor, transfer: Tensor, frame: Size) -> Tensor:
    """Irradiance (B, K, L, H, W) where near layers hide far ones: alpha compositing from far to near.

    Each layer and its coverage are blurred, divided by the blurred coverage of it and all behind it, and laid over what
    is behind. Not linear in depth, but in the scene. Source: Ikoma et al., ICCP 2021, eqs 3 to 5.

    Arguments as in ``layered``; planes of ``weights`` from far to near.
    """
    moving = scene if scene.ndim == 5 else scene[:, None]
    _check(moving, weights, transfer, frame)
    behind, seen = torch.zeros_like(weights[:, :1]), None
    for depth in _filled(weights):
        share = weights[:, None, None, depth]
        behind = behind + weights[:, depth : depth + 1]
        light, cover, ground = (
            _blurred(part, transfer[:, depth], frame) for part in (moving * share, share, behind[:, None])
        )
        ground = ground.clamp_min(_LEAST)
        light, cover = light / ground, cover / ground
        seen = light if seen is None else seen * (1 - cover) + light
    assert seen is not None
    return seen


def _filled(weights: Tensor) -> list[int]:
    """Layers in which there is anything: the others add nothing, except to the gradient in their weights."""
    if weights.requires_grad:
        return list(range(weights.shape[1]))
    filled: list[int] = (weights != 0).flatten(2).any(2).any(0).nonzero().flatten().tolist()
    return filled or [0]


def _blurred(values: Tensor, transfer: Tensor, frame: Size) -> Tensor:
    spectrum = torch.fft.rfft2(values, s=frame)
    return torch.fft.irfft2(spectrum * transfer, s=frame)[..., : values.shape[-2], : values.shape[-1]]


def _check(scene: Tensor, weights: Tensor, transfer: Tensor, frame: Size) -> None:
    slots, depths, bands = transfer.shape[:3]
    check_shape("scene", scene, ("B", 1 if scene.shape[1] == 1 else slots, bands, "H", "W"))
    check_shape("weights", weights, (1 if len(weights) == 1 else len(scene), depths, *scene.shape[-2:]))
    check_shape("transfer functions", transfer, (..., frame[0], frame[1] // 2 + 1), "take those of this frame")


def coded_exposure(irradiance: Tensor, colour: Tensor, shutters: Tensor, exposure: str = "equal") -> Tensor:
    """Snapshot (B, R·C, H, W) of irradiance (B, K, L, H, W) through colour filters and shutter on the sensor (eq. 34).

    ``e_{c,m,n} = (1/K) Σ_k S^k_{m,n} Σ_ℓ C_{c,ℓ,m,n} g_{k,ℓ,m,n}``.

    Args:
        irradiance: of every slot.
        colour: (C, L, H, W) transmittance of the filter over every pixel, times the response of sensor channel c.
        shutters: (R, K, H, W) of pixels with R buckets, whose channels come one bucket after the other.
        exposure: ``"equal"`` (mean over slots) or ``"per-slot"`` (sum).

    Raises:
        ShapeError: parts that do not fit each other.
    """
    slots, *image = irradiance.shape[1:]
    check_shape("colour", colour, ("C", *image))
    check_shape("shutter", shutters, ("R", slots, *image[1:]))
    weight = exposure_weight(exposure, slots)
    recorded = (torch.einsum("bklhw,khw->blhw", irradiance, shutter) * weight for shutter in shutters)
    return torch.cat([torch.einsum("blhw,clhw->bchw", light, colour) for light in recorded], 1)


def equivalent_psf(
    psf: Tensor, colour: Tensor, shutter: Tensor, pixel: tuple[int, int], depth: int, exposure: str = "equal"
) -> Tensor:
    """P̃ (C, L, h, w) of a point at a pixel and depth plane (eq. 35, errata): its PSFs behind filters and shutter.

    Args:
        psf: (K, D, L, h, w).
        colour: (C, L, H, W).
        shutter: (K, H, W), of one bucket.
        pixel: (i, j) of the point.
        depth: index of its plane.
        exposure: see ``coded_exposure``.

    Raises:
        ShapeError: a pixel outside the sensor.
    """
    (height, width), (h, w) = shutter.shape[1:], psf.shape[-2:]
    check_pixel(pixel, (height, width))
    top, left = pixel[0] - h // 2 + h, pixel[1] - w // 2 + w
    own_shutter, own_colour = (
        pad(plane, (w, w, h, h))[..., top : top + h, left : left + w] for plane in (shutter, colour)
    )
    mixed = torch.einsum("klhw,khw->lhw", psf[:, depth], own_shutter) * exposure_weight(exposure, len(shutter))
    return own_colour * mixed


def check_pixel(pixel: tuple[int, int], size: Size) -> None:
    """Raises ShapeError unless the pixel is on a sensor of (H, W)."""
    if not (0 <= pixel[0] < size[0] and 0 <= pixel[1] < size[1]):
        raise ShapeError("pixel", str(pixel), f"inside {size[0]}×{size[1]}")


class LayeredOperator(LinearOperator):
    """The linear camera at a given depth map: layers blurred slot by slot, seen through filters and shutter (eq. 34).

    Args:
        weights: ω (B, D, H, W) of the depth maps of a batch, or (1, D, H, W) for any batch.
        transfer: (K, D, L, H', W'/2+1), see ``transfer_functions``.
        frame: (H', W').
        colour: (C, L, H, W), filters times the response of the sensor's channels.
        shutters: (R, K, H, W) of pixels with R buckets.
        exposure: ``"equal"`` or ``"per-slot"``.

    Raises:
        ShapeError: parts that do not fit each other.
    """

    def __init__(
        self, weights: Tensor, transfer: Tensor, frame: Size, colour: Tensor, shutters: Tensor, exposure: str = "equal"
    ) -> None:
        super().__init__()
        size = (int(weights.shape[-2]), int(weights.shape[-1]))
        self.scene_shape = (transfer.shape[2], *size)
        self.snapshot_shape = (len(shutters) * colour.shape[0], *size)
        self.weights, self.transfer, self.frame = weights, transfer, frame
        self.colour, self.shutters, self.exposure = colour, shutters, exposure

    def A(self, scene: Tensor) -> Tensor:
        self._check("scene", scene)
        irradiance = layered(scene, self.weights, self.transfer, self.frame)
        return coded_exposure(irradiance, self.colour, self.shutters, self.exposure)

    def A_adjoint(self, snapshot: Tensor) -> Tensor:
        self._check("snapshot", snapshot)
        check_shape("weights", self.weights, (1 if len(self.weights) == 1 else len(snapshot), "D", "H", "W"))
        height, width = self.snapshot_shape[1:]
        light = torch.einsum("brchw,clhw->brlhw", snapshot.unflatten(1, (len(self.shutters), -1)), self.colour)
        light = light * exposure_weight(self.exposure, self.shutters.shape[1])
        bands = []
        for band, passed in zip(light.unbind(2), self.transfer.unbind(2), strict=True):
            slots = (band[:, :, None] * self.shutters).sum(1)
            spectra = torch.fft.rfft2(slots, s=self.frame)[:, :, None] * passed.conj()
            back = torch.fft.irfft2(spectra.sum(1), s=self.frame)[..., :height, :width]
            bands.append((back * self.weights).sum(1))
        return torch.stack(bands, 1)
