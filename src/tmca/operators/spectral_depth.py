"""Layered image formation: every depth plane blurred by its own point spread functions (thesis eqs 30 to 36)."""

from __future__ import annotations

import torch
from torch import Tensor

from tmca.errors import ShapeError
from tmca.operators.exposure import exposure_weight
from tmca.operators.linear import LinearOperator

Size = tuple[int, int]


def transfer_functions(psf: Tensor, size: Size) -> Tensor:
    """Fourier transforms (K, D, L, H', W'/2+1) of PSFs (K, D, L, h, w), for scenes of (H, W), dark around.

    The middle of a PSF is its pixel (h//2, w//2). The frame (H', W') of ``framed`` holds the whole blurred scene: no
    light comes round.

    Raises:
        ShapeError: not five dimensions.
    """
    if psf.ndim != 5:
        raise ShapeError("psf", str(tuple(psf.shape)), "(K, D, L, h, w)")
    return periodic_transfer_functions(psf, framed(size, (psf.shape[-2], psf.shape[-1])))


def framed(size: Size, psf: Size) -> Size:
    """(H', W') of the frame: at least scene and PSF less a pixel, of small factors, even width."""
    return _smooth(size[0] + psf[0] - 1, 1), _smooth(size[1] + psf[1] - 1, 2)


