"""What every linear operator promises: one suite over all of them, at even and odd sizes."""

from functools import partial

import pytest
import torch

from tmca.operators import (
    Buckets,
    LayeredOperator,
    LinearOperator,
    SensorColumns,
    SlotwiseDisperser,
    coded_mask,
    coloured_code,
    dual_disperser,
    of_buckets,
    single_disperser,
    sparse_matrix,
)
from tmca.operators.spectral_depth import framed, transfer_functions
from tmca.optics import Dispersion, ViewShear

SIZES = [(5, 8), (6, 7), (1, 9), (4, 1)]
SHEAR = ViewShear((3, 3))
WHOLE, FRACTIONAL = Dispersion.linear(3), Dispersion((0.4, -1.0, 1.7))


@pytest.fixture(autouse=True)
def precision(request):
    dtype = getattr(request, "param", torch.float64)
    torch.set_default_dtype(dtype)
    yield dtype
    torch.set_default_dtype(torch.float32)


def rand(*shape):
    return torch.rand(*shape, generator=torch.Generator().manual_seed(sum(shape)))


def planes(size, dispersion, slots=3):
    return rand(slots, *size).round(), rand(slots, size[0], size[1] + dispersion.extent).round()


def slotwise(size, dispersion, **settings):
    return SlotwiseDisperser(*planes(size, dispersion), dispersion, rand(3), **settings)


def layered(size, exposure="equal"):
    psf = rand(2, 3, 2, 3, 3)
    weights = torch.nn.functional.one_hot((3 * rand(*size)).long(), 3).permute(2, 0, 1)[None].to(psf)
    frame = framed(size, (3, 3))
    return LayeredOperator(
        weights, transfer_functions(psf, frame), frame, rand(3, 2, *size), rand(1, 2, *size), exposure
    )


def of_two(size, build, dispersion=WHOLE):
    """Two buckets whose shutters are the negatives of each other."""
    aperture, shutter = planes(size, dispersion)
    return [build(aperture, shown, dispersion) for shown in (shutter, 1 - shutter)]


def layered_buckets(size):
    one = layered(size)
    shutters = torch.cat((one.shutters, 1 - one.shutters))
    return LayeredOperator(one.weights, one.transfer, one.frame, one.colour, shutters)


OPERATORS = {
    "single disperser": lambda size: single_disperser(*planes(size, WHOLE), WHOLE),
    "fractional": lambda size: single_disperser(*planes(size, FRACTIONAL), FRACTIONAL, rand(3)),
    "dual disperser": lambda size: dual_disperser(*planes(size, FRACTIONAL)[::-1], FRACTIONAL),
    "coloured code": lambda size: coloured_code(rand(3, *size), FRACTIONAL),
    "relay blur": lambda size: slotwise(size, WHOLE, blur=rand(3, 3, 5)),
    "moving scene": lambda size: slotwise(size, FRACTIONAL, moving=True),
    "blurred moving scene": lambda size: slotwise(size, FRACTIONAL, blur=rand(3, 3, 5), moving=True),
    "narrow sensor": lambda size: SensorColumns(single_disperser(*planes(size, WHOLE), WHOLE), (1, 0)),
    "coded mask": lambda size: coded_mask(rand(3, *SHEAR.mask_size(size)), rand(3, *size), SHEAR),
    "layered": layered,
    "two buckets": lambda size: of_buckets(of_two(size, single_disperser)),
    "two buckets, fractional": lambda size: of_buckets(of_two(size, single_disperser, FRACTIONAL)),
    "two buckets, relay blur": lambda size: Buckets(of_two(size, partial(SlotwiseDisperser, blur=rand(3, 3, 5)))),
    "two buckets, layered": layered_buckets,
    "layered, a time for each slot": lambda size: layered(size, "per-slot"),
}  # fmt: skip
each_operator = pytest.mark.parametrize("size", SIZES)


@pytest.fixture(params=OPERATORS)
def make(request):
    return OPERATORS[request.param]


def concrete(kind):
    """All kinds of operators below one."""
    return {kind, *(found for child in kind.__subclasses__() for found in concrete(child))}


def test_every_operator_of_the_room_is_here():
    here = {type(build(SIZES[0])) for build in OPERATORS.values()}
    room = {kind for kind in concrete(LinearOperator) if kind.__module__.startswith("tmca.operators")}
    assert room - {LinearOperator} == here


@each_operator
def test_shapes_and_batches(make, size):
    operator = make(size)
    scene = rand(2, *operator.scene_shape)
    image = operator.A(scene)
    assert tuple(image.shape) == (2, *operator.snapshot_shape)
    torch.testing.assert_close(image, torch.cat([operator.A(one) for one in scene.split(1)]))
    back = operator.A_adjoint(image)
    assert tuple(back.shape) == tuple(scene.shape)
    torch.testing.assert_close(operator(scene), image)


@pytest.mark.parametrize("precision", [torch.float32, torch.float64], indirect=True)
@each_operator
def test_inner_products_are_the_same_on_both_sides(make, size, precision):
    operator = make(size)
    scene, snapshot = rand(2, *operator.scene_shape) - 0.5, rand(2, *operator.snapshot_shape) - 0.5
    image, back = operator.A(scene), operator.A_adjoint(snapshot)
    assert image.dtype == back.dtype == precision
    error = abs((image * snapshot).sum() - (scene * back).sum())
    assert error <= 50 * torch.finfo(precision).eps * image.norm() * snapshot.norm()


@each_operator
def test_the_adjoint_is_the_transpose_of_the_explicit_matrix(make, size):
    operator = make(size)
    matrix = torch.from_numpy(sparse_matrix(operator).toarray())
    snapshot = rand(1, *operator.snapshot_shape)
    expected = (matrix.T @ snapshot.flatten()).reshape(1, *operator.scene_shape)
    torch.testing.assert_close(operator.A_adjoint(snapshot), expected, atol=1e-6, rtol=1e-5)


@each_operator
def test_the_proximal_step_is_the_dense_solution(make, size):
    operator, rho = make(size), 0.3
    matrix = torch.from_numpy(sparse_matrix(operator).toarray())
    point, snapshot = rand(1, *operator.scene_shape), rand(1, *operator.snapshot_shape)
    system = matrix.T @ matrix + rho * torch.eye(matrix.shape[1])
    dense = torch.linalg.solve(system, matrix.T @ snapshot.flatten() + rho * point.flatten())
    torch.testing.assert_close(operator.prox_l2(point, snapshot, rho).flatten(), dense, atol=1e-5, rtol=1e-5)


@each_operator
def test_the_pseudo_inverse_is_the_least_norm_scene(make, size):
    operator = make(size)
    matrix = torch.from_numpy(sparse_matrix(operator).toarray())
    exact = operator.A(rand(1, *operator.scene_shape))
    least = torch.linalg.pinv(matrix, rcond=1e-10) @ exact.flatten()
    estimate = operator.A_dagger(exact)
    torch.testing.assert_close(operator.A(estimate), exact, atol=1e-4, rtol=1e-4)
    assert float(estimate.norm()) <= float(least.norm()) * (1 + 1e-3)


@each_operator
def test_nothing_comes_of_nothing(make, size):
    operator = make(size)
    dark = torch.zeros(1, *operator.snapshot_shape)
    assert not operator.A_dagger(dark).any()
    assert not operator.A(torch.zeros(1, *operator.scene_shape)).any()
