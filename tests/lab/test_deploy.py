"""Exported decoders compute what the network does, and need nothing of the package."""

import json
import subprocess
import sys

import numpy as np
import pytest
import torch
import xarray as xr

from tests.cli.calls import answer, said
from tests.cli.refusals import refused
from tmca.cameras import Snapshot, SpectralCamera
from tmca.decoders import Weights, build_network
from tmca.errors import DataError, OutputError, SettingError
from tmca.lab.deploy import check_decoder, code_marks, decode_exported, decoder_file, export_decoder
from tmca.lab.fixed_decoder import FixedOperator, LookedUpOperator
from tmca.lab.importing import WITHHELD, without_pixels
from tmca.lab.loading import load_exported
from tmca.operators import TapOperator, Taps

SIZE, BANDS = (24, 21), 4


def written_weights(folder, start="dagger", kind="unrolled", dispersion=1.0, bands=BANDS, stages=2):
    torch.manual_seed(0)
    settings = {"stages": stages, "blocks": 1} if kind == "unrolled" else {}
    network = build_network(kind, bands=bands, start=start, widths=(8, 8), **settings)
    for parameter in network.parameters():  # an untrained one returns its start
        torch.nn.init.normal_(parameter, 0.0, 0.05)
    mask = torch.rand(1, *SIZE, generator=torch.Generator().manual_seed(1))
    card = {"training": {"noise": [{"read_noise": 0.02, "full_well": 5000.0}]}}
    waves = tuple(5e-7 + 2e-8 * band for band in range(bands))
    camera = SpectralCamera(waves, SIZE, 1, aperture=mask, shutter="open", dispersion=dispersion)
    weights = Weights.of(network, camera, "", card)
    return weights.save(folder / "weights.safetensors")


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """The weights' file and the folder of their torch export."""
    folder = tmp_path_factory.mktemp("exported")
    file = written_weights(folder)
    return file, folder / "out", export_decoder(file, folder / "out", ("torch",))


@pytest.mark.parametrize("kind", [FixedOperator, LookedUpOperator])
@pytest.mark.parametrize(("offsets", "spare"), [((0, 2, 4), 0), ((4, 2, 0), 3), ((3, 0, 3, 1), 2), ((0, 11, 5), 1)])
@pytest.mark.parametrize("size", [(1, 1), (5, 1), (1, 7), (6, 8), (7, 9)])
def test_both_forms_of_the_operator_are_the_camera_s(kind, offsets, spare, size):
    draw = torch.Generator().manual_seed(3)
    bands, wide = len(offsets), max(offsets) + size[1] + spare
    code = torch.rand(bands, *size, generator=draw, dtype=torch.float64)
    own = TapOperator(Taps(code, tuple(range(bands)), offsets, bands, wide))
    fixed = kind(own)
    scene = torch.randn(2, bands, *size, generator=draw, dtype=torch.float64)
    snapshot = torch.randn(2, 1, size[0], wide, generator=draw, dtype=torch.float64)
    torch.testing.assert_close(fixed.A(scene), own.A(scene))
    torch.testing.assert_close(fixed.A_adjoint(snapshot), own.A_adjoint(snapshot))
    torch.testing.assert_close(fixed.A_dagger(snapshot), own.A_dagger(snapshot))


def test_the_torch_file_is_the_network(exported):
    file, folder, found = exported
    assert [one.format for one in found] == ["torch"]
    assert found[0].error < 1e-5
    assert check_decoder(folder, file)[0].error < 1e-5


def test_a_grey_mask_stays_grey_in_the_weights(exported):
    aperture = Weights.load(exported[0]).codes["aperture"]
    torch.testing.assert_close(aperture, torch.rand(1, *SIZE, generator=torch.Generator().manual_seed(1)))


