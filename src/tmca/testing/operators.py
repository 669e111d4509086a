"""What every linear operator holds to."""

from __future__ import annotations

from collections.abc import Callable
from math import prod

import torch
from torch import Tensor

from tmca.operators import LinearOperator
from tmca.testing.comparing import Loop, close, drawn, run, same_shape, say

_DENSE = 1500
"""Entries of a scene up to which the explicit matrix is made."""


def check_operator(operator: LinearOperator, *, loop: Loop | None = None) -> None:
    """Check what an operator does: shapes, batches, its transpose, its proximal step and its pseudo-inverse.

    Up to 1500 entries of the scene they are compared with those of its explicit matrix too. The operator is checked in
    the precision, and on the device, of its tensors.

    Args:
        operator: a small one, of odd sides at best.
        loop: a slow and plain ``A`` of one scene (*scene_shape), which it is compared with.

    Raises:
        AssertionError: one line: what does not hold.
    """
    run(CHECKS, operator, type(operator).__name__)
    if loop is not None:
        run([is_its_slow_loop(loop)], operator, type(operator).__name__)


def is_its_slow_loop(loop: Loop) -> Callable[[LinearOperator], None]:
    """The check that ``A`` of a batch of two is what a loop makes of each."""

    def A_is_its_slow_loop(operator: LinearOperator) -> None:
        scene = _random(operator, 2, *operator.scene_shape)
        slow = torch.stack([loop(one) for one in scene])
        close(operator.A(scene), slow.to(scene), "A", **_tolerance(operator))

    return A_is_its_slow_loop


def shapes_and_batches_are_as_stated(operator: LinearOperator) -> None:
    """Shapes are the stated ones, and scenes of a batch are imaged one by one."""
    scene = _random(operator, 2, *operator.scene_shape)
    image = operator.A(scene)
    same_shape(image.shape, (2, *operator.snapshot_shape), "A of a batch of two")
    alone = torch.cat([operator.A(one) for one in scene.split(1)])
    close(image, alone, "A of a batch, and of its scenes one by one,", **_tolerance(operator))
    same_shape(operator.A_adjoint(image).shape, scene.shape, "A_adjoint of a batch of two")
    close(operator(scene), image, "the operator called, and A,", rtol=0, atol=0)


def inner_products_are_the_same_on_both_sides(operator: LinearOperator) -> None:
    """⟨A x, y⟩ = ⟨x, Aᵀ y⟩, in the precision of the operator."""
    scene = _random(operator, 2, *operator.scene_shape) - 0.5
    snapshot = _random(operator, 2, *operator.snapshot_shape) - 0.5
    image, back = operator.A(scene), operator.A_adjoint(snapshot)
    say(image.dtype == back.dtype == scene.dtype, f"{scene.dtype} becomes {image.dtype} and {back.dtype}")
    there, here = (image * snapshot).sum(), (scene * back).sum()
    limit = 50 * torch.finfo(scene.dtype).eps * image.norm() * snapshot.norm()
    say(bool(abs(there - here) <= limit), f"⟨A x, y⟩ is {float(there):.6g}, ⟨x, A_adjoint y⟩ is {float(here):.6g}")


def the_adjoint_is_the_transpose_of_the_explicit_matrix(operator: LinearOperator) -> None:
    """Aᵀ of a snapshot is the transposed matrix times it."""
    if (matrix := _matrix(operator)) is not None:
        snapshot = _random(operator, 1, *operator.snapshot_shape)
        expected = (matrix.mT @ snapshot.flatten().double()).reshape(1, *operator.scene_shape)
        close(operator.A_adjoint(snapshot).double(), expected, "A_adjoint", **_tolerance(operator))


