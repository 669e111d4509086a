"""A prior of any bands."""

import warnings

import pytest
import torch
import xarray as xr
from torch import Tensor

from tests.cli.refusals import refused
from tmca import Sensor, Snapshot, reconstruct
from tmca.cameras import LightFieldCamera, SpectralCamera
from tmca.cli import main
from tmca.data import write_dataset
from tmca.errors import SettingError, ShapeError
from tmca.priors import (
    BandsBeyond,
    GaussianPrior,
    NarrowBlocks,
    SubspacePrior,
    beyond,
    find_prior,
    interpolation,
    learn_prior,
)
from tmca.priors.statistics import FLOOR

KNOTS = tuple(1e-9 * v for v in (400.0, 450.0, 520.0, 600.0, 700.0))


def cubes(seed: int = 0) -> list[Tensor]:
    noise = torch.rand(2, len(KNOTS), 17, 24, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    return list(noise.cumsum(1).cumsum(3) / 60)


def test_values_between_knots_lie_on_a_line():
    lengths = [400e-9, 430e-9, 560e-9, 700e-9]
    weights = interpolation(lengths, torch.tensor(KNOTS))
    assert torch.allclose(weights @ torch.tensor(KNOTS, dtype=torch.float64), torch.tensor(lengths).double())
    assert torch.allclose(weights.sum(1), torch.ones(4).double())
    assert ((weights > 0).sum(1) <= 2).all()


@pytest.mark.parametrize("lengths", [[368e-9, 500e-9], [500e-9, 732e-9]])
def test_wavelengths_far_beyond_what_was_learned_are_refused(lengths):
    prior = SubspacePrior.learn(cubes(), (3, 7), rank=2, wavelengths=KNOTS)
    with pytest.raises(SettingError, match="400 to 700 nm, where it was learned, and up to 30 nm beyond") as refusal:
        prior.at(lengths)
    assert refusal.value.where == "wavelengths"
    assert "bands beyond lose" in str(refusal.value)


def test_a_narrow_prior_reaches_as_far_beyond_as_it_is_wide():
    narrow = SubspacePrior.learn([cube[:2] for cube in cubes()], (3, 7), rank=2, wavelengths=[400e-9, 410e-9])
    assert narrow.at([390e-9, 405e-9]).wavelengths == (390e-9, 405e-9)
    with pytest.raises(SettingError, match="400 to 410 nm, where it was learned, and up to 10 nm beyond"):
        narrow.at([385e-9, 405e-9])


def test_a_nanometre_beyond_counts_as_within():
    assert beyond([398e-9, 399.1e-9, 500e-9, 700.9e-9, 702e-9], KNOTS) == pytest.approx([-2e-9, 0, 0, 0, 2e-9])


def test_a_band_beyond_differs_from_the_outermost_as_the_one_as_far_inside_but_independently():
    prior = SubspacePrior.learn(cubes(), (4, 6), rank=3, wavelengths=KNOTS)
    lengths = [380e-9, 390e-9, 500e-9, 715e-9]
    ours = prior.at(lengths)
    known = prior.at([400e-9, 420e-9, 410e-9, 500e-9, 700e-9, 685e-9])  # ends, and places as far inside as beyond
    parts = torch.zeros(4, 6, 2).double()  # of known bands, and of increments: two independent scenes
    for row, (end, inside) in enumerate(((0, 1), (0, 2), (3, 3), (4, 5))):
        parts[row, end, 0] = 1
        parts[row, end, 1] += 1
        parts[row, inside, 1] -= 1
    moments = known.moments.clone()
    moments[:, :, 0, 0] -= FLOOR * torch.eye(6).double()
    wanted = torch.zeros_like(ours.moments)
    for one in range(4):
        for other in range(4):
            wanted[one, other] += torch.einsum("a,b,abyx->yx", parts[one, :, 0], parts[other, :, 0], moments)
            if (lengths[one] < 400e-9) == (lengths[other] < 400e-9):  # both sides are independent, too
                wanted[one, other] += torch.einsum("a,b,abyx->yx", parts[one, :, 1], parts[other, :, 1], moments)
    wanted[:, :, 0, 0] += FLOOR * torch.eye(4).double()
    torch.testing.assert_close(ours.moments, wanted)
    torch.testing.assert_close(ours.mean[[0, 1, 3]], known.mean[[0, 0, 4]])
    assert torch.linalg.eigvalsh(ours.covariance).min() > 0


def test_bands_beyond_are_decoded_with_a_warning_that_says_the_loss():
    prior = SubspacePrior.learn(cubes(), (3, 7), rank=2, wavelengths=KNOTS)
    inside, outside = (SpectralCamera([first, 500e-9, 700e-9], (12, 14), 2) for first in (400e-9, 385e-9))
    with warnings.catch_warnings():
        warnings.simplefilter("error", BandsBeyond)
        find_prior(inside, prior)
    with pytest.warns(
        BandsBeyond, match="385 to 700 nm reach beyond those of the prior, 400 to 700 nm: bands beyond lose"
    ):
        find_prior(outside, prior)
    far = SpectralCamera([360e-9, 500e-9, 700e-9], (12, 14), 2)
    with warnings.catch_warnings():
        warnings.simplefilter("error", BandsBeyond)
        with pytest.raises(SettingError, match="up to 30 nm beyond"):
            find_prior(far, prior)


@pytest.mark.parametrize("how", [{}, {"start": "admm-tv-joint"}, {"prior": "wide"}])
def test_the_network_of_any_bands_warns_of_bands_beyond_once(how):
    camera = SpectralCamera([385e-9, 500e-9, 650e-9], (12, 14), 1, shutter="open", sensor=Sensor(read_noise=0.01))
    snapshot = Snapshot(camera(torch.rand(1, 3, 12, 14), generator=0), camera)
    wide = SubspacePrior.learn(cubes(), (12, 24), rank=2, wavelengths=[370e-9, *KNOTS[1:]])
    given = {name: wide if value == "wide" else value for name, value in how.items()}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        estimate = reconstruct(snapshot, "network", weights="universal", **given)
    assert [one.category for one in caught].count(BandsBeyond) == 1
    assert estimate.values.isfinite().all()


def test_knots_ascend():
    with pytest.raises(SettingError, match="ascend"):
        interpolation([500e-9], torch.tensor([400e-9, 400e-9, 700e-9]))


@pytest.mark.parametrize("lengths", [[410e-9, 500e-9, 650e-9], [*KNOTS], [450e-9]])
def test_with_all_dimensions_it_is_what_interpolated_scenes_teach(lengths):
    prior = SubspacePrior.learn(cubes(), (4, 9), rank=5, wavelengths=KNOTS)
    weights = interpolation(lengths, torch.tensor(KNOTS))
    moved = [torch.einsum("lk,khw->lhw", weights, cube) for cube in cubes()]
    wanted = GaussianPrior.learn(moved, (4, 9), wavelengths=lengths)
    ours = prior.at(lengths)
    torch.testing.assert_close(ours.mean, wanted.mean)
    torch.testing.assert_close(ours.moments, wanted.moments)
    smaller = prior.at(lengths, (2, 5))
    assert smaller.block == (len(lengths), 2, 5)
    torch.testing.assert_close(smaller.moments, ours.moments[:, :, :2, :5], rtol=1e-12, atol=0)


def test_fewer_dimensions_leave_a_covariance_of_blocks():
    covariance = SubspacePrior.learn(cubes(), (3, 5), rank=2, wavelengths=KNOTS).at([420e-9, 480e-9, 690e-9]).covariance
    assert torch.linalg.eigvalsh(covariance).min() > 0


def test_a_camera_of_any_bands_finds_its_prior(tmp_path):
    file = SubspacePrior.learn(cubes(), (6, 24), rank=3, wavelengths=KNOTS, sources=["noise"]).save(tmp_path / "any.nc")
    for lengths, slots in (([450e-9, 500e-9], 2), ([400e-9, 550e-9, 700e-9], 1)):
        camera = SpectralCamera(lengths, (9, 30), slots)
        prior = find_prior(camera, file)
        assert isinstance(prior, GaussianPrior)
        assert prior.wavelengths == tuple(lengths)
        assert prior.block == (len(lengths), 6, 24)
        assert prior.sources == ("noise",)
    with pytest.raises(SettingError, match=r"a prior of any bands.*mixture"):
        find_prior(camera, file, "mixture")
    with pytest.raises(SettingError, match="a prior of any bands"):
        find_prior(LightFieldCamera(views=3, size=(16, 16), slots=1), file)


def test_it_is_not_learned_without_wavelengths():
    with pytest.raises(SettingError, match="wavelengths"):
        SubspacePrior.learn(cubes(), (3, 3))
    with pytest.raises(SettingError, match="rank"):
        SubspacePrior.learn(cubes(), (3, 3), rank=1.5, wavelengths=KNOTS)
    with pytest.raises(SettingError, match="ascend"):
        SubspacePrior.learn(cubes(), (3, 3), wavelengths=KNOTS[::-1])


@pytest.mark.parametrize(("mean", "lengths"), [((3,), (400e-9, 500e-9)), ((3, 2), (400e-9, 500e-9, 600e-9))])
def test_parts_that_do_not_belong_together_are_refused(mean, lengths):
    with pytest.raises(ShapeError, match="wavelengths"):
        SubspacePrior(torch.zeros(mean), torch.eye(3, 2), torch.zeros(2, 2, 1, 1), lengths)


def labelled(columns: int) -> xr.DataArray:
    values = torch.rand(len(KNOTS), 20, columns, generator=torch.Generator().manual_seed(1)).numpy()
    return xr.DataArray(values, dims=("wavelength", "y", "x"), coords={"wavelength": list(KNOTS)})


@pytest.mark.parametrize(
    ("extent", "columns", "wanted"), [(None, 130, 122), (None, 40, 40), (9, 130, 32), (0, 130, 24)]
)
def test_blocks_are_those_of_cameras_of_any_bands_unless_told(extent, columns, wanted):
    prior = learn_prior(labelled(columns), kind="subspace", extent=extent, rank=2)
    assert prior.block == (len(KNOTS), 12, wanted)


def test_the_command_line_learns_one_from_all_bands(capsys, tmp_path):
    for name in ("one", "other"):
        write_dataset(labelled(40).to_dataset(name="radiance"), tmp_path / f"{name}.nc")
    given = [str(tmp_path / f"{name}.nc") for name in ("one", "other")]
    main(["prior", "learn", *given, "--any-bands", "--spread", "5", "--out", str(tmp_path / "p.nc")])
    assert "prior of any bands, of blocks 5 × 12 × 24" in capsys.readouterr().out
    prior = SubspacePrior.load(tmp_path / "p.nc")
    assert prior.wavelengths == pytest.approx(KNOTS)
    assert len(prior.sources) == 2
    line = refused(capsys, "prior", "learn", *given, "--any-bands", "--mixture", "--out", tmp_path / "q.nc")
    assert "--any-bands and --mixture" in line


def test_a_wider_dispersion_than_it_was_learned_for_is_warned_of():
    prior = SubspacePrior.learn(cubes(), (3, 9), rank=2, wavelengths=KNOTS)
    camera = SpectralCamera([450e-9, 500e-9], (9, 30), 1, dispersion=4.0)
    with pytest.warns(NarrowBlocks, match="24 are wanted, and estimates may be worse than those of admm-tv"):
        assert find_prior(camera, prior).block == (2, 3, 9)


def test_it_is_not_learned_from_light_fields():
    axes = ("view_v", "view_u", "y", "x")
    with pytest.raises(SettingError, match="learned from cubes"):
        learn_prior(xr.DataArray(torch.rand(2, 2, 16, 16).numpy(), dims=axes), kind="subspace")
