"""Problems and recoveries survive the disk, open elsewhere, and wrong files are named."""

import numpy as np
import pytest
import xarray as xr

from tmca.dbd import Problem, Source, Units, simulate, solve
from tmca.dbd.files import load_problem, save_problem, save_recovery
from tmca.errors import DataError, SettingError, ShapeError


def plain():
    return simulate(M=7, P=3, J=2, targets=2, paths=1, messages="block", seed=1, snr_db=20)


def test_a_problem_comes_back_as_it_was(tmp_path):
    problem = plain()
    there = Problem(problem.y, problem.sources, problem.sigma, problem.truth, Units(1e-6, 2e4, 1e9))
    back = load_problem(save_problem(there, tmp_path / "p.nc"))
    np.testing.assert_array_equal(back.y, there.y)
    assert (back.sigma, back.units) == (there.sigma, there.units)
    for one, other in zip(back.sources, there.sources, strict=True):
        assert (one.name, one.weight) == (other.name, other.weight)
        np.testing.assert_array_equal(one.rows, other.rows)
        np.testing.assert_array_equal(one.message, other.message)
    for one, other in zip(back.truth, there.truth, strict=True):
        np.testing.assert_array_equal(one.points, other.points)
        np.testing.assert_array_equal(one.waveform, other.waveform)


def test_unknown_noise_and_no_truth_stay_unknown(tmp_path):
    back = load_problem(save_problem(Problem(plain().y, plain().sources), tmp_path / "p.nc"))
    assert (back.sigma, back.truth, back.units) == (None, None, None)


def test_a_recovery_opens_in_xarray(tmp_path):
    recovery = solve(simulate(M=9, P=5, J=2, targets=2, paths=1, seed=2))
    with xr.open_dataset(save_recovery(recovery, tmp_path / "r.nc"), engine="h5netcdf") as found:
        assert found.attrs["certificate"] == "certified"
        assert found["points_0"].attrs["source"] == "radar"
        np.testing.assert_allclose(found["points_0"].sel(axis="delay"), recovery["radar"].points[:, 0])
        waveform = found["waveform_0"].sel(part="real") + 1j * found["waveform_0"].sel(part="imaginary")
        np.testing.assert_allclose(waveform, recovery["radar"].waveform)


def test_plain_arrays_are_read(tmp_path):
    problem = plain()
    radar, link = problem.sources
    arrays = {"y": problem.y[0], "basis_radar": 7 * radar.rows[0], "basis_link": link.rows, "sigma": 0.1}
    np.savez(tmp_path / "mine.npz", **arrays, delay_s=1e-6, doppler_hz=2e5, carrier_hz=77e9)
    back = load_problem(tmp_path / "mine.npz")
    assert {source.name: source.messages for source in back.sources} == {"radar": 1, "link": 3}
    assert (back.sigma, back.units) == (0.1, Units(1e-6, 2e5, 77e9, 0.5))
    assert [one.weight for one in back.sources] == [pytest.approx(7), pytest.approx(1)]  # rms of the rows
    np.testing.assert_array_equal(back.y, problem.y)


@pytest.mark.parametrize(
    ("where", "changed"),
    [
        ("sigma", {"sigma": np.ones(2)}),
        ("y", {"y": np.full((3, 6), "a")}),
        ("messages of link", {"message_link": np.array([0, 0.5, 1])}),
        ("units", {"delay_s": 1e-6}),
        ("y", {"y": np.ones((3, 6))}),
        ("", {"message_lnk": np.zeros(3)}),
    ],
)
def test_arrays_that_mean_nothing_are_named(tmp_path, where, changed):
    radar, link = plain().sources
    arrays = {"y": plain().y[0], "basis_radar": radar.rows[0], "basis_link": link.rows} | changed
    np.savez(tmp_path / "mine.npz", **arrays)
    with pytest.raises((DataError, SettingError, ShapeError)) as caught:
        load_problem(tmp_path / "mine.npz")
    assert caught.value.where == ", ".join(filter(None, (str(tmp_path / "mine.npz"), where)))


def test_arrays_beyond_what_may_be_loaded_are_not(tmp_path, monkeypatch):
    radar = plain().sources[0]
    arrays = {"y": plain().y[0], "basis_radar": radar.rows[0], "message_radar": np.zeros(10**6, np.int64)}
    np.savez_compressed(tmp_path / "large.npz", **arrays)
    monkeypatch.setenv("TMCA_MAX_READ", "1MB")
    with pytest.raises(DataError, match=r"large\.npz: found samples and bases, 8 MB in .*TMCA_MAX_READ"):
        load_problem(tmp_path / "large.npz")


