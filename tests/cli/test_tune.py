"""``tmca train --from`` as a user meets it, for every camera."""

import pytest
import torch

from tests.cli.calls import answer
from tests.training.test_tuning import system_of
from tmca.cameras import Snapshot
from tmca.cli import main
from tmca.data import rendered_light_field, write_dataset
from tmca.data.depth_scenes import load_spectral_depth
from tmca.data.fitting import at_bands, middle_of
from tmca.data.scenes import load_scene
from tmca.decoders import Weights
from tmca.tuning import prepared

SIZE = (24, 32)
UNROLLED = "decoder={kind: unrolled, stages: 1, widths: [4], blocks: 1, start: dagger}"
TWO_HEADS = "decoder={kind: two-headed, start: snapshot, widths: [6, 8], blocks: 1, window: 4}"
BENCH = "camera.bench={window: [11, 11], mask_pixels: 32}"
SMALL = ("camera.size=[24, 32]", "camera.slots=2", "camera.period=8", UNROLLED)
pytestmark = [
    pytest.mark.filterwarnings("ignore::tmca.optics.StrayLight"),
    pytest.mark.filterwarnings("ignore::tmca.optics.Undersampled"),
]


def train(kind, scene, *given):
    told = [word for one in (*given, "data.patch=16", "data.batch=2") for word in ("--set", one)]
    main(["train", kind, "--train", scene, "--preset", "quick", "--steps", "2", *told, "--accelerator", "cpu", "--out",
          "run"])  # fmt: skip


def capture(camera, *scene, name):
    with torch.no_grad():
        Snapshot(camera(*scene), camera).save(f"captures/{name}.nc")


@pytest.fixture(autouse=True)
def folder(tmp_path):
    (tmp_path / "captures").mkdir()
    return tmp_path


def tuned(capsys, folder):
    """What is said of fine-tuning on the captures, one held out, after which the decoder is used."""
    said = answer(capsys, "train", "--from", "run", "--captures", "captures", "--steps", "2", "--accelerator", "cpu",
                  "--out", "tuned", "--validation", "rocket")  # fmt: skip
    assert said["held_out"] == ["rocket"]
    assert {"psnr"} <= set(said["before"]) <= set(said["best"])
    decides = "score" if "score" in said["before"] else "psnr"
    assert float(f"{said['best'][decides]:.6g}") >= said["before"][decides]  # the log has six digits
    assert (folder / "tuned" / "before_after.png").exists()
    main(["reconstruct", "captures/coffee.nc", "--weights", "tuned", "--no-figures", "--out", "found.nc"])
    assert (folder / "found.nc").exists()
    return said


def windows_are_parts_of_the_whole(folder):
    """Windows of a capture give what the whole capture gives."""
    ready = prepared("run", "captures", validation=["rocket"])
    system = system_of(ready, folder / "system")
    system.eval()
    for one, other in zip(*(system.simulated.tensors(system.whole(1, side)) for side in (9, None)), strict=True):
        torch.testing.assert_close(one, other, atol=1e-4, rtol=1e-4)


@pytest.mark.slow
def test_a_spectral_decoder(capsys, folder):
    train("spectral", "chelsea", *SMALL, "data.bands=3")
    camera = Weights.load("run").camera_for(SIZE)
    for name in ("coffee", "rocket"):
        cube = at_bands(load_scene(name, bands=None), camera.wavelengths)[:, : SIZE[0], : SIZE[1]]
        capture(camera, torch.from_numpy(cube.values.copy())[None], name=name)
        write_dataset(cube.to_dataset(name="radiance"), folder / "captures" / f"{name}_truth.nc")
    assert tuned(capsys, folder)["calibration"] is None


def views_of(name):
    return rendered_light_field(name, views=3, size=SIZE)["light_field"]


@pytest.mark.slow
def test_a_light_field_decoder(capsys, folder):
    write_dataset(views_of("chelsea").to_dataset(name="light_field"), folder / "chelsea.nc")
    train("light-field", "chelsea.nc", *SMALL, "camera.views=3")
    camera = Weights.load("run").camera_for(SIZE)
    for name in ("coffee", "rocket"):
        field = views_of(name)
        capture(camera, torch.from_numpy(field.values.copy())[None], name=name)
        write_dataset(field.to_dataset(name="light_field"), folder / "captures" / f"{name}_truth.nc")
    tuned(capsys, folder)
    windows_are_parts_of_the_whole(folder)


@pytest.mark.slow
def test_a_spectral_depth_decoder(capsys, folder):
    train(
        "spectral-depth", "chelsea", "camera.size=[16, 16]", "camera.planes=3", "camera.period=2", "camera.slots=2",
        BENCH, "camera.filters=clear", "camera.channels=monochrome", "data.margin=0", TWO_HEADS,
    )  # fmt: skip
    camera = Weights.load("run").camera_for(SIZE)
    how = {"near": camera.planes.near, "far": camera.planes.far, "reduce": 4}
    for name in ("coffee", "rocket"):
        scene = middle_of(load_spectral_depth(name, camera.wavelengths, **how), SIZE, name)
        depth = torch.from_numpy(scene["depth"].values.copy())[None, None]
        capture(camera, torch.from_numpy(scene["radiance"].values.copy())[None], depth.float(), name=name)
        write_dataset(scene, folder / "captures" / f"{name}_truth.nc")
    assert tuned(capsys, folder)["best"]["depth_mae"] > 0
    windows_are_parts_of_the_whole(folder)
