"""How good a reconstruction is where nobody knows the truth.

The re-projection error says whether an estimate explains the snapshot, which an estimate with many unknowns does too
easily. Pixels of the snapshot that the decoder is not shown, and has to predict, say more: their shutter is closed and
their value taken away. Two decoders of different kinds that agree are the third witness.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from studies.bench import without_pixels
from tmca.cameras import Snapshot, SpectralCamera
from tmca.codes import Codes
from tmca.errors import check_range
from tmca.metrics import psnr, sam
from tmca.operators import LinearOperator


def reprojection_error(operator: LinearOperator, estimate: Tensor, snapshot: Tensor) -> float:
    """``‖A x − y‖ / ‖y‖``."""
    return float((operator.A(estimate) - snapshot).norm() / snapshot.norm())


def withheld(
    snapshot: Snapshot[SpectralCamera], share: float = 0.05, seed: int = 0
) -> tuple[Snapshot[SpectralCamera], Tensor]:
    """A snapshot without some of its pixels, and which they are.

    Args:
        snapshot: behind a single disperser.
        share: of the sensor pixels.
        seed: of their choice.

    Returns:
        The snapshot whose shutter is closed there, and (H, W') True where a pixel is withheld.

    Raises:
        SettingError: a share outside (0, 1).
    """
    check_range("share", share, above=0, below=1)
    size = snapshot.values.shape[-2:]
    hidden = torch.rand(size, generator=torch.Generator().manual_seed(seed)) < share
    return without_pixels(snapshot, hidden), hidden


def prediction_error(operator: LinearOperator, estimate: Tensor, snapshot: Tensor, hidden: Tensor) -> float:
    """`reprojection_error` over the withheld pixels alone.

    Args:
        operator: of the whole snapshot.
        estimate: made without the hidden pixels.
        snapshot: (1, 1, H, W') with them.
        hidden: (H, W').
    """
    rest = (operator.A(estimate) - snapshot)[0, 0][hidden]
    return float(rest.norm() / snapshot[0, 0][hidden].norm())


def neighbours_error(snapshot: Tensor, hidden: Tensor) -> float:
    """What the mean of the four neighbours that are shown makes of the withheld pixels: the plain baseline."""
    shown = (~hidden).to(snapshot)
    kernel = torch.tensor([[0.0, 1, 0], [1, 0, 1], [0, 1, 0]]).to(snapshot)[None, None]
    counts = torch.nn.functional.conv2d(shown[None, None], kernel, padding=1).clamp_min(1)
    mean = torch.nn.functional.conv2d(snapshot * shown, kernel, padding=1) / counts
    return float((mean - snapshot)[0, 0][hidden].norm() / snapshot[0, 0][hidden].norm())


def agreement(one: np.ndarray, other: np.ndarray, lit: float = 0.1) -> tuple[float, float]:
    """PSNR in dB and spectral angle in degrees between two estimates (L, H, W), the scale of the first taken for both.

    Args:
        one, other: estimates of the same scene.
        lit: spectral angles count where the first is brighter than this share of its 99th percentile.
    """
    top = float(np.quantile(one, 0.999))
    level = one.mean(0)
    bright = level > lit * float(np.quantile(level, 0.99))
    angle = sam(one[:, bright][..., None], other[:, bright][..., None])
    return float(psnr(one / top, other / top)), float(angle)


def brightest_rows(snapshot: Snapshot[SpectralCamera], rows: int) -> Snapshot[SpectralCamera]:
    """The part of a capture, ``rows`` high, with most light; rows are independent behind a disperser along x."""
    camera, values = snapshot.camera, snapshot.values
    rows = min(rows, camera.size[0])
    light = np.convolve(values[0, 0].sum(1).numpy(), np.ones(rows), "valid")
    top = int(light.argmax())
    part = slice(top, top + rows)
    return Snapshot(values[:, :, part], part_of(camera, part, slice(0, camera.size[1])), snapshot.notes)


def part_of(camera: SpectralCamera, rows: slice, columns: slice) -> SpectralCamera:
    """The same camera behind a part of its codes, in scene pixels."""
    aperture, shutter = camera.codes()
    seen = slice(columns.start, columns.stop + shutter.shape[2] - camera.size[1])
    size = (rows.stop - rows.start, columns.stop - columns.start)
    return camera.replace(size=size, codes=Codes(aperture[:, rows, columns], shutter[:, rows, seen]))
