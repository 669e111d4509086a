"""Example cubes in one small file that travels to the machine that trains, and scenes drawn from them."""

from __future__ import annotations

import io
import lzma
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d

_LEVELS = 65535
_TINT, _TERMS = 0.25, 4
"""Size of the first cosine by which the logarithm of an illuminant changes along the bands, and how many there are."""


def write_cubes(cubes: Sequence[Tensor], path: Path) -> None:
    """Cubes (L, H, W) of one size, relative irradiance of [0, 1], to 16 bits: half of what a MAT file takes."""
    values = np.stack([np.rint(cube.numpy() * _LEVELS).astype(np.uint16) for cube in cubes])
    steps = np.concatenate((values[:, :1], np.diff(values, axis=1)), axis=1)  # modulo 2¹⁶
    packed = io.BytesIO()
    np.save(packed, np.stack((steps >> 8, steps & 255)).astype(np.uint8))
    path.write_bytes(lzma.compress(packed.getvalue(), preset=6))


def read_cubes(path: Path) -> list[Tensor]:
    """What ``write_cubes`` wrote."""
    high, low = np.load(io.BytesIO(lzma.decompress(path.read_bytes())), allow_pickle=False).astype(np.uint16)
    values = np.cumsum(high * np.uint16(256) + low, axis=1, dtype=np.uint16)
    return [torch.from_numpy(cube.astype(np.float32) / _LEVELS) for cube in values]


def drawn_scene(cubes: Sequence[Tensor], rng: np.random.Generator) -> Tensor:
    """(L, H, W) one of the cubes, turned and mirrored, under another light; or four of them at half the size."""
    if rng.random() < 0.3:
        parts = [_lit(avg_pool2d(_turned(cubes, rng), 2), rng) for _ in range(4)]
        return torch.cat([torch.cat(parts[:2], 2), torch.cat(parts[2:], 2)], 1)
    scene = _turned(cubes, rng)
    scene = _lit(scene, rng) if rng.random() < 0.6 else scene
    return _within(scene * float(rng.uniform(0.3, 1.2))) if rng.random() < 0.3 else scene


def _turned(cubes: Sequence[Tensor], rng: np.random.Generator) -> Tensor:
    cube = cubes[int(rng.integers(len(cubes)))]
    for axis in (1, 2):
        cube = cube.flip(axis) if rng.random() < 0.5 else cube
    return cube.transpose(1, 2) if rng.random() < 0.5 else cube


def _lit(scene: Tensor, rng: np.random.Generator) -> Tensor:
    """A scene under a light whose logarithm is a sum of a few cosines along the bands."""
    place = torch.linspace(0, np.pi, len(scene))
    size = _TINT * rng.normal(size=_TERMS) / np.arange(1, _TERMS + 1)
    terms = [a * torch.cos(k * place + p) for k, (a, p) in enumerate(zip(size, rng.uniform(0, 6, _TERMS), strict=True))]
    light = torch.stack(terms).sum(0)
    return _within(scene * torch.exp(light - light.mean())[:, None, None].to(scene))


def _within(scene: Tensor) -> Tensor:
    return scene / max(1.0, float(scene.max()))
