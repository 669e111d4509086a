"""Scans under a tunable source: reflectance with its error, the wavelengths asked for, angles to a spectrometer."""

import shutil

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from studies.rendered_table import render_scan
from tmca.data import label, nm_to_metres
from tmca.errors import DataError, SettingError, ShapeError
from tmca.lab.ground_truth.scan import measure_reflectance, read_scan, white_of
from tmca.lab.ground_truth.spectra import compare_spectra, read_spectra
from tmca.metrics import sam

NM = np.arange(400, 701, 10.0)


def cube(bands=31, size=(12, 15), seed=0):
    rng = np.random.default_rng(seed)
    wave = np.sin(np.linspace(0, 5, bands)[:, None, None] + rng.uniform(0, 6, size))
    return 0.45 + 0.4 * wave * rng.uniform(0.2, 1, size)


def folders(place, seen, nm=NM, order=None):
    """Scene, dark and white as folders of 16-bit PNG, written in any order."""
    for name, frames in (("scene", seen.scene), ("white", seen.white), ("dark", seen.dark)):
        (place / name).mkdir(parents=True, exist_ok=True)
        for i in order if order is not None and name != "dark" else range(len(frames)):
            named = f"{i}" if name == "dark" else f"{name}_{nm[i]:g}nm"
            Image.fromarray(frames[i]).save(place / name / f"{named}.png")
    return place / "scene", place / "dark", place / "white"


@settings(max_examples=5, deadline=None)
@given(height=st.integers(3, 9), width=st.integers(3, 9), seed=st.integers(0, 99))
def test_without_noise_reflectance_is_exact_to_rounding(tmp_path_factory, height, width, seed):
    place, truth = tmp_path_factory.mktemp("scan"), cube(5, (height, width), seed)
    seen = render_scan(truth, read_noise=0, darks=1, bits=16)
    found = measure_reflectance(read_scan(*folders(place, seen, NM[:5])))
    assert np.abs(found["reflectance"].values - truth).max() < 1e-4
    assert np.allclose(found["wavelength_nm"], NM[:5])


@pytest.mark.parametrize("gain", [0.0, 0.5])
def test_the_standard_deviation_is_that_of_many_scans(tmp_path, gain):
    truth, estimates = cube(3, (8, 9)), []
    for seed in range(60):
        seen = render_scan(truth, read_noise=8.0, gain=gain, darks=4, seed=seed)
        scan = read_scan(*folders(tmp_path, seen, NM[:3]), saturation=4095)
        found = measure_reflectance(scan, gain=gain, read_noise=8.0, white_reflectance=0.7)
        estimates.append(found["reflectance"].values)
    spread = np.std(estimates, axis=0, ddof=1)
    assert np.sqrt(np.mean(spread**2 / found["reflectance_std"].values ** 2)) == pytest.approx(1, abs=0.05)
    assert scan.read_noise == pytest.approx(8.0, rel=0.1)


@pytest.mark.parametrize("repeats", [1, 4])
def test_dark_frames_of_every_wavelength_tell_the_noise_of_one(tmp_path, repeats):
    seen = render_scan(cube(), read_noise=8.0, darks=31 * repeats, seed=1)
    scene, _, white = folders(tmp_path, seen)
    (tmp_path / "own").mkdir()
    for i, frame in enumerate(seen.dark):
        Image.fromarray(frame).save(tmp_path / "own" / f"dark_{NM[i % 31]:g}nm_r{i // 31}.png")
    scan = read_scan(scene, tmp_path / "own", white)
    assert scan.read_noise == pytest.approx(8.0, rel=0.05)
    assert scan.dark_frames.tolist() == [repeats] * 31


def test_saturated_pixels_are_left_out_and_counted(tmp_path):
    seen = render_scan(cube(), bits=16, read_noise=4)
    seen.scene[3, 2, 5], seen.white[7, 1, 1] = 65535, 65535
    found = measure_reflectance(read_scan(*folders(tmp_path, seen)))
    gone = np.isnan(found["reflectance"].values)
    assert gone.sum() == 2 == found.attrs["saturated_pixels"]
    assert gone[3, 2, 5]
    assert gone[7, 1, 1]
    assert (found["quality"].values[gone] == 1).all()


