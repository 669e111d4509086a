"""What a code looks like before any prior is asked: light, levels, likeness of bands, conditioning."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import torch
from torch import Tensor

from tmca.cameras import Camera, CodedCamera, SpectralCamera
from tmca.design.expected_error import windows
from tmca.errors import SettingError
from tmca.operators import conditioning, dual_disperser, single_disperser, sparse_matrix
from tmca.operators.blocks import BlockModel


@dataclass(frozen=True)
class CodeMeasures:
    """Figures of a time-multiplexed code T̂ (L, H, W), of all buckets together where a pixel has several.

    Args:
        throughput: share of a white scene's light that is recorded, in all buckets.
        contrast: standard deviation of T̂ over its mean; 1 for a half-open binary code, less the more slots flatten it.
        levels: share of every value j/K that T̂ takes under equal exposure, by value.
        band_correlation: (L, L) correlation of the bands of T̂ over the frame, over its buckets too.
        singular_values: of a block's matrix A, falling, mean over blocks; in snapshot units per irradiance.
        coherence: largest cosine between what two different cosine patterns of a block leave on the snapshot.
    """

    throughput: float
    contrast: float
    levels: dict[float, float]
    band_correlation: Tensor
    singular_values: Tensor
    coherence: float

    @property
    def likeness(self) -> float:
        """Mean absolute correlation of two different bands: 0 where every band has a code of its own."""
        off = self.band_correlation - torch.diag(self.band_correlation.diagonal())
        count = len(off) * (len(off) - 1)
        return float(off.abs().sum() / count) if count else 0.0


@torch.no_grad()
def measures(camera: CodedCamera, *, block: tuple[int, int] = (4, 24), blocks: int = 8, seed: int = 0) -> CodeMeasures:
    """Judge a camera's code.

    Args:
        camera: its codes; relay blur is not covered.
        block: rows and columns of the blocks whose matrices are looked into; a smaller frame is repeated.
        blocks: how many of them, at random places.
        seed: of the places.

    Raises:
        SettingError: a camera with relay blur.
        ShapeError: a block no wider than the dispersion.
    """
    taps = camera.taps()
    cubes = camera.code_cube().double().reshape(camera.buckets, camera.channels, *taps.code.shape[1:])
    cube = cubes.transpose(0, 1)  # (L, R, H, W): what a band is weighed with, in every bucket of every pixel
    model = BlockModel.of(taps, (taps.scene_channels, *block))
    generator = torch.Generator().manual_seed(seed)
    places = torch.randint(1 << 16, (blocks, 2), generator=generator).tolist()
    matrices = block_matrices(model, windows(taps.code.double(), model.block, [(y, x) for y, x in places]))
    return CodeMeasures(
        throughput=camera.throughput(),
        contrast=float(cube.std(correction=0) / cube.mean()) if cube.any() else 0.0,
        levels=_levels(cube / camera.exposures),
        band_correlation=_correlation(cube),
        singular_values=torch.linalg.svdvals(matrices).mean(0),
        coherence=float(max(_coherence(matrix, model.block) for matrix in matrices)),
    )


def block_matrices(model: BlockModel, seen: Tensor) -> Tensor:
    """(P, m, n) matrices A of blocks under code windows (P, taps, h, w)."""
    weights, pixels = model.complete(seen).flatten(2).mT, model.pixels()
    matrices = weights.new_zeros(len(weights), len(pixels), model.block[0] * model.block[1] * model.block[2])
    return matrices.scatter_add_(2, pixels.expand(len(weights), -1, -1), weights)


def _levels(cube: Tensor) -> dict[float, float]:
    values, counts = cube.mul(1e6).round().div(1e6).unique(return_counts=True)
    return {float(v): float(c) / cube.numel() for v, c in zip(values, counts, strict=True)}


def _correlation(cube: Tensor) -> Tensor:
    """(L, L) correlations; a band that does not vary is like no other."""
    flat = cube.flatten(1) - cube.flatten(1).mean(1, keepdim=True)
    norms = flat.norm(dim=1)
    unit = flat / norms.clamp_min(1e-12)[:, None]
    return unit @ unit.mT


def _coherence(matrix: Tensor, block: tuple[int, int, int]) -> Tensor:
    """Mutual coherence of A with the separable cosine basis of the block, patterns that leave nothing apart."""
    from scipy.fft import dctn

    rows = matrix.reshape(len(matrix), *block).numpy()
    seen = torch.from_numpy(dctn(rows, axes=(1, 2, 3), norm="ortho")).flatten(1)
    norms = seen.norm(dim=0)
    if not bool(norms.any()):
        return torch.zeros((), dtype=seen.dtype)
    unit = seen[:, norms > 1e-9 * norms.max()]
    unit = unit / unit.norm(dim=0)
    cosines = (unit.mT @ unit).abs()
    return cosines.fill_diagonal_(0).max()


def corner_conditioning(camera: Camera, rows: int = 2, columns: int = 40) -> dict[str, Any]:
    """Rank, condition number and coherence of the matrix of the camera's first rows and columns (no relay blur).

    Rows do not mix in a disperser, so that few of them tell what there is to tell.

    Raises:
        SettingError: a camera without a disperser.
    """
    if not isinstance(camera, SpectralCamera):
        raise SettingError("conditioning", f"a {camera.kind} camera", "a spectral camera", "its matrix has a corner")
    height, width = min(rows, camera.size[0]), min(columns, camera.size[1])
    build, wide = single_disperser, camera.dispersion.extent
    aperture_width, shutter_width = width, width + wide
    if camera.disperser == "dual":
        build, aperture_width, shutter_width = dual_disperser, width + wide, width
    aperture, shutter = (plane.detach().double() for plane in camera.codes())
    operator = build(
        aperture[:, :height, :aperture_width],
        shutter[:, :height, :shutter_width],
        camera.dispersion,
        camera.response.detach().double(),
        camera.exposure,
    )
    return {"rows": height, "columns": width, **asdict(conditioning(sparse_matrix(operator)))}
