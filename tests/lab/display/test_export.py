"""Exports come back as the very codes; what a device cannot show, and files that were touched, are refused."""

import json

import numpy as np
import pytest
import torch
from PIL import Image

from tmca.cameras import LightFieldCamera, Snapshot, SpectralCamera, SpectralDepthCamera
from tmca.codes import write_codes
from tmca.decoders import Weights, find_weights
from tmca.errors import DataError, OutputError, SettingError, ShapeError
from tmca.lab.acquisition.session import check_camera
from tmca.lab.display.codes import peak, read_planes
from tmca.lab.display.devices import PRESETS, device_named, grey_of, light_of
from tmca.lab.display.export import export_codes
from tmca.lab.display.manifest import check_export, read_export, read_manifest
from tmca.lab.exported_camera import camera_shown
from tmca.optics import ZernikeHeights
from tmca.optics.zernike import noll, zernike_modes


def snapshot(folder, camera):
    return Snapshot(torch.zeros(1, *camera.snapshot_shape), camera).save(folder / "taken.nc")


def spectral(size=(12, 16), **settings):
    return SpectralCamera(bands=3, size=size, slots=3, seed=2, **settings)


def small_device(name, **changes):
    """A device of the package; one with pixels of its own has few of them, which are quickly written and read."""
    pixels = {"size": (96, 128)} if name in ("dli4120", "pluto-2.1") else {}
    return device_named(name, **pixels, **changes)


def export(folder, camera, *devices, **how):
    """An export ``out`` of a camera's codes, which a snapshot beside it keeps."""
    described = [small_device(device) if isinstance(device, str) else device for device in devices]
    return export_codes(read_planes(snapshot(folder, camera)), described, folder / "out", **how)


def mirror(modes=range(4, 16), rms=20e-9, **settings):
    drawn = rms * torch.randn(2, len(modes), generator=torch.Generator().manual_seed(1))
    maps = ZernikeHeights(drawn, [noll(i) for i in modes], SpectralDepthCamera.from_preset("quick").bench.mask_size)
    return SpectralDepthCamera.from_preset("quick", size=(16, 18), slots=2, mask=maps, **settings)


def test_a_driver_gets_the_manifest_as_it_is_in_the_file(tmp_path):
    made = export(tmp_path, spectral(), small_device("dli4120", flip=("rows",)))
    assert made.manifest == json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert made.manifest["planes"][0]["placement"]["code"] == [12, 16]


@pytest.mark.parametrize("size", [(12, 16), (13, 17)])
@pytest.mark.parametrize(
    "device",
    [
        small_device("dli4120", macro_pixel=3), small_device("dli4120", macro_pixel=2.2, mounting_angle_deg=45.0),
        small_device("dli4120", lattice="diamond", macro_pixel=2), small_device("pluto-2.1"),
        small_device("dli4120", flip=("rows",)), small_device("pluto-2.1", flip=("columns",), gamma=1.7),
    ],
)  # fmt: skip
def test_codes_come_back(tmp_path, size, device):
    camera = spectral(size)
    found = read_export(export(tmp_path, camera, device, "emulated-shutter").folder)
    for name, plane in zip(("aperture", "shutter"), camera.codes(), strict=True):
        assert torch.equal(found.planes[name], plane)


def test_masks_of_a_light_field_camera_come_back(tmp_path):
    camera = LightFieldCamera(views=3, size=(9, 11), slots=2)
    found = read_export(export(tmp_path, camera, "dli4120").folder)
    assert torch.equal(found.planes["aperture"], camera.codes()[0])


@pytest.mark.parametrize(
    ("name", "devices"), [("default-light-field", ["dli4120"]), ("default-spectral-depth", ["dmp40", "coded-exposure"])]
)
def test_codes_that_come_with_tmca_are_exported(tmp_path, name, devices):
    written = export_codes(
        read_planes(name), [device_named(device) for device in devices], tmp_path / "out", sensor_size=(98, 131)
    )
    slots = Weights.find(name).camera.slots
    assert [len(plane["frames"]) for plane in written.manifest["planes"]] == [slots] * len(devices)
    assert [plane["device"]["name"] for plane in written.manifest["planes"]] == devices
    shown = read_export(written.folder).planes
    if "shutter" in shown:  # its tile fills the sensor, at the phase of the camera of any size
        whole = Weights.find(name).camera_for((98, 131)).codes()[1]
        assert torch.equal(shown["shutter"], whole.detach())