def test_the_order_of_the_files_does_not_matter_where_names_say_the_wavelength(tmp_path):
    seen = render_scan(cube(), bits=16)
    one = read_scan(*folders(tmp_path / "a", seen), wavelengths=nm_to_metres(NM))
    other = read_scan(*folders(tmp_path / "b", seen, order=np.random.default_rng(0).permutation(31)))
    assert np.array_equal(one.scene.values, other.scene.values)
    assert np.array_equal(one.nm, other.nm)
    np.save(tmp_path / "s.npy", seen.scene)
    np.save(tmp_path / "w.npy", seen.white)
    stacks = read_scan(tmp_path / "s.npy", tmp_path / "a" / "dark", tmp_path / "w.npy", wavelengths=nm_to_metres(NM))
    assert np.array_equal(one.scene.values, stacks.scene.values)


def test_other_wavelengths_than_those_asked_for_are_named(tmp_path):
    seen = render_scan(cube(), bits=16)
    paths = folders(tmp_path, seen)
    with pytest.raises(DataError, match=r"no frame at 405 nm and frames at 400 nm, expected the 2 wavelengths"):
        read_scan(*paths, wavelengths=nm_to_metres([405, 415]))
    (paths[0] / "scene_450nm.png").unlink()
    with pytest.raises(DataError, match=r"scene: found no frame at 450 nm, expected the 31 wavelengths"):
        read_scan(*paths, wavelengths=nm_to_metres(NM))
    with pytest.raises(DataError, match=r"white: found frames at 450 nm, expected the 30 wavelengths"):
        read_scan(*paths)
    (paths[0] / "scene_450.7nm.png").write_bytes((paths[0] / "scene_430nm.png").read_bytes())
    with pytest.raises(DataError, match=r"no frame at 450 nm and frames at 450\.7 nm"):
        read_scan(*paths, wavelengths=nm_to_metres(NM))


def repeated(place, kind, nm, frames):
    """More frames of one wavelength, each named as the first with the number of its repeat."""
    for n, frame in enumerate(frames):
        Image.fromarray(frame).save(place / kind / f"{kind}_{nm:g}nm_r{n + 1}.png")


def test_frames_of_one_wavelength_are_averaged_one_by_one(tmp_path):
    counts = {"scene": (3, 1, 2), "white": (1, 4, 2), "dark": (2, 1, 3)}
    rng, wanted = np.random.default_rng(4), {}
    for kind, level in (("scene", 9000), ("white", 20000), ("dark", 300)):
        (tmp_path / kind).mkdir()
        for nm, count in zip(NM[:3], counts[kind], strict=True):
            frames = rng.integers(level, level + 3000, (count, 5, 4)).astype(np.uint16)
            if (kind, nm) == ("scene", 420):
                frames[1, 2, 3] = 65535
            Image.fromarray(frames[0]).save(tmp_path / kind / f"{kind}_{nm:g}nm.png")
            repeated(tmp_path, kind, nm, frames[1:])
            wanted[kind, nm] = frames
    scan = read_scan(tmp_path / "scene", tmp_path / "dark", tmp_path / "white")
    found = measure_reflectance(scan, read_noise=7.0, gain=0.5)
    for band, nm in enumerate(NM[:3]):
        for y in range(5):
            for x in range(4):
                means, variances = [], []
                for kind in ("scene", "white", "dark"):
                    values = [float(frame[y, x]) for frame in wanted[kind, nm]]
                    means.append(sum(values) / len(values))
                    variances.append((49 + 1 / 12) / len(values))
                above, range_ = means[0] - means[2], means[1] - means[2]
                variances[0] += 0.5 * above / len(wanted["scene", nm])
                variances[1] += 0.5 * range_ / len(wanted["white", nm])
                ratio = above / range_
                var = variances[0] + ratio**2 * variances[1] + (1 - ratio) ** 2 * variances[2]
                if (band, y, x) == (2, 2, 3):
                    assert found["quality"].values[band, y, x] == 1
                    continue
                assert found["reflectance"].values[band, y, x] == pytest.approx(ratio, rel=1e-5)
                assert found["reflectance_std"].values[band, y, x] == pytest.approx(np.sqrt(var) / range_, rel=1e-5)
    assert found.attrs["saturated_pixels"] == 1


