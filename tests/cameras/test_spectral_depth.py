"""The spectral-depth camera against slow loops, its special cases, and what it refuses."""

import numpy as np
import pytest
import torch
from scipy.signal import convolve2d

from tmca.cameras import Snapshot, SpectralDepthCamera
from tmca.errors import DataError, ShapeError
from tmca.operators.spectral_depth import equivalent_psf
from tmca.optics import PhaseMaskBench

BENCH = PhaseMaskBench(window=(9, 11), mask_pixels=24, diameter=1e-3)


def camera(size=(13, 16), **changes):
    settings = {"bands": (450e-9, 550e-9, 650e-9), "slots": 3, "planes": 4, "bench": BENCH, "filters": "gaussian",
                "shutter": "random", "channels": "rgb", "period": 4}  # fmt: skip
    return SpectralDepthCamera(size=size, **{**settings, **changes})


def scene_of(made, batch=2, seed=0):
    source = torch.Generator().manual_seed(seed)
    cube = torch.rand(batch, *made.scene_shape, generator=source)
    near, far = made.planes.near, made.planes.far
    return cube, 1 / (1 / far + (1 / near - 1 / far) * torch.rand(batch, 1, *made.size, generator=source))


@pytest.mark.parametrize("size", [(13, 16), (12, 15)])
@pytest.mark.parametrize("exposure", ["equal", "per-slot"])
def test_a_snapshot_is_that_of_slow_loops(size, exposure):
    made = camera(size, exposure=exposure)
    cube, depth = scene_of(made)
    psf, colour, shutter = (part.double().numpy() for part in (made.psf(), made.colour(), made.shutter()))
    nearest = np.abs(1 / depth.double().numpy() - made.planes.inverse.numpy()[:, None, None]).argmin(1)
    expected = np.zeros((2, *made.snapshot_shape))
    for b in range(2):
        for k in range(3):
            for band in range(3):
                seen = sum(
                    convolve2d(cube[b, band].double().numpy() * (nearest[b] == d), psf[k, d, band])[
                        4 : 4 + size[0], 5 : 5 + size[1]
                    ]
                    for d in range(4)
                )
                expected[b] += shutter[k] * colour[:, band] * seen
    expected /= 3 if exposure == "equal" else 1
    torch.testing.assert_close(made(cube, depth).double(), torch.from_numpy(expected), atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("image_formation", ["linear", "occlusion"])
def test_a_scene_that_rests_in_every_slot_is_one_that_does_not_move(image_formation):
    made = camera(image_formation=image_formation)
    cube, depth = scene_of(made)
    rest = cube[:, None].expand(-1, 3, -1, -1, -1)
    torch.testing.assert_close(made(rest, depth), made(cube, depth))
    together = made(rest, depth[:, None].expand(-1, 3, -1, -1, -1))
    torch.testing.assert_close(together, made(cube, depth), atol=1e-5, rtol=1e-5)


def test_every_slot_sees_its_own_scene_at_its_own_depth():
    made = camera()
    cube, depth = scene_of(made, 3, seed=4)
    alone = [made(cube[k : k + 1], depth[k : k + 1]) for k in range(3)]
    parts = torch.stack([_only(made, k, cube[k : k + 1], depth[k : k + 1]) for k in range(3)]).sum(0)
    torch.testing.assert_close(made(cube[None], depth[None]), parts, atol=1e-5, rtol=1e-5)
    assert all((parts - one).abs().max() > 1e-3 for one in alone)


def _only(made, slot, cube, depth):
    """What one slot adds: the camera with every other slot shut."""
    shutter = made.shutter().clone()
    shutter[[k for k in range(made.slots) if k != slot]] = 0
    return camera(shutter=shutter)(cube, depth)


@pytest.fixture
def in_tiles(monkeypatch):
    """Sensors are imaged in tiles of a size, or whole again."""

    def begin(tile):
        monkeypatch.setattr("tmca.cameras.sensor_tiles.TOGETHER", 0 if tile else 2**29)
        monkeypatch.setattr("tmca.cameras.sensor_tiles.TILE", tile or (256, 256))

    return begin


@pytest.mark.parametrize("size", [(26, 37), (13, 16)])
@pytest.mark.parametrize("image_formation", ["linear", "occlusion"])
@pytest.mark.parametrize("moving", [False, True])
def test_a_sensor_in_tiles_sees_what_it_sees_at_once(size, image_formation, moving, in_tiles):
    made = camera(size, image_formation=image_formation, shutter="random" if moving else torch.rand(3, *size).round())
    made = made.double()
    cube, depth = (part.double() for part in scene_of(made, 3))
    if moving:
        cube, depth = cube[None], depth[None]
    whole = made.exact(cube, depth)
    for tile in ((26, 37), (9, 11), (7, 5), (3, 64)):
        in_tiles(tile)
        told = []
        torch.testing.assert_close(made.exact(cube, depth, told.append), whole, atol=1e-6, rtol=1e-6)
        assert told == sorted(told)


def test_gradients_do_not_see_the_tiles(in_tiles):
    made = camera(learnable=True)
    cube, depth = scene_of(made)
    found = []
    for tile in (None, (5, 7)):
        in_tiles(tile)
        made.zero_grad()
        made.exact(cube, depth).square().sum().backward()
        found.append([p.grad.clone() for p in made.parameters()])
    for whole, tiled in zip(*found, strict=True):
        torch.testing.assert_close(tiled, whole, rtol=1e-3, atol=1e-5 * float(whole.abs().max()))


def test_light_is_kept_inside_and_throughput_says_what_the_codes_pass():
    made = camera(size=(40, 44), shutter="one-hot", filters="clear", period=3, channels="monochrome")
    flat = torch.ones(1, *made.scene_shape)
    seen = made(flat, torch.ones(1, 1, *made.size))[0, 0, 12:-12, 12:-12]
    assert float(seen.mean()) == pytest.approx(3 * made.throughput(), rel=0.02)
    assert made.throughput() == pytest.approx(1 / 3, rel=1e-6)


def test_parts_of_codes_are_cut_from_the_whole():
    for shutter in ("random", (torch.rand(3, 13, 16) > 0.5).float()):
        made = camera(shutter=shutter, period=3)
        rows, columns = slice(2, 12), slice(5, 16)
        assert made.shutter.part(rows, columns).equal(made.shutter()[:, rows, columns])
        torch.testing.assert_close(made.filters.part(rows, columns), made.filters()[:, rows, columns])
        passed = torch.einsum("lhw,cl->chw", made.filters(), made.response) / made.response.sum(1)[:, None, None]
        share = float((made.shutter().mean(0) * passed).mean())
        assert made.throughput() == pytest.approx(share, rel=1e-5)
        seen = made.equivalent_psf((1, 14), 2)
        whole = equivalent_psf(made.psf(), made.colour(), made.shutter(), (1, 14), 2)
        torch.testing.assert_close(seen, whole)
    with pytest.raises(ShapeError, match="pixel"):
        made.equivalent_psf((13, 0), 0)


def test_a_wall_in_a_uniform_light_looks_alike_at_every_depth():
    made = camera(size=(40, 44))
    flat = torch.ones(1, *made.scene_shape)
    views = torch.cat([made(flat, torch.full((1, 1, 40, 44), float(z))) for z in made.planes.metres])
    inside = views[..., 10:-10, 12:-12]
    torch.testing.assert_close(inside, inside[:1].expand_as(inside), atol=1e-5, rtol=1e-5)


def test_what_is_learned_gets_gradients_and_stays_feasible():
    made = camera(learnable=True)
    cube, depth = scene_of(made)
    made(cube, depth).square().sum().backward()
    names = {name.split(".")[0]: p.grad for name, p in made.named_parameters()}
    assert set(names) == {"point_spread", "shutter", "filters"}
    assert all(float(grad.abs().max()) > 0 for grad in names.values())
    assert set(made.shutter().unique().tolist()) <= {0.0, 1.0}
    assert set(made.filters.plane().sum(0).unique().tolist()) == {1.0}
    assert not camera(learnable="mask").shutter.learnable


@pytest.mark.parametrize("missing", ["heights", "cells", "bench", "depth"])
def test_a_snapshot_file_without_a_part_is_refused(tmp_path, missing):
    made = camera()
    dataset = Snapshot(made(*scene_of(made, 1)), made).to_xarray()
    if missing in dataset:
        dataset = dataset.drop_vars(missing)
    else:
        del dataset.attrs[missing]
    dataset.to_netcdf(tmp_path / "other.nc", engine="h5netcdf")
    with pytest.raises(DataError, match=missing):
        Snapshot.load(tmp_path / "other.nc")


def test_one_hot_slots_have_a_pixel_each():
    assert bool((camera(shutter="one-hot", slots=4, period=2).shutter().sum((1, 2)) > 0).all())


def test_the_snapshot_is_the_sum_of_equivalent_psfs():
    made = camera()
    cube, depth = scene_of(made, 1)
    planes = made.planes.nearest(depth)[0, 0]
    frame = torch.zeros(3, 13 + 8, 16 + 10)
    for i in range(13):
        for j in range(16):
            spread = made.equivalent_psf((i, j), int(planes[i, j]))
            frame[:, i : i + 9, j : j + 11] += (spread * cube[0, :, i, j, None, None]).sum(1)
    torch.testing.assert_close(made(cube, depth)[0], frame[:, 4:-4, 5:-5], atol=1e-5, rtol=1e-5)