def test_weights_that_bring_no_codes_are_not_exported():
    with pytest.raises(SettingError, match="which brings none"):
        read_planes("universal")


def test_mirror_terms_are_the_modes_of_the_heights(tmp_path):
    camera = mirror()
    written = export(tmp_path, camera, "dmp40")
    wanted = camera.point_spread.heights.metres().detach()
    torch.testing.assert_close(read_export(written.folder).modes["coefficients"], wanted, atol=1e-12, rtol=1e-4)
    assert max(written.manifest["planes"][0]["residual_rms_nm"]) < 0.05


def test_what_a_mirror_cannot_show_is_told(tmp_path):
    """Modes of equal strength, half of which the mirror has not: the other half is left."""
    camera = mirror(modes=range(4, 28))
    found = export(tmp_path, camera, "dmp40").manifest["planes"][0]["residual_rms_nm"]
    rms = camera.point_spread.heights.metres().detach()[:, 12:].square().sum(1).sqrt() * 1e9
    np.testing.assert_allclose(found, rms, rtol=0.03)


@pytest.mark.parametrize("index", [4, 5, 7, 11, 14])
def test_peaks_are_those_of_the_modes(index):
    assert float(zernike_modes([noll(index)], (401, 401)).abs().max()) == pytest.approx(peak(index), rel=0.02)


@pytest.fixture
def tiles(tmp_path):
    """Tiles of an aperture and a shutter, and the codes of the file that they are kept in."""
    tiles = torch.randint(0, 2, (2, 4, 6)).float(), torch.randint(0, 2, (2, 4, 6)).float()
    return *tiles, read_planes(write_codes(tmp_path / "codes.nc", *tiles, (4, 6)))


def test_tiles_fill_the_device(tmp_path, tiles):
    devices = [device_named("pluto-2.1"), device_named("coded-exposure")]
    export_codes(tiles[-1], devices, tmp_path / "out", sensor_size=(9, 14))
    found = read_export(tmp_path / "out").planes
    assert found["aperture"].shape == (2, 270, 480)
    assert torch.equal(found["aperture"][:, 4:8, 6:12], tiles[0])
    assert torch.equal(found["shutter"][:, 8:9, :6], tiles[1][:, :1])


def test_frames_are_of_the_kind_that_devices_take(tmp_path):
    export(tmp_path, spectral(), device_named("pluto-2.1"), "coded-exposure")
    with Image.open(tmp_path / "out" / "aperture" / "aperture_000.png") as frame:
        assert (frame.mode, frame.size) == ("L", (1920, 1080))
    with Image.open(tmp_path / "out" / "shutter" / "shutter_002.png") as frame:
        assert (frame.mode, frame.size) == ("1", (18, 12))


def test_the_manifest_says_when_and_in_what_order(tmp_path):
    written = export(tmp_path, spectral(), "dli4120", exposure=0.3)
    frames = json.loads((tmp_path / "out" / "manifest.json").read_text())["planes"][0]["frames"]
    assert [frame["slot"] for frame in frames] == [0, 1, 2]
    assert [frame["start_s"] for frame in frames] == pytest.approx([0, 0.1, 0.2])
    assert all(frame["duration_s"] == pytest.approx(0.1) for frame in frames)
    assert written.manifest["exposure_s"] == 0.3


@pytest.mark.parametrize("gamma", [1.0, 2.2])
def test_grey_levels_give_the_light_that_is_asked_for(gamma):
    device = device_named("pluto-2.1", gamma=gamma)
    light = np.linspace(0, 1, 200, dtype=np.float32)
    shown = light_of(grey_of(light, device), device)
    assert np.abs(shown - light).max() <= 0.5 * np.diff((np.arange(256) / 255) ** gamma).max() + 1e-6


