"""Small cameras to decode with, their matrices, and scenes for them."""

from __future__ import annotations

import torch
from torch import Tensor

from tmca.operators.linear import LinearOperator
from tmca.operators.taps import Taps


class TapCamera(LinearOperator):
    """The camera that `Taps` describes, tap by tap; offsets are integer, so its Gram matrix is diagonal."""

    def __init__(self, taps: Taps) -> None:
        super().__init__()
        self.taps, self.scene_shape, self.snapshot_shape = taps, taps.scene_shape, taps.snapshot_shape

    def _window(self, y: Tensor, tap: int) -> Tensor:
        offset = self.taps.offsets[tap]
        return y[:, 0, :, offset : offset + self.taps.code.shape[-1]]

    def A(self, x: Tensor) -> Tensor:
        y = x.new_zeros(x.shape[0], *self.snapshot_shape)
        for tap, channel in enumerate(self.taps.channels):
            self._window(y, tap).add_(self.taps.code[tap] * x[:, channel])
        return y

    def A_adjoint(self, y: Tensor) -> Tensor:
        x = y.new_zeros(y.shape[0], *self.scene_shape)
        for tap, channel in enumerate(self.taps.channels):
            x[:, channel] += self.taps.code[tap] * self._window(y, tap)
        return x

    def gram(self) -> Tensor:
        energy = self.taps.code.new_zeros(1, *self.snapshot_shape)
        for tap in range(len(self.taps.channels)):
            self._window(energy, tap).add_(self.taps.code[tap] ** 2)
        return energy

    def gram_solve(self, y: Tensor, shift: float, **iteration: object) -> Tensor:
        return y / (self.gram() + shift)

    def A_dagger(self, y: Tensor) -> Tensor:
        gram = self.gram()
        return self.A_adjoint(torch.where(gram > 0, y / gram.clamp_min(1e-12), 0))


class BlurredCamera(LinearOperator):
    """A blur along y before a camera: its Gram matrix is not diagonal: ``gram_solve`` iterates."""

    def __init__(self, camera: TapCamera) -> None:
        super().__init__()
        self.camera = camera
        rows = torch.arange(camera.scene_shape[1])
        self.blur = 0.5 ** (rows[:, None] - 0.7 * rows).abs().to(camera.taps.code)
        self.scene_shape, self.snapshot_shape = camera.scene_shape, camera.snapshot_shape

    def A(self, x: Tensor) -> Tensor:
        return self.camera.A(self.blur @ x)

    def A_adjoint(self, y: Tensor) -> Tensor:
        return self.blur.mT @ self.camera.A_adjoint(y)

    def A_dagger(self, y: Tensor) -> Tensor:
        inverse = torch.linalg.pinv(matrix(self, y.dtype))
        return (y.flatten(1) @ inverse.mT).reshape(-1, *self.scene_shape)


def matrix(camera: LinearOperator, dtype: torch.dtype = torch.float64) -> Tensor:
    """The explicit matrix of a camera, a column per scene entry in (L, H, W) order."""
    size = int(torch.tensor(camera.scene_shape).prod())
    units = torch.eye(size, dtype=dtype).reshape(size, *camera.scene_shape)
    return camera.A(units).flatten(1).mT


def coded_camera(shape: tuple[int, int, int] = (3, 6, 7), dtype: torch.dtype = torch.float64) -> TapCamera:
    """A static random binary code, sheared by one pixel per band."""
    bands, height, width = shape
    draw = torch.rand(height, width, generator=torch.Generator().manual_seed(3))
    code = (draw < 0.5).to(dtype).expand(bands, -1, -1)
    return TapCamera(Taps(code, tuple(range(bands)), tuple(range(bands)), bands, width + bands - 1))


def blocky_scene(shape: tuple[int, ...], dtype: torch.dtype = torch.float64, seed: int = 0) -> Tensor:
    """(B, L, H, W) in [0, 1]: a bright rectangle on a darker textured ground."""
    scene = 0.2 + 0.1 * torch.rand(shape, generator=torch.Generator().manual_seed(seed), dtype=dtype)
    scene[..., 1 : shape[-2] // 2 + 1, 2 : shape[-1] // 2 + 2] += 0.5
    return scene


def noisy(snapshot: Tensor, sigma: float) -> Tensor:
    noise = torch.randn(snapshot.shape, generator=torch.Generator().manual_seed(5), dtype=torch.float64)
    return snapshot + sigma * noise.to(snapshot)