def test_it_decodes_as_the_package_does(exported, tmp_path):
    from tmca.decoders import decode

    file, folder, _ = exported
    weights = Weights.load(file)
    about = json.loads((folder / "decoder.json").read_text())
    camera = weights.camera_for()
    camera.sensor.read_noise, camera.sensor.full_well = 0.02, 5000.0
    taken = Snapshot(camera.A(torch.rand(1, BANDS, *SIZE)), camera)
    taken.save(tmp_path / "s.nc")
    estimate = decode_exported(folder, tmp_path / "s.nc", "torch")
    wanted = decode(taken, "network", weights=weights).values
    torch.testing.assert_close(estimate.values, wanted, atol=1e-4, rtol=1e-4)
    assert estimate.seconds > 0
    assert estimate.to_xarray()["estimate"].dims == ("wavelength", "y", "x")
    assert about["snapshot"] == list(taken.values.shape)


@pytest.mark.slow
def test_it_runs_without_the_package(exported, tmp_path):
    code = (
        f"import torch, sys; program = torch.export.load(r'{exported[1] / 'decoder.pt2'}').module()\n"
        f"print(tuple(program(torch.ones(1, 1, {SIZE[0]}, {SIZE[1] + 3})).shape), 'tmca' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path, check=True)
    assert done.stdout.strip() == f"(1, {BANDS}, {SIZE[0]}, {SIZE[1]}) False"


@pytest.mark.slow
@pytest.mark.parametrize("start", ["adjoint", "tikhonov"])
def test_onnx_is_the_network_too(tmp_path, caplog, start):
    for package in ("onnx", "onnxscript", "onnxruntime"):
        pytest.importorskip(package)
    file = written_weights(tmp_path, start=start)
    found = export_decoder(file, tmp_path / "out", ("onnx",))
    assert found[0].error < 1e-4
    assert "torchvision" not in caplog.text
    assert check_decoder(tmp_path / "out", file)[0].error < 1e-4


@pytest.mark.slow
def test_a_start_by_conjugate_gradients_is_exported_too(tmp_path):
    file = written_weights(tmp_path, start="tikhonov", bands=2, stages=1)
    found = export_decoder(file, tmp_path / "out", ("torch",))
    assert found[0].error < 1e-4
    assert check_decoder(tmp_path / "out", file)[0].error < 1e-4


def test_what_cannot_stand_alone_is_refused(exported, tmp_path):
    with pytest.raises(SettingError, match="from lmmse, expected one that starts from adjoint, dagger or tikhonov"):
        export_decoder(written_weights(tmp_path, start="lmmse"), tmp_path / "a", ("torch",))
    (tmp_path / "weights.safetensors").unlink()
    with pytest.raises(SettingError, match="whole pixels"):
        export_decoder(written_weights(tmp_path, dispersion=0.9), tmp_path / "b", ("torch",))
    with pytest.raises(SettingError, match="some of torch, onnx"):
        export_decoder(exported[0], tmp_path / "c", ("tensorrt",))
    with pytest.raises(OutputError, match=r"decoder\.pt2"):
        export_decoder(exported[0], exported[1], ("torch",))
    with pytest.raises(DataError, match=r"no decoder\.json"):
        check_decoder(tmp_path, exported[0])
    with pytest.raises(DataError, match="no such file"):
        load_exported(tmp_path / "decoder.pt2")
    assert not (tmp_path / "a").exists()


def test_a_file_of_another_network_is_found_out(exported, tmp_path):
    torch.manual_seed(5)
    weights = Weights.load(exported[0])
    for parameter in weights.network.parameters():
        torch.nn.init.normal_(parameter, 0.0, 0.1)
    with pytest.raises(DataError, match=r"differ by .* export it again"):
        check_decoder(exported[1], weights.save(tmp_path / "weights.safetensors"))


def test_a_snapshot_of_another_size_is_refused(exported, tmp_path):
    camera = Weights.load(exported[0]).camera_for()
    from tmca.cameras import SpectralCamera

    other = SpectralCamera(bands=camera.wavelengths, size=(20, 21), slots=1, shutter="open")
    Snapshot(torch.rand(1, *other.snapshot_shape), other).save(tmp_path / "s.nc")
    with pytest.raises(DataError, match=r"\(1, 1, 20, 24\), expected \(1, 1, 24, 24\)"):
        decode_exported(exported[1], tmp_path / "s.nc", "torch")
    with pytest.raises(SettingError, match="one of torch"):
        decode_exported(exported[1], tmp_path / "s.nc", "onnx")


def snapshot_of(folder, change=lambda camera: {}):
    """A snapshot file of the decoder's camera, or of one that differs from it."""
    camera = Weights.load(folder.parent / "weights.safetensors").camera_for()
    own = {
        "bands": camera.wavelengths, "size": camera.size, "slots": 1, "aperture": camera.codes()[0],
        "shutter": camera.codes()[1], "dispersion": camera.dispersion, "response": camera.response,
    }  # fmt: skip
    other = SpectralCamera(**own | change(camera))
    return Snapshot(torch.rand(1, *other.snapshot_shape), other)


OTHERS = {
    "a mirrored mask": lambda camera: {"aperture": camera.codes()[0].flip(-1)},
    "a mask moved by a pixel": lambda camera: {"aperture": camera.codes()[0].roll(1, -2)},
    "bands in the opposite direction": lambda camera: {"dispersion": camera.dispersion.displacement[::-1]},
    "another response": lambda camera: {"response": torch.tensor([1.0, 1.0, 1.0, 1.01])},
    "two slots of full time": lambda camera: {
        "slots": 2, "exposure": "per-slot", "aperture": camera.codes()[0].repeat(2, 1, 1),
        "shutter": camera.codes()[1].repeat(2, 1, 1),
    },
}  # fmt: skip


@pytest.mark.parametrize("change", OTHERS)
def test_a_snapshot_of_another_camera_of_the_same_size_is_refused(exported, tmp_path, change):
    snapshot_of(exported[1], OTHERS[change]).save(tmp_path / "s.nc")
    with pytest.raises(DataError, match=r"s\.nc: found the codes, .* of another camera, .* tmca reconstruct"):
        decode_exported(exported[1], tmp_path / "s.nc", "torch")


def test_a_snapshot_without_some_pixels_is_refused(exported, tmp_path):
    gone = torch.zeros(SIZE[0], SIZE[1] + 3, dtype=torch.bool)
    gone[3, 7] = True
    taken = snapshot_of(exported[1])
    taken.notes[WITHHELD] = 1
    without_pixels(taken, gone).save(tmp_path / "s.nc")
    with pytest.raises(DataError, match="found withheld pixels"):
        decode_exported(exported[1], tmp_path / "s.nc", "torch")


def test_rounding_makes_no_other_camera(exported, tmp_path):
    def rounded(camera):
        aperture = camera.codes()[0]
        return {
            "aperture": aperture * (1 - 1e-6 * torch.rand(aperture.shape)),
            "response": camera.response * (1 - 1e-6),
        }

    snapshot_of(exported[1], rounded).save(tmp_path / "s.nc")
    assert decode_exported(exported[1], tmp_path / "s.nc", "torch").values.shape == (1, BANDS, *SIZE)


def test_the_command_checks_the_files_and_decodes_as_the_functions_do(exported, tmp_path, capsys):
    file, folder, _ = exported
    taken = snapshot_of(folder)
    taken.save(tmp_path / "s.nc")
    (row,) = answer(capsys, "decoder", "check", folder, "--run", file)
    assert row == {
        "format": "torch",
        "file": str(folder / "decoder.pt2"),
        "error": check_decoder(folder, file)[0].error,
    }
    assert "decoder.pt2: torch, differs from the network by" in said(capsys, "decoder", "check", folder, "--run", file)
    out = ("--out", tmp_path / "e.nc")
    assert said(capsys, "decoder", "run", folder, tmp_path / "s.nc", *out).startswith(f"{tmp_path / 'e.nc'}: torch")
    kept = (tmp_path / "e.nc").read_bytes()
    with xr.open_dataset(tmp_path / "e.nc") as written:
        np.testing.assert_array_equal(
            written["estimate"], decode_exported(folder, tmp_path / "s.nc", "torch").values[0]
        )
    assert "an existing output" in refused(capsys, "decoder", "run", folder, tmp_path / "s.nc", *out)
    said_of_formats = refused(capsys, "decoder", "export", file, "--out", tmp_path / "y", "--formats", "gif")
    assert "found gif, expected some of torch, onnx" in said_of_formats
    assert (tmp_path / "e.nc").read_bytes() == kept
    assert not (tmp_path / "y").exists()


def test_where_onnx_is_not_installed_the_other_file_is_written(exported, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("tmca.lab.deploy.find_spec", lambda name: None if name == "onnxruntime" else True)
    text = said(capsys, "decoder", "export", exported[0], "--out", tmp_path / "y")
    assert "pip install 'tmca[onnx]'" in text
    assert sorted(file.name for file in (tmp_path / "y").iterdir()) == ["decoder.json", "decoder.pt2"]


def test_a_trusted_file_computes_the_same_and_a_broken_one_is_refused(exported, tmp_path):
    checked, trusted = (load_exported(exported[1] / "decoder.pt2", trust) for trust in (False, True))
    snapshot = torch.rand(1, 1, SIZE[0], SIZE[1] + 3)
    torch.testing.assert_close(trusted(snapshot), checked(snapshot))
    (tmp_path / "decoder.pt2").write_text("broken")
    with pytest.raises(DataError, match=r"decoder\.pt2: found a file that cannot be read"):
        load_exported(tmp_path / "decoder.pt2", trust=True)


@pytest.mark.slow
def test_a_closed_pixel_of_a_large_camera_marks_its_codes():
    code = torch.rand(3, 2000, 2300, generator=torch.Generator().manual_seed(0))
    whole, blind = (Taps(values, (0, 1, 2), (0, 2, 4), 3, 2304) for values in (code, code.clone()))
    blind.code[:, 700, 900:903] = 0
    marks, others = np.array(code_marks(whole)), np.array(code_marks(blind))
    assert np.abs(marks - others).max() > 1e-5 * marks[0]


def test_a_run_of_other_bands_is_refused(exported, tmp_path):
    with pytest.raises(DataError, match=r"a snapshot of shape \(1, 1, 24, 23\), expected \(1, 1, 24, 24\)"):
        check_decoder(exported[1], written_weights(tmp_path, bands=3))
    weights = Weights.load(exported[0])
    weights.variables["wavelength"] = [wave + 5e-9 for wave in weights.wavelengths]
    (tmp_path / "weights.safetensors").unlink()
    with pytest.raises(DataError, match=r"bands from 505 to 565 nm \(4\), expected 500 to 560 nm"):
        check_decoder(exported[1], weights.save(tmp_path / "weights.safetensors"))


def about_of(folder, **changes):
    about = json.loads((folder / "decoder.json").read_text()) | changes
    return json.dumps({key: value for key, value in about.items() if value is not None})


@pytest.mark.parametrize("gone", ["read_noise", "scene", "codes", "files", "wavelengths_m", "snapshot"])
def test_a_description_without_one_of_its_parts_is_refused(exported, tmp_path, gone):
    (tmp_path / "decoder.json").write_text(about_of(exported[1], **{gone: None}))
    with pytest.raises(DataError, match=rf"decoder\.json: found (no )?entry {gone}"):
        check_decoder(tmp_path, exported[0])


@pytest.mark.parametrize(("name", "format"), [("decoder.json", "torch"), ("decoder.pt2", "torch")])
def test_a_broken_export_is_refused(exported, tmp_path, name, format):
    (tmp_path / "decoder.json").write_text(about_of(exported[1]))
    (tmp_path / name).write_text("broken")
    with pytest.raises(DataError, match=name):
        load_exported(decoder_file(tmp_path, format))


@pytest.mark.slow
def test_a_broken_export_is_told_of_in_one_line(tmp_path):
    (tmp_path / "decoder.pt2").write_text("broken")
    code = f"from tmca.lab.loading import load_exported; load_exported(r'{tmp_path / 'decoder.pt2'}')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "cannot be read" in done.stderr
    assert "Ran into the following error" not in done.stderr
