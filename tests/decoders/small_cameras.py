"""Small cameras to decode with, their matrices, and scenes for them."""

from __future__ import annotations

import torch
from torch import Tensor

from tmca.operators import LinearOperator, TapOperator, Taps


class BlurredCamera(LinearOperator):
    """A blur along y before a camera: its Gram matrix is not diagonal: ``gram_solve`` iterates."""

    def __init__(self, camera: TapOperator) -> None:
        super().__init__()
        self.camera = camera
        rows = torch.arange(camera.scene_shape[1])
        self.blur = 0.5 ** (rows[:, None] - 0.7 * rows).abs().to(camera.taps.code)
        self.scene_shape, self.snapshot_shape = camera.scene_shape, camera.snapshot_shape

    def A(self, x: Tensor) -> Tensor:
        return self.camera.A(self.blur @ x)

    def A_adjoint(self, y: Tensor) -> Tensor:
        return self.blur.mT @ self.camera.A_adjoint(y)


def matrix(camera: LinearOperator, dtype: torch.dtype = torch.float64) -> Tensor:
    """The explicit matrix of a camera, a column per scene entry in (L, H, W) order."""
    size = torch.Size(camera.scene_shape).numel()
    units = torch.eye(size, dtype=dtype).reshape(size, *camera.scene_shape)
    return camera.A(units).flatten(1).mT


def coded_camera(shape: tuple[int, int, int] = (3, 6, 7), dtype: torch.dtype = torch.float64) -> TapOperator:
    """A static random binary code, sheared by one pixel per band."""
    bands, height, width = shape
    draw = torch.rand(height, width, generator=torch.Generator().manual_seed(3))
    code = (draw < 0.5).to(dtype).expand(bands, -1, -1)
    return TapOperator(Taps(code, tuple(range(bands)), tuple(range(bands)), bands, width + bands - 1))


def blocky_scene(shape: tuple[int, ...], dtype: torch.dtype = torch.float64, seed: int = 0) -> Tensor:
    """(B, L, H, W) in [0, 1]: a bright rectangle on a darker textured ground."""
    scene = 0.2 + 0.1 * torch.rand(shape, generator=torch.Generator().manual_seed(seed), dtype=dtype)
    scene[..., 1 : shape[-2] // 2 + 1, 2 : shape[-1] // 2 + 2] += 0.5
    return scene
