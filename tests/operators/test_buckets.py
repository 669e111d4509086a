"""Sensors with several buckets a pixel: what each of them sees, and how both together are solved."""

import pytest
import torch

from tmca.cameras import LightFieldCamera, SpectralCamera, SpectralDepthCamera
from tmca.errors import SettingError, ShapeError
from tmca.operators import Taps, of_buckets, single_disperser, sparse_matrix
from tmca.operators.bucket_gram import pseudo_inverse, solve_tied_blocks
from tmca.optics import Dispersion, PhaseMaskBench
from tmca.sensor import Sensor

BENCH = PhaseMaskBench(window=(5, 7), mask_pixels=12, diameter=1e-3)
CAMERAS = {
    "whole": lambda **more: SpectralCamera(3, (5, 6), slots=4, **more),
    "fractional": lambda **more: SpectralCamera(3, (5, 7), slots=3, dispersion=[0, 1.5, -2.25], **more),
    "dual disperser": lambda **more: SpectralCamera(2, (4, 6), slots=3, disperser="dual", **more),
    "relay blur": lambda **more: SpectralCamera(2, (6, 7), slots=2, relay_blur=0.7, **more),
    "narrow sensor": lambda **more: SpectralCamera(3, (5, 7), slots=4, beside=(1, 0), **more),
    "pixel shutter alone": lambda **more: SpectralCamera(1, (5, 6), slots=4, **{"aperture": "open", **more}),
    "light field": lambda **more: LightFieldCamera(3, (6, 7), slots=3, **more),
    "sheared light field": lambda **more: LightFieldCamera(3, (5, 6), slots=4, shear=0.4, **more),
    "spectral-depth": lambda **more: SpectralDepthCamera(
        3, (9, 12), slots=4, planes=3, bench=BENCH, channels="rgb", filters="gaussian", **more
    ),
}
every_camera = pytest.mark.parametrize("name", CAMERAS)


def rand(*shape, seed=0):
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def taken(camera, scene):
    depth = torch.full((len(scene), 1, *camera.size), 0.8, dtype=torch.float64)
    return camera.exact(scene, depth) if camera.kind == "spectral-depth" else camera.exact(scene)


@every_camera
@pytest.mark.parametrize(("shutter", "buckets"), [("random", 2), ("balanced", 2), ("burst", 2), ("burst", 3)])
def test_the_sum_of_the_buckets_is_the_camera_with_an_open_shutter(name, shutter, buckets):
    make = CAMERAS[name]
    if buckets > make().slots:
        pytest.skip("fewer slots than buckets")
    camera, opened = make(shutter=shutter, buckets=buckets).double(), make(shutter="open").double()
    scene = rand(2, *camera.scene_shape)
    each = taken(camera, scene).unflatten(1, (buckets, -1))
    torch.testing.assert_close(each.sum(1), taken(opened, scene), atol=1e-12, rtol=1e-12)
    assert camera.throughput() == pytest.approx(opened.throughput())


@every_camera
def test_the_first_of_two_buckets_is_the_camera_with_one(name):
    camera = CAMERAS[name](buckets=2).double()
    scene = rand(2, *camera.scene_shape)
    both, alone = taken(camera, scene), taken(camera.replace(buckets=1), scene)
    assert torch.equal(both[:, : len(alone[0])], alone)


@pytest.mark.parametrize("name", [name for name in CAMERAS if name not in ("spectral-depth", "relay blur")])
@pytest.mark.parametrize(("aperture", "shutter"), [("random", "balanced"), ("static", "random"), ("random", "open")])
def test_inverse_and_proximal_step_are_those_of_the_explicit_matrix(name, aperture, shutter):
    """Blocks are singular where the aperture is static, and where a bucket stays dark."""
    camera = CAMERAS[name](aperture=aperture, shutter=shutter, buckets=2).double()
    operator, scene = camera.operator(), rand(2, *camera.scene_shape).flatten(1, -3)
    matrix = torch.from_numpy(sparse_matrix(operator).toarray())
    image = operator.A(scene)
    torch.testing.assert_close(image.flatten(1), scene.flatten(1) @ matrix.T)
    least = image.flatten(1) @ torch.linalg.pinv(matrix, rtol=1e-9).T
    torch.testing.assert_close(operator.A_dagger(image).flatten(1), least, atol=2e-6, rtol=1e-6)
    wanted = rand(*image.shape, seed=1)
    normal = matrix.T @ matrix + 0.3 * torch.eye(matrix.shape[1], dtype=torch.float64)
    solution = torch.linalg.solve(normal, (wanted.flatten(1) @ matrix + 0.3 * scene.flatten(1)).T).T
    torch.testing.assert_close(operator.prox_l2(scene, wanted, 0.3).flatten(1), solution, atol=1e-9, rtol=1e-9)