def test_units_that_cannot_be_are_refused(tmp_path):
    np.savez(tmp_path / "us.npz", y=plain().y[0], basis_radar=plain().sources[0].rows[0], delay_s=3.0, doppler_hz=2e4)
    with pytest.raises(
        SettingError, match=r"us.npz, delay_s: found 3 s, expected at most 5e-05 s; .*seconds and hertz"
    ):
        load_problem(tmp_path / "us.npz")
    with pytest.raises(SettingError, match="carrier_hz: found -1, expected above 0"):
        Units(1e-6, 2e4, -1)
    assert Units(3.3e-6, 1 / 3.3e-6).delay_s == 3.3e-6  # no gap between intervals


@pytest.mark.parametrize("short", ["radar", "link"])
def test_the_basis_that_does_not_fit_y_is_named(short):
    radar = plain().sources[0]
    rows = {name: radar.rows[:, : 5 if name == short else 7] for name in ("radar", "link")}
    with pytest.raises(ShapeError, match=rf"basis of {short}: found shape \(3, 5, 2\), expected \(3, 7, J\); as y"):
        Problem(plain().y[0], [Source(name, one, radar.message) for name, one in rows.items()])


def test_samples_without_a_basis_are_told_of_waveforms(tmp_path):
    np.savez(tmp_path / "y.npz", y=plain().y[0], delay_s=1e-6, doppler_hz=2e5)
    with pytest.raises(DataError, match=r"basis_NAME or more; or give --waveform NAME=chirp:"):
        load_problem(tmp_path / "y.npz")


@pytest.mark.parametrize("suffix", [".mat", ".sigmf-meta", ".npy"])
def test_recordings_are_referred_to_what_makes_samples_of_them(tmp_path, suffix):
    file = tmp_path / f"own{suffix}"
    file.write_bytes(b"0")
    with pytest.raises(DataError, match=r"or an \.npz; y is made by tmca\.dbd\.read_recording and"):
        load_problem(file)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 cut", b"\x93NUMPY", None])
def test_archives_without_samples_are_named(tmp_path, content):
    np.savez(tmp_path / "x.npz", basis_radar=np.ones((7, 2)))
    if content is not None:
        (tmp_path / "x.npz").write_bytes(content)
    with pytest.raises(DataError) as caught:
        load_problem(tmp_path / "x.npz")
    assert caught.value.where == str(tmp_path / "x.npz")


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """What the file of a problem holds."""
    return xr.load_dataset(save_problem(plain(), tmp_path_factory.mktemp("problem") / "p.nc"), engine="h5netcdf")


@pytest.mark.parametrize(
    ("broken", "error"),
    [
        (lambda stored: stored.assign_attrs(sigma="loud"), DataError),
        (lambda stored: stored.assign_attrs(units_delay_s=1e-6), DataError),
        (lambda stored: stored.assign_attrs(kind="other"), DataError),
        (lambda stored: stored.isel(part=slice(1)), DataError),
        (lambda stored: stored.drop_vars("message_0"), DataError),
        (lambda stored: stored.assign(message_0=stored["message_0"] + 1), SettingError),
    ],
)
def test_broken_problems_are_named(tmp_path, stored, broken, error):
    broken(stored).to_netcdf(tmp_path / "q.nc", engine="h5netcdf")
    with pytest.raises(error) as caught:
        load_problem(tmp_path / "q.nc")
    assert caught.value.where.startswith(str(tmp_path / "q.nc"))


def test_a_known_channel_is_not_ignored(tmp_path):
    source = plain().sources[0]
    np.savez(tmp_path / "mine.npz", y=plain().y[0], basis_radar=source.rows[0], channel_radar=np.ones(3))
    with pytest.raises(
        DataError, match=r"found channel_radar, .*a known channel with an unknown message has no solver"
    ):
        load_problem(tmp_path / "mine.npz")


@pytest.mark.parametrize(
    ("where", "changed"),
    [
        ("y", {"y": plain().y[0].T}),
        ("basis_radar", {"basis_radar": plain().sources[0].rows[0].T}),
        ("y", {"y": plain().y[0].T, "basis_radar": plain().sources[0].rows}),
    ],
)
def test_transposed_arrays_are_asked_about(tmp_path, where, changed):
    np.savez(tmp_path / "mine.npz", **({"y": plain().y[0], "basis_radar": plain().sources[0].rows[0]} | changed))
    with pytest.raises(ShapeError, match=rf"mine.npz, {where}: .*transposed\?"):
        load_problem(tmp_path / "mine.npz")


def test_pulses_with_nan_are_named():
    y = np.array(plain().y)
    y[0, [0, 2], 3] = np.nan
    with pytest.raises(SettingError, match="2 of 21 samples NaN or infinite, in pulses 0, 2 of 0 to 2"):
        Problem(y, plain().sources)


@pytest.mark.parametrize("suffix", [".csv", ".yaml", ".png"])
def test_other_kinds_of_files_are_told_what_is_read(tmp_path, suffix):
    (tmp_path / f"a{suffix}").write_text("1")
    with pytest.raises(DataError, match=rf"the suffix '{suffix}', expected a file of .* \(\.nc\) or an \.npz$"):
        load_problem(tmp_path / f"a{suffix}")
