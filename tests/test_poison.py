"""Files that hold code: nothing of it runs, and each is refused in one line or read without it."""

import io
import json
import os
import pickle
import shutil
import warnings
import zipfile

import h5py
import numpy as np
import pytest
import tifffile
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file
from scipy.io import savemat
from scipy.io.matlab import MatlabObject

from tests.fuzz.kinds_lab import _capture, _export
from tests.lab.test_deploy import written_weights
from tmca.data import describe, read, read_array
from tmca.data.files import read_dataset
from tmca.decoders import Weights
from tmca.errors import DataError, TmcaError
from tmca.lab.acquisition.captures import read_captures
from tmca.lab.calibration.file import load_calibration
from tmca.lab.deploy import export_decoder
from tmca.lab.display.manifest import NAME, read_export
from tmca.lab.loading import load_exported
from tmca.training.checkpoints import _STATE, _TENSORS, load_latest


class Bomb:
    """Its pickle makes a file when it is read."""

    def __init__(self, marker):
        self.marker = str(marker)

    def __reduce__(self):
        return os.mkdir, (self.marker,)


@pytest.fixture
def marker(tmp_path):
    """What code in a file would make; it is not there after the test."""
    place = tmp_path / "code-ran"
    yield place
    assert not place.exists()


def refused(read, path, error=TmcaError):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with pytest.raises(error) as caught:
            read(path)
    assert "\n" not in str(caught.value)
    assert path.name in str(caught.value)
    return str(caught.value)


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """A good decoder.pt2."""
    folder = tmp_path_factory.mktemp("exported")
    export_decoder(written_weights(folder, kind="unet"), folder / "out", ("torch",))
    return folder / "out" / "decoder.pt2"


def torch_pickle(marker):
    content = io.BytesIO()
    torch.save(Bomb(marker), content)
    return content.getvalue()


def changed(source, target, changes, added=None):
    """An archive with other contents of some members; ``changes`` takes and gives bytes by the end of a name."""
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        root = old.namelist()[0].partition("/")[0]
        for name in old.namelist():
            change = next((one for end, one in changes.items() if name.endswith(end)), bytes)
            new.writestr(name, change(old.read(name)))
        for name, content in (added or {}).items():
            new.writestr(f"{root}/{name}", content)
    return target


def test_the_bomb_does_go_off(tmp_path):
    pickle.loads(pickle.dumps(Bomb(tmp_path / "ran")))
    assert (tmp_path / "ran").exists()


def test_sample_inputs_of_a_decoder_are_not_unpickled(exported, tmp_path, marker):
    poisoned = changed(exported, tmp_path / "decoder.pt2", {"sample_inputs/model.pt": lambda _: torch_pickle(marker)})
    snapshot = torch.rand(1, *load_exported(exported).shape[1:])
    torch.testing.assert_close(load_exported(poisoned)(snapshot), load_exported(exported)(snapshot))
    with pytest.raises(TmcaError):  # torch.export.load runs it, and then finds no inputs
        load_exported(poisoned, trust=True)
    assert marker.exists()
    marker.rmdir()


REPLACED = {
    "weights pickled": ("weights_config.json", b'"use_pickle": false', b'"use_pickle": true', "use_pickle"),
    "constants pickled": ("constants_config.json", b'"use_pickle": false', b'"use_pickle": true', "use_pickle"),
    "a pickled object": ("constants_config.json", b'"tensor_0"', b'"opaque_obj_0"', "no tensor"),
    "a scripted object": ("constants_config.json", b'"tensor_0"', b'"custom_obj_0"', "no tensor"),
    "a Python function": ("model.json", b'"torch.ops.aten.mul.Tensor"', b'"os.system"', "operator 'os.system'"),
    "a file mapped": ("model.json", b"torch.ops.aten.mul.Tensor", b"torch.ops.aten.from_file.default", "from_file"),
    "another library": ("model.json", b"torch.ops.aten.mul.Tensor", b"torch.ops.mine.mul.Tensor", "torch.ops.mine"),
    "an expression": ("model.json", b'{"as_int": 1}', b'{"as_sym_int": {"as_expr": {"expr_str": "exit()"}}}', "entry"),
}


@pytest.mark.parametrize("name", REPLACED)
def test_a_decoder_that_holds_more_than_tensors_and_operators_is_refused(exported, tmp_path, marker, name):
    end, before, after, words = REPLACED[name]
    bomb = torch_pickle(marker)
    added = {f"data/constants/{kind}_obj_0": pickle.dumps(Bomb(marker)) for kind in ("opaque", "custom")}
    pickled = {"weights pickled": "weights/weight_0", "constants pickled": "constants/tensor_0"}.get(name, "-")
    changes = {end: lambda text: text.replace(before, after), pickled: lambda _: bomb}
    poisoned = changed(exported, tmp_path / "decoder.pt2", changes, added)
    assert words in refused(load_exported, poisoned, DataError)