def test_frames_near_a_wavelength_asked_for_are_its_repeats_and_serve_no_other(tmp_path):
    seen = render_scan(cube(2), bits=16)
    paths = folders(tmp_path, seen, np.array([449.8, 460.0]))
    Image.fromarray(seen.scene[0] + 1).save(paths[0] / "scene_450.2nm.png")
    scan = read_scan(*paths, wavelengths=nm_to_metres([450, 460]))
    assert scan.scene_frames.tolist() == [2, 1]
    assert scan.scene.values.shape[0] == 2
    with pytest.raises(DataError, match=r"no frame at 460\.4 nm, expected the 3 wavelengths"):
        read_scan(*paths, wavelengths=nm_to_metres([450, 460, 460.4]))


def test_scans_that_cannot_be_used_are_refused(tmp_path):
    seen = render_scan(cube(), bits=16)
    scene, dark, white = folders(tmp_path, seen)
    np.save(tmp_path / "s.npy", seen.scene)
    np.save(tmp_path / "small.npy", seen.dark[:, 1:])
    np.save(tmp_path / "black.npy", seen.dark[:1].repeat(31, axis=0))
    for paths, how, error, said in [
        ((tmp_path / "s.npy", dark, white), {}, SettingError, "wavelengths: .* one per frame"),
        ((tmp_path / "s.npy", dark, white), {"wavelengths": NM[1:] * 1e-9}, DataError, "found 31 frames, expected 30"),
        ((scene, dark, white), {"wavelengths": NM[::-1] * 1e-9}, SettingError, "ascending"),
        ((scene, tmp_path / "small.npy", white), {}, DataError, "frames of 11×15 pixels, expected 12×15"),
        ((scene, dark, white), {"saturation": 15000}, DataError, "% of the pixels saturated in scene_"),
    ]:
        with pytest.raises(error, match=said):
            read_scan(*paths, **how)
    with pytest.raises(DataError, match=r"no pixel that is neither saturated nor dark"):
        measure_reflectance(read_scan(scene, dark, tmp_path / "black.npy"), read_noise=64.0)
    (scene / "extra.png").write_bytes((scene / "scene_400nm.png").read_bytes())
    with pytest.raises(DataError, match="a frame named extra"):
        read_scan(scene, dark, white)


def test_frames_of_another_type_are_refused(tmp_path):
    scene, dark, white = folders(tmp_path, render_scan(cube(), read_noise=64.0, bits=16))
    for file in scene.iterdir():
        Image.fromarray((np.asarray(Image.open(file)) >> 8).astype(np.uint8)).save(file)
    with pytest.raises(DataError, match="white: found digital numbers of type uint16, expected uint8 as the scene's"):
        read_scan(scene, dark, white)


def test_bands_with_a_dark_white_are_left_out(tmp_path):
    seen = render_scan(cube(), bits=16, darks=31)
    seen.white[3] = seen.dark[3]
    found = measure_reflectance(read_scan(*folders(tmp_path, seen)))
    assert np.isnan(found["reflectance"].values[3]).mean() > 0.99
    assert np.isfinite(found["reflectance"].values[4]).all()


