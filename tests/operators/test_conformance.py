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
)
from tmca.operators.spectral_depth import framed, transfer_functions
from tmca.optics import Dispersion, ViewShear
from tmca.testing import check_operator
from tmca.testing.operators import CHECKS, inner_products_are_the_same_on_both_sides

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


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
@each_operator
def test_every_operator_conforms(make, size, check):
    check(make(size))


@pytest.mark.parametrize("precision", [torch.float32], indirect=True)
@each_operator
def test_inner_products_are_the_same_in_single_precision(make, size, precision):
    inner_products_are_the_same_on_both_sides(make(size))


class Tilted(LinearOperator):
    """Weights of every pixel; what is wrong with it is said by its parts."""

    def __init__(self, back=1.0, gram=1.0, dtype=torch.float64, forget=False):
        super().__init__()
        self.weights, self.back, self.gram, self.forget = rand(2, 3, 5).to(dtype), back, gram, forget
        self.scene_shape, self.snapshot_shape = (2, 3, 5), (1, 3, 5)

    def A(self, scene):
        image = (self.weights * scene).sum(1, keepdim=True)
        return image[:1] if self.forget else image

    def A_adjoint(self, snapshot):
        return self.back * self.weights * snapshot

    def gram_solve(self, snapshot, shift, **iteration):
        return self.gram * snapshot / (self.weights.square().sum(0) + shift)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_an_operator_of_plain_tensors_is_checked_against_a_slow_loop(dtype):
    operator = Tilted(dtype=dtype)

    def loop(scene):
        image = torch.zeros(1, 3, 5)
        for band in range(2):
            for y in range(3):
                for x in range(5):
                    image[0, y, x] += operator.weights[band, y, x] * scene[band, y, x]
        return image

    check_operator(operator, loop=loop)
    with pytest.raises(AssertionError, match=r"Tilted: A is its slow loop: A differs by"):
        check_operator(operator, loop=lambda scene: 1.01 * loop(scene))


@pytest.mark.parametrize(("wrong", "said"), [
    ({"back": 1.01}, "Tilted: inner products are the same on both sides: ⟨A x, y⟩ is"),
    ({"gram": 1.01}, "Tilted: the proximal step minimises its objective: .*differs by"),
    ({"forget": True}, r"Tilted: shapes and batches are as stated: A of a batch of two of shape \(1, 1, 3, 5\)"),
])  # fmt: skip
def test_what_is_wrong_with_an_operator_is_one_line(wrong, said):
    with pytest.raises(AssertionError, match=said) as failed:
        check_operator(Tilted(**wrong))
    assert "\n" not in str(failed.value)