def test_a_measured_response_takes_the_place_of_the_gamma(tmp_path):
    (tmp_path / "lut.csv").write_text("grey,light\n" + "\n".join(f"{g},{3 + g**1.5}" for g in range(0, 256, 5)))
    device = device_named("pluto-2.1", lut=str(tmp_path / "lut.csv"))
    np.testing.assert_allclose(light_of(np.array([0, 50, 255], np.uint8), device), [0, (50 / 255) ** 1.5, 1], atol=1e-6)


def test_a_phase_gives_the_light_that_crossed_polarisers_pass(tmp_path):
    """Malus: retardance φ passes sin²(φ/2); beyond π it falls again, and nothing is lost by that."""
    phases = np.linspace(0, 1.4 * np.pi, 256)
    (tmp_path / "lut.csv").write_text("grey,phase_rad\n" + "\n".join(f"{g},{p}" for g, p in enumerate(phases)))
    device = device_named("pluto-2.1", lut=str(tmp_path / "lut.csv"))
    np.testing.assert_allclose(light_of(np.arange(256).astype(np.uint8), device), np.sin(phases / 2) ** 2, atol=1e-4)
    light = np.linspace(0, 1, 300, dtype=np.float32)
    nearest = np.abs(np.sin(phases / 2)[None] ** 2 - light[:, None]).argmin(1)
    slow = np.abs(np.sin(phases[nearest] / 2) ** 2 - light)
    found = np.abs(np.sin(phases[grey_of(light, device)] / 2) ** 2 - light)
    np.testing.assert_allclose(found, slow, atol=1e-4)


def test_an_export_carries_the_response_that_it_is_read_with(tmp_path):
    (tmp_path / "lut.csv").write_text("grey,light\n0,0\n100,0.1\n255,1\n")
    camera, device = spectral(), small_device("pluto-2.1", lut=str(tmp_path / "lut.csv"))
    folder = export(tmp_path, camera, device).folder
    (tmp_path / "lut.csv").unlink()
    folder = folder.rename(tmp_path / "moved")
    assert torch.equal(read_export(folder).planes["aperture"], camera.codes()[0])
    (folder / "aperture" / "response.csv").write_text("grey,light\n0,0\n255,1\n")
    with pytest.raises(DataError, match=r"response.csv: found another content"):
        check_export(folder)
    (folder / "aperture" / "response.csv").unlink()
    with pytest.raises(DataError, match=r"response.csv: found no such file"):
        check_export(folder)


@pytest.fixture
def written(tmp_path):
    return export(tmp_path, spectral(), "dli4120", "emulated-shutter").folder


def test_files_that_are_gone_or_changed_are_refused(written):
    one = written / "aperture" / "aperture_001.png"
    for change in (lambda: one.write_bytes(b"nothing"), one.unlink):
        change()
        with pytest.raises(DataError) as found:
            check_export(written)
        assert found.value.where == str(one)


@pytest.mark.parametrize("text", ["[]", "{", '{"format": "other"}', '{"format": "tmca export 1", "slots": 2}'])
def test_a_manifest_that_is_none_is_refused(written, text):
    (written / "manifest.json").write_text(text)
    with pytest.raises(DataError) as found:
        check_export(written)
    assert found.value.where == str(written / "manifest.json")


@pytest.mark.parametrize(
    ("devices", "how", "where"),
    [
        (["dli4120", "pluto-2.1"], {}, "--device"), ([], {}, "--device"),
        (["pluto-2.1"], {"exposure": 0.01}, "--exposure"), (["dli4120"], {"exposure": -1}, "--exposure"),
        (["dmp40"], {}, "taken.nc"), (["dli4120"], {"code_size": (20, 20)}, "taken.nc"),
        (["dli4120"], {"offset": (380, 0)}, "--offset"), (["dli4120"], {"code_size": (0, 4)}, "--code-size"),
        (["emulated-shutter"], {"sensor_size": (3, -4)}, "--sensor-size"),
        (["dli4120"], {"exposure": "a"}, "--exposure"),
    ],
)  # fmt: skip
def test_what_cannot_be_shown_leaves_nothing(tmp_path, devices, how, where):
    with pytest.raises((SettingError, ShapeError)) as found:
        export(tmp_path, spectral(), *devices, **how)
    assert found.value.where.endswith(where)
    assert [file.name for file in tmp_path.iterdir()] == ["taken.nc"]


