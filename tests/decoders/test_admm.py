import cvxpy
import numpy as np
import pytest
import torch
from small_cameras import BlurredCamera, blocky_scene, coded_camera, matrix

from tests.small_scenes import noisy
from tmca.cameras import Snapshot, SpectralCamera
from tmca.decoders import admm, admm_tv, decode, default_weight
from tmca.decoders.least_squares import DataStep
from tmca.operators.linear import Diverged
from tmca.sensor import Sensor

SHAPE = (3, 6, 7)


def differences(size: int) -> np.ndarray:
    """Forward differences with a zero last row, as a matrix."""
    rows = np.eye(size, k=1) - np.eye(size)
    rows[-1] = 0
    return rows


def reference(
    system: np.ndarray, y: np.ndarray, weight: float, joint: bool, bounds: tuple[float, float] | None
) -> tuple[float, np.ndarray]:
    """Smallest objective and its scene, by a generic convex solver."""
    bands, height, width = SHAPE
    scene = cvxpy.Variable(bands * height * width)
    down, right = np.kron(differences(height), np.eye(width)), np.kron(np.eye(height), differences(width))
    parts = [scene[band * height * width : (band + 1) * height * width] for band in range(bands)]
    stacks = [cvxpy.vstack([down @ part, right @ part]) for part in parts]
    stacks = [cvxpy.vstack(stacks)] if joint else stacks
    variation = sum(cvxpy.sum(cvxpy.norm(stack, 2, axis=0)) for stack in stacks)
    limits = [] if bounds is None else [scene >= bounds[0], scene <= bounds[1]]
    problem = cvxpy.Problem(cvxpy.Minimize(0.5 * cvxpy.sum_squares(system @ scene - y) + weight * variation), limits)
    problem.solve(solver=cvxpy.CLARABEL)
    return float(problem.value), scene.value


@pytest.mark.parametrize("bounds", [None, (0.3, 0.6)], ids=["free", "bounded"])
@pytest.mark.parametrize("joint", [False, True], ids=["band-wise", "joint"])
@pytest.mark.parametrize("weight", [0.003, 0.1])
def test_admm_reaches_the_solution_of_a_generic_convex_solver(
    weight: float, joint: bool, bounds: tuple[float, float] | None
) -> None:
    camera = coded_camera(SHAPE)
    snapshot = noisy(camera.A(blocky_scene((1, *SHAPE))), 0.02)
    best, _ = reference(matrix(camera).numpy(), snapshot.flatten().numpy(), weight, joint, bounds)
    result = admm_tv(camera, snapshot, weight, joint=joint, bounds=bounds, max_iterations=5000, tolerance=1e-6)
    assert result.converged
    assert result.objective[-1] == pytest.approx(best, rel=1e-4)
    if bounds is not None:
        assert bounds[0] <= result.estimate.min()
        assert result.estimate.max() <= bounds[1]


def test_a_camera_without_gram_solve_reaches_the_same_solution_by_conjugate_gradients() -> None:
    camera = BlurredCamera(coded_camera(SHAPE))
    snapshot = noisy(camera.A(blocky_scene((1, *SHAPE))), 0.02)
    best, _ = reference(matrix(camera).numpy(), snapshot.flatten().numpy(), 0.05, True, (0, 1))
    result = admm_tv(camera, snapshot, 0.05, joint=True, bounds=(0, 1), max_iterations=1000, tolerance=1e-5)
    assert result.objective[-1] == pytest.approx(best, rel=1e-4)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("shape", [(3, 4, 5), (2, 5, 6)])
@pytest.mark.parametrize("blurred", [False, True])
def test_data_step_equals_the_dense_solve(shape: tuple[int, int, int], blurred: bool, dtype: torch.dtype) -> None:
    camera = coded_camera(shape, dtype)
    camera = BlurredCamera(camera) if blurred else camera
    point, rho = blocky_scene((2, *shape), dtype, seed=4), 0.3
    snapshot = noisy(camera.A(blocky_scene((2, *shape), dtype)), 0.1)
    system = matrix(camera, dtype)
    right = snapshot.flatten(1) @ system + rho * point.flatten(1)
    dense = torch.linalg.solve(system.mT @ system + rho * torch.eye(system.shape[1], dtype=dtype), right.mT).mT
    step = DataStep(camera, snapshot, tolerance=1e-7)(point, rho)
    assert step.dtype == dtype
    assert torch.allclose(step.flatten(1), dense, atol=2e-5 if dtype == torch.float32 else 3e-6)


def test_conjugate_gradients_solve_every_snapshot_of_a_batch() -> None:
    camera = BlurredCamera(coded_camera(SHAPE))
    snapshots = camera.A(blocky_scene((3, *SHAPE))) * torch.tensor([0.0, 1.0, 100.0]).reshape(3, 1, 1, 1)
    system = matrix(camera)
    gram = system @ system.mT + 0.01 * torch.eye(len(system), dtype=torch.float64)
    solution = camera.gram_solve(snapshots, 0.01, tolerance=1e-10)
    assert torch.allclose(solution.flatten(1), torch.linalg.solve(gram, snapshots.flatten(1).mT).mT, atol=1e-6)