@pytest.mark.parametrize("kind", ["gloss", "fluorescence", "black"])
def test_gloss_fluorescence_and_black_scenes_are_no_faults(tmp_path, kind):
    truth = cube()
    if kind == "gloss":
        truth[:, :6, :5] = 2.0
    elif kind == "fluorescence":
        truth[:4] = 1.6
    else:
        truth[:] = 0
    seen = render_scan(0.5 * truth, source=np.full(31, 0.6), read_noise=64.0, bits=16)
    found = measure_reflectance(read_scan(*folders(tmp_path, seen)), white_reflectance=0.99)
    assert found["reflectance"].values[:, 2, 3].mean() == pytest.approx(0.99 * 0.5 * truth[:, 2, 3].mean(), abs=0.02)


@pytest.mark.parametrize("darks", [1, 3])
def test_dark_frames_tell_the_noise_if_there_is_but_one_or_copies_of_one(tmp_path, darks):
    seen = render_scan(cube(3, (40, 50)), read_noise=64.0, darks=1, bits=16, seed=3)
    paths = folders(tmp_path, seen, NM[:3])
    for copy in range(1, darks):
        shutil.copy(paths[1] / "0.png", paths[1] / f"{copy}.png")
    scan = read_scan(*paths)
    assert scan.read_noise == pytest.approx(64.0, rel=0.1)
    known = measure_reflectance(scan, read_noise=64.0)["reflectance_std"]
    np.testing.assert_allclose(measure_reflectance(scan)["reflectance_std"], known, rtol=0.1)


def test_floats_without_any_noise_in_the_dark_need_to_be_told_it(tmp_path):
    seen = render_scan(cube(3), read_noise=4.0, darks=1)
    for name, frames in (("scene", seen.scene), ("white", seen.white), ("dark", 0 * seen.dark)):
        np.save(tmp_path / f"{name}.npy", frames / 4095)
    paths = (tmp_path / f"{name}.npy" for name in ("scene", "dark", "white"))
    scan = read_scan(*paths, wavelengths=nm_to_metres(NM[:3]))
    with pytest.raises(SettingError, match=r"none in the dark frames, expected that of a frame \(--read-noise\)"):
        measure_reflectance(scan)
    assert float(measure_reflectance(scan, read_noise=1e-3)["reflectance_std"].min()) > 0


@pytest.mark.parametrize("bad", [{"read_noise": -1.0}, {"gain": np.nan}, {"white_reflectance": 0.0}])
def test_impossible_settings_are_refused(tmp_path, bad):
    scan = read_scan(*folders(tmp_path, render_scan(cube(2), bits=16), NM[:2]))
    with pytest.raises(SettingError):
        measure_reflectance(scan, **bad)


def test_rendering_needs_a_cube():
    with pytest.raises(ShapeError):
        render_scan(np.ones((3, 4)))


FILES = {
    "commas": "nm,P1,P2\n400,0.1,0.5\n550,0.2,0.6\n700,0.3,0.7\n",
    "tabs": "Wavelength (nm)\tP1\tP2\n400\t0.1\t0.5\n550\t0.2\t0.6\n700\t0.3\t0.7\n",
    "spectrometer": "Date: today\nIntegration Time (usec): 100000\nnm P1 P2\n>>>>>Begin Spectral Data<<<<<\n"
    "400.0 0.1 0.5\n550.0 0.2 0.6\n700.0 0.3 0.7\n>>>>>End Spectral Data<<<<<\n",
    "descending": "nm;P1;P2\n700;0.3;0.7\n550;0.2;0.6\n400;0.1;0.5\n",
}