def test_a_snapshot_of_codes_that_repeat_is_exported_over_any_size(tmp_path):
    camera, devices = spectral(period=4), [small_device("dli4120"), device_named("emulated-shutter")]
    large = read_planes(snapshot(tmp_path, camera), (30, 41))
    found = read_export(export_codes(large, devices, tmp_path / "large", code_size=(30, 41)).folder).planes
    for name, plane in zip(("aperture", "shutter"), camera.codes(), strict=True):
        rows, columns = (np.arange(side) % 4 for side in found[name].shape[1:])
        assert torch.equal(found[name], plane[:, rows][:, :, columns])
    taken = camera_shown(Snapshot.load(tmp_path / "taken.nc"), read_manifest(tmp_path / "large"))
    assert taken.camera.size == (30, 41)
    check_camera(tmp_path / "large", taken.camera)


def test_masks_beyond_the_stroke_are_refused(tmp_path):
    with pytest.raises(SettingError, match=r"0\.01 µm at most"):
        export(tmp_path, mirror(), device_named("dmp40", stroke_um=0.01))


def test_nothing_is_replaced_unasked(tmp_path, written):
    codes = read_planes(tmp_path / "taken.nc")
    with pytest.raises(OutputError, match="--overwrite"):
        export_codes(codes, [small_device("dli4120")], written)
    export_codes(codes, [small_device("dli4120")], written, overwrite=True)
    assert not (written / "shutter").exists()
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("")
    with pytest.raises(OutputError, match="no export"):
        export_codes(codes, [small_device("dli4120")], tmp_path / "mine", overwrite=True)


def test_a_link_leads_to_the_folder_of_the_export(tmp_path, written):
    (tmp_path / "link").symlink_to(written, target_is_directory=True)
    again = [small_device("dli4120"), device_named("emulated-shutter")]
    export_codes(read_planes(tmp_path / "taken.nc"), again, tmp_path / "link", exposure=0.2, overwrite=True)
    assert (tmp_path / "link").is_symlink()
    assert check_export(written)["exposure_s"] == 0.2


def test_the_folder_that_one_stands_in_is_refused(tmp_path, written, monkeypatch):
    monkeypatch.chdir(written)
    with pytest.raises(OutputError):
        export_codes(read_planes(tmp_path / "taken.nc"), [small_device("dli4120")], ".", overwrite=True)


@pytest.mark.parametrize("left", [".DS_Store", "aperture/Thumbs.db", ".overview.png.0123456789ab.tmp"])
def test_what_a_system_or_a_killed_process_left_in_an_export_does_not_stop_its_replacing(tmp_path, written, left):
    (written / left).mkdir() if left.endswith(".tmp") else (written / left).write_text("")
    export_codes(read_planes(tmp_path / "taken.nc"), [small_device("dli4120")], written, overwrite=True)
    assert not (written / left).exists()


@pytest.mark.parametrize("kept", ["captures/dark.tif", "aperture/mine.png", "notes.txt", "captures"])
def test_an_export_that_is_replaced_takes_nothing_else_with_it(tmp_path, written, kept):
    (written / kept).parent.mkdir(exist_ok=True)
    (written / kept).write_text("mine") if "." in kept else (written / kept).mkdir()
    (written / "overview.png").write_text("")
    before = {file: file.read_bytes() for file in written.rglob("*") if file.is_file()}
    with pytest.raises(OutputError, match=f"{kept.split('/')[0]}.*no part of the export"):
        export_codes(read_planes(tmp_path / "taken.nc"), [small_device("dli4120")], written, overwrite=True)
    assert {file: file.read_bytes() for file in written.rglob("*") if file.is_file()} == before