@pytest.mark.parametrize("bounds", [None, (0.0, 1.0)])
def test_without_weight_a_consistent_snapshot_is_reproduced(bounds: tuple[float, float] | None) -> None:
    camera = coded_camera((3, 9, 8))
    snapshot = camera.A(blocky_scene((1, 3, 9, 8)))
    result = admm_tv(camera, snapshot, 0.0, bounds=bounds, max_iterations=3000, tolerance=1e-7)
    assert result.converged
    assert torch.allclose(camera.A(result.estimate), snapshot, atol=1e-5)


def test_a_batch_gives_what_its_snapshots_give_alone() -> None:
    camera = coded_camera((2, 6, 7))
    snapshots = camera.A(torch.cat([blocky_scene((1, 2, 6, 7)), 0.3 * blocky_scene((1, 2, 6, 7), seed=7)]))
    together = admm_tv(camera, snapshots, 0.01, joint=True, max_iterations=1500, tolerance=1e-6)
    alone = [admm_tv(camera, one[None], 0.01, joint=True, max_iterations=1500, tolerance=1e-6) for one in snapshots]
    assert torch.allclose(together.estimate, torch.cat([one.estimate for one in alone]), atol=1e-4)
    assert together.objective[-1] == pytest.approx(sum(one.objective[-1] for one in alone), rel=1e-6)


@pytest.mark.parametrize(
    "decoder", ["admm-tv", *(pytest.param(one, marks=pytest.mark.slow) for one in ("admm-tv-joint", "pnp-tv"))]
)
@pytest.mark.parametrize("size", [(10, 13), pytest.param((21, 24), marks=pytest.mark.slow)])
def test_behind_a_blurred_relay_noise_does_not_outgrow_the_scene(size: tuple[int, int], decoder: str) -> None:
    """Where the relay's blur leaves next to no light, the pseudo-inverse says anything."""
    sensor = Sensor(read_noise=0.01)
    camera = SpectralCamera(4, size, slots=2, shutter="random", exposure="per-slot", relay_blur=0.6, sensor=sensor)
    scene = blocky_scene((1, 4, *size), torch.float32)
    taken = Snapshot(camera(scene, generator=0), camera)
    with pytest.warns(Diverged):
        camera.A_dagger(taken.values)
    estimate = decode(taken, decoder)
    assert estimate.values.max() < 2
    assert (estimate.values - scene).square().mean() < 0.02
    assert estimate.notes["converged"] or decoder == "pnp-tv"


@pytest.mark.parametrize("rho", [1e-4, 1e3])
@pytest.mark.parametrize(("joint", "bounds"), [(False, None), (True, (0.0, 0.5))])
def test_a_poor_penalty_is_balanced(rho: float, joint: bool, bounds: tuple[float, float] | None) -> None:
    camera = coded_camera(SHAPE)
    snapshot = noisy(camera.A(blocky_scene((1, *SHAPE))), 0.02)
    best = admm_tv(camera, snapshot, 0.02, joint=joint, bounds=bounds, max_iterations=5000, tolerance=1e-8)
    poor = admm_tv(camera, snapshot, 0.02, joint=joint, bounds=bounds, rho=rho, max_iterations=1000, tolerance=1e-6)
    assert poor.objective[-1] == pytest.approx(best.objective[-1], rel=1e-4)


@pytest.mark.parametrize("size", [(5, 8), (8, 5), (1, 7), (6, 6)])
@pytest.mark.parametrize("shift", [1.1, 0.2])
def test_a_step_towards_the_smoothed_cube_leaves_a_share_of_every_part_of_the_error(
    size: tuple[int, int], shift: float
) -> None:
    down, across = (differences(length) for length in size)
    normal = np.kron(down.T @ down, np.eye(size[1])) + np.kron(np.eye(size[0]), across.T @ across)
    parts = np.linalg.eigh(normal)[1]
    solution, start = (
        torch.from_numpy(blocky).double() for blocky in np.random.default_rng(0).random((2, 1, 1, *size))
    )
    right = torch.from_numpy((normal + shift * np.eye(len(normal))) @ solution.flatten().numpy()).view_as(solution)
    near = start.clone()
    admm.approach(near, right.clone(), shift)
    before, after = (parts.T @ (cube - solution).flatten().numpy() for cube in (start, near))
    left = after / before
    assert (left > -1e-9).all()
    assert (left < 1).all()
    for _ in range(200):
        admm.approach(near, right.clone(), shift)
    torch.testing.assert_close(near, solution, atol=1e-9, rtol=0)


def test_channels_by_parts_are_decoded_as_all_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    camera = coded_camera(SHAPE)
    snapshot = noisy(camera.A(blocky_scene((2, *SHAPE))), 0.02)
    whole = [admm_tv(camera, snapshot, 0.01, joint=joint, bounds=(0, 1)) for joint in (False, True)]
    monkeypatch.setattr(admm, "_PART", 1)
    parts = [admm_tv(camera, snapshot, 0.01, joint=joint, bounds=(0, 1)) for joint in (False, True)]
    for one, other in zip(whole, parts, strict=True):
        torch.testing.assert_close(one.estimate, other.estimate)
        assert one.objective == pytest.approx(other.objective)


def test_weight_for_noise_grows_with_its_variance() -> None:
    assert default_weight() > 0
    low, high = default_weight(0.1) - default_weight(), default_weight(0.2) - default_weight()
    assert high == pytest.approx(4 * low)