@pytest.mark.parametrize("kind", FILES)
def test_text_files_of_spectra_are_read(tmp_path, kind):
    (tmp_path / "r.txt").write_text(FILES[kind])
    found = read_spectra(tmp_path / "r.txt")
    assert found.names == ("P1", "P2")
    assert found.nm.tolist() == [400, 550, 700]
    assert np.allclose(found.at(np.array([475.0])), [[0.15], [0.55]])
    assert np.allclose(white_of(str(tmp_path / "r.txt"), np.array([400.0, 700.0])), [0.1, 0.3])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "0 lines of numbers"),
        ("400,1\n500,2\n600,x\n", "line 3: '600,x'"),
        ("400,1\n500,2\n600,1,2\n", "line 3 with 3 numbers"),
        ("0.4,1\n0.5,2\n0.6,1\n", "nanometres"),
        ("400,1\n400,2\n600,1\n", "a wavelength twice"),
        ("400,1\n500,nan\n600,1\n", "not finite"),
    ],
)
def test_files_that_are_no_spectra_are_refused(tmp_path, text, said):
    (tmp_path / "r.csv").write_text(text)
    with pytest.raises(DataError, match=said):
        read_spectra(tmp_path / "r.csv")
    with pytest.raises(DataError, match="no such file"):
        read_spectra(tmp_path / "gone.csv")


def test_a_wide_source_sees_a_line_as_wide_as_both(tmp_path):
    fine = np.arange(400, 701, 1.0)
    line = np.exp(-(((fine - 550) / 12) ** 2) / 2)
    rows = "\n".join(f"{w},{v}" for w, v in zip(fine, line, strict=True))
    (tmp_path / "line.csv").write_text(rows)
    width = 20.0 * np.sqrt(8 * np.log(2))
    found = read_spectra(tmp_path / "line.csv").at(np.array([510.0, 550.0, 580.0]), width)[0]
    both = np.hypot(12, 20)
    expected = 12 / both * np.exp(-(((np.array([510, 550, 580]) - 550) / both) ** 2) / 2)
    assert np.allclose(found, expected, atol=1e-4)


def test_points_are_held_against_their_references(tmp_path):
    truth = cube()
    (tmp_path / "r.csv").write_text(
        "nm,A,B\n" + "\n".join(f"{w},{truth[i, 5, 6]},{1 - truth[i, 5, 6]}" for i, w in enumerate(NM))
    )
    (tmp_path / "f.csv").write_text("nm,red\n400,0\n599,0\n600,1\n700,1\n")
    references, responses = read_spectra(tmp_path / "r.csv"), read_spectra(tmp_path / "f.csv")
    known = label(truth.astype(np.float32), nm_to_metres(NM))
    a, b = compare_spectra(known, references, {"A": (5, 6), "B": (5, 6)}, box=1, filters=responses)
    assert a.angle < 1e-4
    assert a.filters["red"] == pytest.approx((truth[20:, 5, 6].mean(),) * 2, rel=1e-5)
    u, v = truth[:, 5, 6], 1 - truth[:, 5, 6]
    angle = np.degrees(np.arccos(u @ v / np.linalg.norm(u) / np.linalg.norm(v)))
    assert b.angle == pytest.approx(angle, abs=1e-3)
    assert b.angle == pytest.approx(sam(u[:, None, None], v[:, None, None]), abs=1e-3)
    holes = known.copy()
    holes[4, 5, 6] = np.nan
    assert compare_spectra(holes, references, {"A": (5, 6)}, box=1)[0].nm.size == 30


def test_comparisons_that_make_no_sense_are_refused(tmp_path):
    (tmp_path / "r.csv").write_text("nm,A\n400,1\n550,1\n690,1\n")
    references, known = read_spectra(tmp_path / "r.csv"), label(cube().astype(np.float32), nm_to_metres(NM))
    with pytest.raises(DataError, match="spectra from 400 to 690 nm, expected 400 to 700 nm"):
        compare_spectra(known, references, {"A": (5, 6)})
    known = known[:29]
    for points, box, said in (({}, 5, "none"), ({"B": (5, 6)}, 5, "found 'B'"), ({"A": (5, 6)}, 4, "an odd number")):
        with pytest.raises(SettingError, match=said):
            compare_spectra(known, references, points, box=box)
    with pytest.raises(DataError, match="a box inside 12×15 pixels"):
        compare_spectra(known, references, {"A": (1, 6)})
    with pytest.raises(DataError, match="0 bands measured"):
        compare_spectra(known * np.nan, references, {"A": (5, 6)})