def periodic_transfer_functions(psf: Tensor, frame: Size) -> Tensor:
    """Fourier transforms of PSFs for scenes that go on periodically after ``frame`` pixels.

    Raises:
        ShapeError: a PSF larger than the frame.
    """
    h, w = psf.shape[-2:]
    if h > frame[0] or w > frame[1]:
        raise ShapeError("psf", f"{h}×{w} pixels", f"at most the frame of {frame[0]}×{frame[1]}", "take larger patches")
    padded = torch.nn.functional.pad(psf, (0, frame[1] - w, 0, frame[0] - h))
    return torch.fft.rfft2(padded.roll((-(h // 2), -(w // 2)), (-2, -1)))


def _smooth(least: int, multiple: int) -> int:
    """The least number from ``least`` on with factors 2, 3, 5 only, a multiple."""
    size = -(-least // multiple) * multiple
    while True:
        rest = size
        for factor in (2, 3, 5):
            while rest % factor == 0:
                rest //= factor
        if rest == 1:
            return size
        size += multiple


def layered(scene: Tensor, weights: Tensor, transfer: Tensor, frame: Size) -> Tensor:
    """Irradiance g (B, K, L, H, W) of every slot in the linear model (eq. 30), summed in the Fourier domain.

    Band by band, so that the sums of all slots stay in the processor's cache.

    Args:
        scene: (B, L, H, W), or (B, K, L, H, W) where it changes from slot to slot.
        weights: ω (B, D, H, W).
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


def layered_adjoint(image: Tensor, weights: Tensor, transfer: Tensor, frame: Size) -> Tensor:
    """The adjoint of ``layered`` in the scene: (B, L, H, W) of (B, K, L, H, W)."""
    _check(image, weights, transfer, frame)
    bands = []
    for band, passed in zip(image.unbind(2), transfer.unbind(2), strict=True):
        spectra = (torch.fft.rfft2(band, s=frame)[:, :, None] * passed.conj()).sum(1)
        back = torch.fft.irfft2(spectra, s=frame)[..., : image.shape[-2], : image.shape[-1]]
        bands.append((back * weights).sum(1))
    return torch.stack(bands, 1)


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


_LEAST = 1e-6


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
    if scene.ndim != 5 or scene.shape[1] not in (1, slots) or scene.shape[2] != bands:
        raise ShapeError("scene", str(tuple(scene.shape)), f"(B, {bands}, H, W) or (B, {slots}, {bands}, H, W)")
    wanted = (scene.shape[0], depths, *scene.shape[-2:])
    if tuple(weights.shape) != wanted:
        raise ShapeError("weights", str(tuple(weights.shape)), str(wanted))
    if tuple(transfer.shape[-2:]) != (frame[0], frame[1] // 2 + 1):
        raise ShapeError("transfer functions", f"{tuple(transfer.shape[-2:])}", f"those of a frame of {frame}")


def coded_exposure(irradiance: Tensor, colour: Tensor, shutter: Tensor, exposure: str = "equal") -> Tensor:
    """Snapshot (B, C, H, W) of irradiance (B, K, L, H, W) through colour filters and shutter on the sensor (eq. 34).

    ``e_{c,m,n} = (1/K) Σ_k S^k_{m,n} Σ_ℓ C_{c,ℓ,m,n} g_{k,ℓ,m,n}``.

    Args:
        irradiance: of every slot.
        colour: (C, L, H, W) transmittance of the filter over every pixel, times the response of sensor channel c.
        shutter: (K, H, W).
        exposure: ``"equal"`` (mean over slots) or ``"per-slot"`` (sum).

    Raises:
        ShapeError: parts that do not fit each other.
    """
    slots, bands, height, width = irradiance.shape[1:]
    for name, given, wanted in (
        ("colour", colour.shape[1:], (bands, height, width)),
        ("shutter", shutter.shape, (slots, height, width)),
    ):
        if tuple(given) != wanted:
            raise ShapeError(name, str(tuple(given)), str(wanted))
    recorded = torch.einsum("bklhw,khw->blhw", irradiance, shutter) * exposure_weight(exposure, slots)
    return torch.einsum("blhw,clhw->bchw", recorded, colour)


def coded_exposure_adjoint(snapshot: Tensor, colour: Tensor, shutter: Tensor, exposure: str = "equal") -> Tensor:
    """The adjoint of ``coded_exposure`` in the irradiance: (B, K, L, H, W) of (B, C, H, W)."""
    light = torch.einsum("bchw,clhw->blhw", snapshot, colour) * exposure_weight(exposure, len(shutter))
    return light[:, None] * shutter[:, None]


def equivalent_psf(
    psf: Tensor, colour: Tensor, shutter: Tensor, pixel: tuple[int, int], depth: int, exposure: str = "equal"
) -> Tensor:
    """P̃ (C, L, h, w) of a point at a pixel and depth plane (eq. 35, errata): its PSFs behind filters and shutter.

    Args:
        psf: (K, D, L, h, w).
        colour: (C, L, H, W).
        shutter: (K, H, W).
        pixel: (i, j) of the point.
        depth: index of its plane.
        exposure: see ``coded_exposure``.

    Raises:
        ShapeError: a pixel outside the sensor.
    """
    (height, width), (h, w) = shutter.shape[1:], psf.shape[-2:]
    check_pixel(pixel, (height, width))
    pad = (w, w, h, h)
    top, left = pixel[0] - h // 2 + h, pixel[1] - w // 2 + w
    own_shutter = torch.nn.functional.pad(shutter, pad)[:, top : top + h, left : left + w]
    own_colour = torch.nn.functional.pad(colour, pad)[..., top : top + h, left : left + w]
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
        shutter: (K, H, W).
        exposure: ``"equal"`` or ``"per-slot"``.

    Raises:
        ShapeError: parts that do not fit each other.
    """

    def __init__(
        self, weights: Tensor, transfer: Tensor, frame: Size, colour: Tensor, shutter: Tensor, exposure: str = "equal"
    ) -> None:
        super().__init__()
        size = (int(weights.shape[-2]), int(weights.shape[-1]))
        self.scene_shape = (transfer.shape[2], *size)
        self.snapshot_shape = (colour.shape[0], *size)
        self.weights, self.transfer, self.frame = weights, transfer, frame
        self.colour, self.shutter, self.exposure = colour, shutter, exposure

    def A(self, scene: Tensor) -> Tensor:
        """(B, L, H, W) → (B, C, H, W)."""
        self._check(scene, self.scene_shape, "scene")
        seen = layered(scene, self._weights_of(scene), self.transfer, self.frame)
        return coded_exposure(seen, self.colour, self.shutter, self.exposure)

    def A_adjoint(self, snapshot: Tensor) -> Tensor:
        """(B, C, H, W) → (B, L, H, W)."""
        self._check(snapshot, self.snapshot_shape, "snapshot")
        spread = coded_exposure_adjoint(snapshot, self.colour, self.shutter, self.exposure)
        return layered_adjoint(spread, self._weights_of(snapshot), self.transfer, self.frame)

    def _weights_of(self, batch: Tensor) -> Tensor:
        return self.weights.expand(len(batch), -1, -1, -1) if len(self.weights) == 1 else self.weights
