"""Exported decoders compute what the network does, and need nothing of the package."""

import json
import subprocess
import sys

import pytest
import torch

from tmca.cameras import Snapshot
from tmca.decoders import Weights, build_network
from tmca.errors import DataError, OutputError, SettingError
from tmca.lab.exported_decoder import check_decoder, decode_exported, decoder_file, export_decoder, load_exported

SIZE, BANDS = (24, 21), 4


def written_weights(folder, start="dagger", kind="unrolled", dispersion=1.0):
    torch.manual_seed(0)
    settings = {"stages": 2, "blocks": 1} if kind == "unrolled" else {}
    network = build_network(kind, bands=BANDS, start=start, widths=(8, 8), **settings)
    for parameter in network.parameters():  # an untrained one returns its start
        torch.nn.init.normal_(parameter, 0.0, 0.05)
    mask = torch.rand(1, *SIZE, generator=torch.Generator().manual_seed(1))
    wide = SIZE[1] + 3
    camera = {"size": list(SIZE), "period": None, "exposure": "equal", "dispersion": dispersion, "disperser": "single"}
    card = {"training": {"noise": [{"read_noise": 0.02, "full_well": 5000.0}]}}
    waves = (5e-7, 5.2e-7, 5.4e-7, 5.6e-7)
    weights = Weights(network, waves, mask, torch.ones(1, SIZE[0], wide), camera, "", card)
    return weights.save(folder / "weights.safetensors")


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """The weights' file and the folder of their torch export."""
    folder = tmp_path_factory.mktemp("exported")
    file = written_weights(folder)
    return file, folder / "out", export_decoder(file, folder / "out", ("torch",))


def test_the_torch_file_is_the_network(exported):
    file, folder, found = exported
    assert [one.format for one in found] == ["torch"]
    assert found[0].error < 1e-5
    assert check_decoder(folder, file)[0].error < 1e-5


def test_a_grey_mask_stays_grey_in_the_weights(exported):
    aperture = Weights.load(exported[0]).aperture
    torch.testing.assert_close(aperture, torch.rand(1, *SIZE, generator=torch.Generator().manual_seed(1)))


def test_it_decodes_as_the_package_does(exported, tmp_path):
    from tmca.decoders import decode

    file, folder, _ = exported
    weights = Weights.load(file)
    about = json.loads((folder / "decoder.json").read_text())
    camera = weights.spectral_camera()
    camera.sensor.read_noise, camera.sensor.full_well = 0.02, 5000.0
    taken = Snapshot(camera.A(torch.rand(1, BANDS, *SIZE)), camera)
    taken.save(tmp_path / "s.nc")
    cube, seconds = decode_exported(folder, tmp_path / "s.nc", "torch")
    wanted = decode(taken, "network", weights=weights).estimate
    torch.testing.assert_close(torch.from_numpy(cube.values)[None], wanted, atol=1e-4, rtol=1e-4)
    assert seconds > 0
    assert about["snapshot"] == list(taken.values.shape)


def test_it_runs_without_the_package(exported, tmp_path):
    code = (
        f"import torch, sys; program = torch.export.load(r'{exported[1] / 'decoder.pt2'}').module()\n"
        f"print(tuple(program(torch.ones(1, 1, {SIZE[0]}, {SIZE[1] + 3})).shape), 'tmca' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path, check=True)
    assert done.stdout.strip() == f"(1, {BANDS}, {SIZE[0]}, {SIZE[1]}) False"


def test_onnx_is_the_network_too(tmp_path):
    for package in ("onnx", "onnxscript", "onnxruntime"):
        pytest.importorskip(package)
    file = written_weights(tmp_path, start="adjoint")
    found = export_decoder(file, tmp_path / "out", ("onnx",))
    assert found[0].error < 1e-4
    assert check_decoder(tmp_path / "out", file)[0].error < 1e-4


def test_what_cannot_stand_alone_is_refused(exported, tmp_path):
    with pytest.raises(SettingError, match="starts from lmmse, expected one that starts from adjoint or dagger"):
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
    camera = Weights.load(exported[0]).spectral_camera()
    from tmca.cameras import SpectralCamera

    other = SpectralCamera(bands=camera.wavelengths, size=(20, 21), slots=1, shutter="open")
    Snapshot(torch.rand(1, *other.snapshot_shape), other).save(tmp_path / "s.nc")
    with pytest.raises(DataError, match=r"\(1, 1, 20, 24\), expected \(1, 1, 24, 24\)"):
        decode_exported(exported[1], tmp_path / "s.nc", "torch")
    with pytest.raises(SettingError, match="one of torch"):
        decode_exported(exported[1], tmp_path / "s.nc", "onnx")


@pytest.mark.parametrize(("name", "format"), [("decoder.json", "torch"), ("decoder.pt2", "torch")])
def test_a_broken_export_is_refused(tmp_path, name, format):
    (tmp_path / "decoder.json").write_text(
        '{"files": [{"format": "torch", "file": "decoder.pt2"}], "snapshot": [1, 1, 8, 9], "wavelengths_m": [4e-7]}'
    )
    (tmp_path / name).write_text("broken")
    with pytest.raises(DataError, match=name):
        load_exported(decoder_file(tmp_path, format))