@pytest.mark.parametrize("name", ["data/weights/model.pt", "data/constants/model.pt", "data/aotinductor/model/a.so"])
def test_older_and_compiled_parts_of_a_decoder_are_never_looked_at(exported, tmp_path, marker, name):
    poisoned = changed(exported, tmp_path / "decoder.pt2", {}, {name: torch_pickle(marker)})
    load_exported(poisoned)


def test_guards_of_a_decoder_are_not_executed(exported, tmp_path, marker):
    code = f"\"guards_code\": [\"__import__('os').mkdir('{marker}')\"]".encode()
    poisoned = changed(
        exported, tmp_path / "decoder.pt2", {"model.json": lambda text: text.replace(b'"guards_code": []', code)}
    )
    load_exported(poisoned)


@pytest.mark.parametrize("name", ["decoder.pt2", "weights.safetensors", "scene.nc", "scene.mat", "scene.npy"])
def test_a_pickle_of_another_name_is_refused(tmp_path, marker, name):
    path = tmp_path / name
    path.write_bytes(torch_pickle(marker) if name == "decoder.pt2" else pickle.dumps(Bomb(marker)))
    readers = {".pt2": load_exported, ".safetensors": Weights.load}
    refused(readers.get(path.suffix, read), path)


@pytest.mark.parametrize("name", ["scene.npy", "scene.npz"])
def test_arrays_of_objects_are_not_unpickled(tmp_path, marker, name):
    objects = np.array([Bomb(marker)], dtype=object)
    save = np.save if name.endswith("npy") else np.savez
    save(tmp_path / name, objects)
    refused(read, tmp_path / name)
    refused(read_array, tmp_path / name)


def test_codecs_of_zarr_are_not_imported(tmp_path, marker):
    folder = tmp_path / "scene.zarr"
    array = folder / "cube"
    array.mkdir(parents=True)
    (folder / ".zgroup").write_text('{"zarr_format": 2}')
    about = {
        "zarr_format": 2, "shape": [3, 4, 5], "chunks": [3, 4, 5], "dtype": "|O", "fill_value": None, "order": "C",
        "compressor": None, "filters": [{"id": "pickle", "protocol": 5}],
    }  # fmt: skip
    (array / ".zarray").write_text(json.dumps(about))
    (array / ".zattrs").write_text('{"_ARRAY_DIMENSIONS": ["wavelength", "y", "x"]}')
    (array / "0.0.0").write_bytes(pickle.dumps([Bomb(marker), [60], "|O"]))
    refused(read, folder)


def in_another_file(folder, how):
    """A file whose cube, of 0.25, lies in another one."""
    with h5py.File(folder / "secret.h5", "w") as file:
        file["cube"] = np.full((3, 4, 5), 0.25)
    (folder / "raw").write_bytes(np.full((3, 4, 5), 0.25).tobytes())
    (folder / "in").mkdir()
    layout = h5py.VirtualLayout((3, 4, 5), "f8")
    layout[:] = h5py.VirtualSource(str(folder / "secret.h5"), "cube", (3, 4, 5))
    with h5py.File(folder / "in" / "scene.h5", "w") as file:
        file["wavelengths"] = [500.0, 550.0, 600.0]
        if how == "a link":
            file["cube"] = h5py.ExternalLink("../secret.h5", "cube")
        elif how == "virtual":
            file.create_virtual_dataset("cube", layout)
        else:
            file.create_dataset("cube", (3, 4, 5), "f8", external=[(str(folder / "raw"), 0, h5py.h5f.UNLIMITED)])
    return folder / "in" / "scene.h5"


@pytest.mark.parametrize("how", ["a link", "virtual", "external storage"])
@pytest.mark.parametrize("suffix", [".h5", ".mat", ".nc"])
def test_hdf5_files_take_no_numbers_from_others(tmp_path, how, suffix):
    path = in_another_file(tmp_path, how).rename(tmp_path / "in" / f"scene{suffix}")
    assert "in another file" in refused(read, path, DataError)
    assert "in another file" in refused(describe, path, DataError)


@pytest.mark.parametrize("how", ["a link", "virtual", "external storage"])
def test_labelled_files_take_no_numbers_from_others(tmp_path, how):
    path = in_another_file(tmp_path, how).rename(tmp_path / "in" / "taken.nc")
    assert "in another file" in refused(read_dataset, path, DataError)
    assert "in another file" in refused(load_calibration, path, DataError)