@pytest.mark.parametrize("dispersion", [1.0, 0.6])
def test_a_shift_may_differ_from_pixel_to_pixel_and_from_bucket_to_bucket(dispersion):
    camera = SpectralCamera(3, (4, 5), slots=3, dispersion=dispersion, buckets=2).double()
    operator = camera.operator()
    matrix = torch.from_numpy(sparse_matrix(operator).toarray())
    shift, right = rand(1, *camera.snapshot_shape) + 0.1, rand(1, *camera.snapshot_shape, seed=1)
    dense = torch.linalg.solve(matrix @ matrix.T + torch.diag(shift.flatten()), right.flatten())
    torch.testing.assert_close(operator.gram_solve(right, shift).flatten(), dense)


@pytest.mark.parametrize("buckets", [2, 3])
def test_pseudo_inverses_of_small_blocks_are_those_of_the_library(buckets):
    factors = rand(6, buckets, buckets)
    factors[1:3, 0] = 0  # of one row alone, or of no rank
    factors[2] = 0
    factors[3] = factors[3, :1]
    blocks = factors @ factors.mT
    expected = torch.linalg.pinv(blocks, hermitian=True, rtol=1e-10)
    torch.testing.assert_close(pseudo_inverse(blocks), expected, atol=1e-8, rtol=1e-8)


def test_tied_blocks_are_solved_like_the_whole_matrix():
    n, buckets = 5, 3
    blocks, ties = rand(1, n, buckets, buckets), 0.1 * rand(1, n - 1, buckets, buckets, seed=1)
    blocks = blocks @ blocks.mT + torch.eye(buckets, dtype=torch.float64)
    whole = torch.block_diag(*blocks[0])
    for i, tie in enumerate(ties[0]):
        here, there = slice(i * buckets, (i + 1) * buckets), slice((i + 1) * buckets, (i + 2) * buckets)
        whole[here, there], whole[there, here] = tie, tie.T
    right = rand(1, n, buckets, seed=2)
    dense = torch.linalg.solve(whole, right.flatten())
    torch.testing.assert_close(solve_tied_blocks(blocks, ties, right).flatten(), dense)


def test_noise_is_drawn_and_clipped_in_every_bucket_on_its_own():
    camera = SpectralCamera(3, (40, 50), slots=4, buckets=2, sensor=Sensor(read_noise=0.1))
    error = camera(torch.zeros(1, *camera.scene_shape), generator=0)[0]
    assert error.std((1, 2)).tolist() == pytest.approx([0.1, 0.1], rel=0.1)
    assert abs(float((error[0] * error[1]).mean())) < 0.001
    full = camera.replace(sensor=Sensor(full_well=1000), aperture="open", shutter="open")
    white = full(2 * torch.ones(1, *camera.scene_shape), generator=0)[0]
    assert float(white[0].max()) == pytest.approx(camera.full_scale)
    assert float(white[1].abs().max()) == 0


@pytest.mark.parametrize(("settings", "where"), [
    ({"buckets": 3}, "buckets"),
    ({"buckets": 9, "shutter": "burst"}, "slots"),
    ({"buckets": 2, "shutter": torch.ones(2, 4, 5, 8)}, "shutter"),  # a slot in two buckets
    ({"buckets": 2, "shutter": torch.zeros(3, 4, 5, 8)}, "shutter"),
    ({"buckets": 0}, "buckets"),
])  # fmt: skip
def test_buckets_that_cannot_be_are_refused(settings, where):
    with pytest.raises(SettingError) as refusal:
        SpectralCamera(4, (5, 5), slots=4, **settings)
    assert refusal.value.where == where


def test_a_drain_takes_what_no_bucket_has():
    patterns = torch.zeros(2, 2, 4, 7)
    patterns[0, 0], patterns[1, 1, 0] = 1, 1
    camera = SpectralCamera(4, (4, 4), slots=2, buckets=2, shutter=patterns, aperture="open")
    light = camera.exact(torch.ones(1, *camera.scene_shape))[0]
    assert bool((light[0] > 0).all())
    assert bool((light[1, 0] > 0).all())
    assert float(light[1, 1:].abs().max()) == 0


def test_codes_of_several_buckets_do_not_serve_one():
    camera = SpectralCamera(4, (4, 4), slots=2, buckets=2, shutter="burst")
    with pytest.raises(SettingError):
        camera.replace(buckets=1)


def test_taps_of_buckets_must_be_alike():
    with pytest.raises(ShapeError):
        Taps(torch.ones(2, 3, 4), (0, 1), (0, 0), 2, 4, buckets=2)


@pytest.mark.parametrize("steps", [[0, 1, 2], [0.5, 0, -1.2]])
def test_derivatives_in_scene_and_both_planes_are_those_of_differences(steps):
    dispersion = Dispersion(tuple(map(float, steps)))

    def seen(scene, aperture, shutter):
        build = (single_disperser(aperture, shown, dispersion) for shown in (shutter, 1 - shutter))
        return of_buckets(list(build)).A(scene)

    given = rand(2, 3, 3, 4), rand(2, 3, 4, seed=1), rand(2, 3, 4 + dispersion.extent, seed=2)
    assert torch.autograd.gradcheck(seen, tuple(part.requires_grad_() for part in given))