@pytest.mark.parametrize("bits", [1, 8, 12, 16])
def test_open_mirrors_are_the_largest_number_of_their_frames(tmp_path, bits):
    camera = spectral()
    folder = export(tmp_path, camera, small_device("dli4120", bits=bits)).folder
    with Image.open(folder / "aperture" / "aperture_000.png") as frame:
        assert np.unique(np.asarray(frame)).tolist() == [0, 2**bits - 1]
    assert torch.equal(read_export(folder).planes["aperture"], camera.codes()[0])


def test_a_sensor_without_a_size_shows_no_tile_unasked(tmp_path, tiles):
    with pytest.raises(SettingError, match=r"--sensor-size: found none, .*a tile of 4×6"):
        export_codes(tiles[-1], [device_named("emulated-shutter")], tmp_path / "out")
    turned = device_named("dli4120", mounting_angle_deg=45.0)
    with pytest.raises(SettingError, match="--code-size: found none"):
        export_codes(tiles[-1], [turned], tmp_path / "out")


def test_all_terms_of_a_mirror_together_have_a_stroke(tmp_path):
    """Defocus alone, 2√3 a between its middle and its edge; with another term of its peak they add up."""
    camera = mirror()
    found = export(tmp_path, camera, "dmp40").manifest["planes"][0]["peak_to_valley_um"]
    modes = zernike_modes([noll(i) for i in range(4, 16)], (301, 301))
    maps = torch.tensordot(camera.point_spread.heights.metres().detach().double(), modes, 1)[:, modes[0] != 0] * 1e6
    np.testing.assert_allclose(found, maps.amax(1) - maps.amin(1), rtol=0.03)
    codes, tight = read_planes(tmp_path / "taken.nc"), device_named("dmp40", total_stroke_um=0.9 * max(found))
    with pytest.raises(SettingError, match=r"between peak and valley in slot \d.*total stroke of dmp40"):
        export_codes(codes, [tight], tmp_path / "other")
    export_codes(codes, [device_named("dmp40", total_stroke_um=1.1 * max(found))], tmp_path / "other")


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_is_a_device(name):
    assert device_named(name).name == name


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("kind: dmd\n", "size"), ("kind: laser\n", "dmd"), ("kind: dmd\nsize: [4, 4]\nwobble: 1\n", "wobble"),
        ("kind: dmd\npattern_rate: 1000\n",
         "mine.yaml: pattern_rate: found an unknown name, expected one of name, .*; did you mean pattern_rate_hz?"),
        ("kind: coded-exposure\nbuckets: 2\ndrain: true\n", "mine.yaml: bits: found nothing, expected 2 or more"),
        ("kind: lcos\nsize: [4, 4]\n", "mine.yaml: bits: found nothing, expected 8"),
        ("- 1\n", "found a list"), ("kind: [\n", "YAML"),
    ],
)  # fmt: skip
def test_descriptions_that_make_no_device_are_refused(tmp_path, text, words):
    (tmp_path / "mine.yaml").write_text(text)
    with pytest.raises((SettingError, DataError), match=words):
        device_named(str(tmp_path / "mine.yaml"))


@pytest.mark.parametrize(
    "lines",
    [
        "0,1\n255,0.5", "0,0\n200,1", "nothing", "0,0,0\n255,1,1", "grey,phase_rad\n0,1\n255,1", "",
        "grey,phase_deg\n0,0\n255,180", "grey,light\n0,0\n100,much\n255,1", "0,0\n255,1\n,",
        "grey,light,x\n0,0\n255,1",
    ],
)  # fmt: skip
def test_responses_that_do_not_rise_are_refused(tmp_path, lines):
    (tmp_path / "lut.csv").write_text(lines)
    with pytest.raises(DataError, match=r"lut.csv"):
        light_of(np.zeros(2, np.uint8), device_named("pluto-2.1", lut=str(tmp_path / "lut.csv")))


def test_the_codes_that_come_with_the_package_are_exported_by_name(tmp_path):
    planes = read_planes("default")
    wanted = find_weights("default", 8)
    torch.testing.assert_close(planes.planes["aperture"], wanted.aperture)
    torch.testing.assert_close(planes.planes["shutter"], wanted.shutter)
    with pytest.raises(DataError, match="weights, default, or a snapshot file"):
        read_planes(tmp_path / "defaults")