def the_proximal_step_minimises_its_objective(operator: LinearOperator) -> None:
    """The gradient of ½‖A x − y‖² + ρ/2 ‖x − p‖² is zero at ``prox_l2(p, y, ρ)``; the dense solution is the same."""
    rho, limits = 0.3, _tolerance(operator)
    point, snapshot = _random(operator, 1, *operator.scene_shape), _random(operator, 1, *operator.snapshot_shape)
    found = operator.prox_l2(point, snapshot, rho)
    right = operator.A_adjoint(snapshot) + rho * point
    left = operator.A_adjoint(operator.A(found)) + rho * found
    close(left, right, "(AᵀA + ρI) prox_l2, and Aᵀy + ρp,", rtol=0, atol=limits["rtol"] * float(right.abs().max()))
    if (matrix := _matrix(operator)) is not None:
        system = matrix.mT @ matrix + rho * torch.eye(matrix.shape[1]).to(matrix)
        dense = torch.linalg.solve(system, matrix.mT @ snapshot.flatten().double() + rho * point.flatten().double())
        close(found.flatten().double(), dense, "prox_l2", **limits)


def gram_solve_inverts_the_gram_matrix(operator: LinearOperator) -> None:
    """(A Aᵀ + s I) times ``gram_solve(y, s)`` is y."""
    snapshot, shift = _random(operator, 2, *operator.snapshot_shape), 0.3
    found = operator.gram_solve(snapshot, shift)
    back = operator.A(operator.A_adjoint(found)) + shift * found
    close(back, snapshot, "(A Aᵀ + 0.3 I) gram_solve(y, 0.3), and y,", rtol=0, atol=_tolerance(operator)["rtol"])


def the_pseudo_inverse_is_the_least_norm_scene(operator: LinearOperator) -> None:
    """``A_dagger`` explains an exact snapshot, by a scene whose norm is the least."""
    exact = operator.A(_random(operator, 1, *operator.scene_shape))
    estimate = operator.A_dagger(exact)
    limit = 1e-4 if exact.dtype == torch.float64 else 1e-2
    close(operator.A(estimate), exact, "A of A_dagger", rtol=limit, atol=limit)
    if (matrix := _matrix(operator)) is not None:
        least = float((torch.linalg.pinv(matrix, rcond=1e-10) @ exact.flatten().double()).norm())
        norm = float(estimate.norm())
        say(norm <= least * (1 + 10 * limit), f"A_dagger has the norm {norm:.6g}, the least one is {least:.6g}")


def nothing_comes_of_nothing(operator: LinearOperator) -> None:
    """Darkness is imaged as darkness, and explained by it."""
    dark = 0 * _random(operator, 1, *operator.snapshot_shape)
    say(not operator.A_dagger(dark).any(), "A_dagger of darkness is not zero")
    say(not operator.A(0 * _random(operator, 1, *operator.scene_shape)).any(), "A of darkness is not zero")


CHECKS = (
    shapes_and_batches_are_as_stated,
    inner_products_are_the_same_on_both_sides,
    the_adjoint_is_the_transpose_of_the_explicit_matrix,
    the_proximal_step_minimises_its_objective,
    gram_solve_inverts_the_gram_matrix,
    the_pseudo_inverse_is_the_least_norm_scene,
    nothing_comes_of_nothing,
)


def _random(operator: LinearOperator, *shape: int) -> Tensor:
    """Numbers between 0 and 1 in the precision, and on the device, of an operator."""
    held = [*operator.parameters(), *operator.buffers(), *(t for t in vars(operator).values() if isinstance(t, Tensor))]
    real = next((tensor for tensor in held if tensor.is_floating_point()), torch.zeros(0))
    device = next((tensor.device for tensor in held), real.device)
    return drawn(*shape, dtype=real.dtype, device=device)


def _tolerance(operator: LinearOperator) -> dict[str, float]:
    double = _random(operator, 1).dtype == torch.float64
    return {"rtol": 1e-5, "atol": 1e-6} if double else {"rtol": 2e-3, "atol": 2e-4}


def _matrix(operator: LinearOperator) -> Tensor | None:
    """(pixels, entries of the scene) of a small operator, in double precision; None of a larger one."""
    entries = prod(operator.scene_shape)
    if entries > _DENSE:
        return None
    units = torch.eye(entries).to(_random(operator, 1)).reshape(entries, *operator.scene_shape)
    with torch.no_grad():
        return operator.A(units).flatten(1).mT.double()