@pytest.mark.parametrize("kind", ["object", "cells"])
def test_objects_of_matlab_are_no_cubes(tmp_path, marker, kind):
    said = np.array([(f"system('mkdir {marker}')",)], dtype=[("expr", object)])
    stored = {
        "object": MatlabObject(said, "inline"),
        "cells": np.array([pickle.dumps(Bomb(marker)), f"mkdir {marker}"], dtype=object),
    }[kind]
    path = tmp_path / "scene.mat"
    savemat(path, {"cube": stored})
    refused(read, path, DataError)


def test_entities_of_xml_are_not_expanded(tmp_path):
    path = tmp_path / "scene.ome.tif"
    tifffile.imwrite(path, np.random.default_rng(0).random((3, 4, 5), dtype=np.float32), ome=True)
    laughs = "".join(f'<!ENTITY a{n} "{f"&a{n - 1};" * 10 if n else "ha" * 10}">' for n in range(10))
    said = f'<?xml version="1.0"?><!DOCTYPE OME [{laughs}]><OME xmlns="http://www.openmicroscopy.org">&a9;</OME>'
    tifffile.tiffcomment(path, said)
    refused(read, path)


def test_the_state_of_a_training_is_not_unpickled(tmp_path, marker):
    network, path = torch.nn.Linear(2, 2), tmp_path / "run" / "0000001"
    path.mkdir(parents=True)
    (path / _STATE).write_text("{}")
    (path / _TENSORS).write_bytes(pickle.dumps(Bomb(marker)))
    optimizers = {"network": torch.optim.Adam(network.parameters())}
    refused(lambda _: load_latest(path.parent, network, optimizers), path)


def test_tensors_of_onnx_lie_in_no_other_file(tmp_path):
    onnx = pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    (tmp_path / "secret").write_bytes(np.full(4, 0.25, np.float32).tobytes())
    (tmp_path / "in").mkdir()
    weights = onnx.numpy_helper.from_array(np.zeros(4, np.float32), "weights")
    onnx.external_data_helper.set_external_data(weights, "../secret")
    weights.ClearField("raw_data")
    weights.data_location = onnx.TensorProto.EXTERNAL
    taken, out = (onnx.helper.make_tensor_value_info(name, 1, [4]) for name in ("snapshot", "out"))
    add = onnx.helper.make_node("Add", ["snapshot", "weights"], ["out"])
    model = onnx.helper.make_model(onnx.helper.make_graph([add], "decoder", [taken], [out], [weights]))
    path = tmp_path / "in" / "decoder.onnx"
    path.write_bytes(model.SerializeToString())
    assert "other files" in refused(load_exported, path, DataError)


ELSEWHERE = ["../secret.png", "/etc/passwd", "a/../../secret.png", "..", "a\\..\\..\\secret.png"]
OUTSIDE = [*ELSEWHERE, "C:/secret.png", ""]


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    """A good export."""
    _export(tmp_path_factory.mktemp("shown") / "export")
    return next(tmp_path_factory.getbasetemp().glob("shown*/export"))


@pytest.mark.parametrize("path", OUTSIDE)
@pytest.mark.parametrize("entry", ["a frame", "a response"])
def test_paths_of_a_manifest_stay_inside(shown, tmp_path, path, entry):
    folder = shutil.copytree(shown, tmp_path / "export")
    about = json.loads((folder / NAME).read_text())
    if entry == "a frame":
        about["planes"][0]["frames"][0]["file"] = path
    else:
        about["planes"][0]["device"]["lut"] = path
    (folder / NAME).write_text(json.dumps(about))
    assert "inside its folder" in refused(lambda file: read_export(file.parent), folder / NAME, DataError)


@pytest.mark.parametrize("path", ELSEWHERE)
def test_frames_of_a_capture_lie_beside_its_list(tmp_path, path):
    _capture(tmp_path / "capture")
    file = tmp_path / "capture" / "captures.json"
    record = json.loads(file.read_text())
    record["frames"][path] = record["frames"]["slot_000"]
    file.write_text(json.dumps(record))
    assert "beside it" in refused(lambda one: read_captures(one.parent), file, DataError)


@pytest.mark.parametrize("path", ELSEWHERE)
def test_the_prior_of_weights_lies_beside_them(tmp_path, path):
    file = written_weights(tmp_path, kind="unet")
    with safe_open(file, "pt") as opened:
        head = opened.metadata()
    said = json.loads(head["tmca"]) | {"prior": path}
    save_file(load_file(file), file, head | {"tmca": json.dumps(said)})
    assert "beside it" in refused(Weights.load, file, DataError)
