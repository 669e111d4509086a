import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from skimage.restoration import denoise_tv_chambolle
from small_cameras import blocky_scene

from tmca.decoders.tv import divergence, gradient, project, total_variation, tv_prox


def random(*shape: int, dtype: torch.dtype = torch.float64) -> torch.Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(1), dtype=dtype)


@settings(deadline=None, max_examples=30)
@given(st.integers(1, 3), st.integers(1, 9), st.integers(1, 9))
def test_divergence_is_the_negative_adjoint_of_the_gradient(bands: int, height: int, width: int) -> None:
    cube, field = random(2, bands, height, width), random(2, 2, bands, height, width)
    assert torch.allclose((gradient(cube) * field).sum(), -(cube * divergence(field)).sum(), atol=1e-12)


@pytest.mark.parametrize("joint", [False, True])
def test_variation_equals_a_slow_loop(joint: bool) -> None:
    cube = random(1, 3, 4, 5)
    total = 0.0
    for m in range(4):
        for n in range(5):
            squares = []
            for band in cube[0]:
                down = float(band[m + 1, n] - band[m, n]) if m < 3 else 0.0
                right = float(band[m, n + 1] - band[m, n]) if n < 4 else 0.0
                squares.append(down**2 + right**2)
            total += math.sqrt(sum(squares)) if joint else sum(map(math.sqrt, squares))
    assert total_variation(cube, joint).item() == pytest.approx(total)


def test_variation_is_differentiable_and_flat_cubes_have_derivative_zero() -> None:
    cube = random(1, 2, 4, 3).requires_grad_()
    assert torch.autograd.gradcheck(lambda x: total_variation(x, joint=True), cube)
    flat = torch.ones(1, 2, 4, 3, requires_grad=True)
    total_variation(flat).sum().backward()
    assert flat.grad is not None
    assert torch.equal(flat.grad, torch.zeros_like(flat))


@pytest.mark.parametrize("joint", [False, True])
def test_shrinkage_shortens_every_gradient_by_the_threshold_or_to_zero(joint: bool) -> None:
    field, threshold = random(2, 1, 3, 5, 4), 0.8
    axes = (0, 2) if joint else (0,)
    before = torch.linalg.vector_norm(field, dim=axes)
    after = torch.linalg.vector_norm(field - project(field, threshold, joint), dim=axes)
    assert torch.allclose(after, (before - threshold).clamp_min(0), atol=1e-12)
    assert torch.linalg.vector_norm(project(field, threshold, joint), dim=axes).max() <= threshold + 1e-12


def test_variation_denoising_agrees_with_scikit_image() -> None:
    image = blocky_scene((1, 1, 13, 18))
    theirs = denoise_tv_chambolle(image[0, 0].numpy(), weight=0.05, eps=1e-12, max_num_iter=5000)
    ours = tv_prox(image, 0.05, max_iterations=2000, tolerance=1e-10)[0, 0].numpy()
    assert np.abs(ours - theirs).max() < 1e-4
