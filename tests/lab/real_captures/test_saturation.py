"""Saturated pixels of real captures: kept and told of, or withheld from the data and from the operator alike."""

import numpy as np
import pytest
import torch

from studies.real.merit import prediction_error, withheld
from studies.real.movies import moving_part
from tests.lab.real_captures.bench import DESCRIBED, SHUTTERED, captured, mask_of, prototype_of, smooth_scene, write_mat
from tmca.cameras import Snapshot
from tmca.decoders import decode
from tmca.decoders.space_time import frame_operator
from tmca.errors import DataError, SettingError
from tmca.lab.importing import import_capture, without_pixels
from tmca.lab.prototype import load_prototype
from tmca.lab.quality import Doubtful


def dispersed(folder, saturation, size=(9, 12)):
    mask, scene = mask_of(*size), smooth_scene(4, *size)
    values = 0.1 + 0.2 * captured(scene, mask)
    files = write_mat(folder / "capture.mat", y=values), write_mat(folder / "mask.mat", mask=mask)
    return files, prototype_of(folder, DESCRIBED, saturation=saturation), values


def shuttered(folder, saturation, size=(6, 7)):
    rng = np.random.default_rng(0)
    shutter = (rng.integers(8, size=(*size, 1)) == np.arange(8)).astype(np.uint8)
    values = rng.uniform(10, 250, size)
    own = prototype_of(folder, SHUTTERED, saturation=saturation)
    return (write_mat(folder / "c.mat", a=values, s=shutter), None), own, values


@pytest.mark.parametrize(
    ("make", "saturation", "size"),
    [
        (dispersed, 0.22, (9, 12)), (dispersed, 0.22, (10, 13)), (shuttered, 180.0, (6, 7)), (shuttered, 180.0, (7, 8)),
    ],
)  # fmt: skip
def test_withheld_pixels_see_nothing_and_all_others_what_they_saw(tmp_path, make, saturation, size):
    (capture, mask), own, values = make(tmp_path, saturation, size)
    how = {"name": "one"} if mask is None else {}
    with pytest.warns(Doubtful, match=f"{(values >= saturation).mean():.2%} of the pixels are saturated") as told:
        kept = import_capture(capture, own, mask, **how)
    assert len(told) == 1
    gone = import_capture(capture, own, mask, **how, withhold_saturated=True)
    bad = values >= saturation
    assert 0 < bad.sum() < bad.size
    assert gone.notes["saturated_pixels"] == kept.notes["saturated_pixels"] == bad.sum()
    assert gone.notes["saturated_share"] == pytest.approx(bad.mean())
    assert (gone.notes["saturated_withheld"], kept.notes["saturated_withheld"]) == (1, 0)
    imaged = [taken.camera.A(torch.rand(1, *taken.camera.scene_shape, generator=torch.Generator().manual_seed(1)))
              for taken in (kept, gone)]  # fmt: skip
    for y in range(values.shape[0]):
        for x in range(values.shape[1]):
            for before, after in ((kept.values, gone.values), imaged):
                assert float(after[0, 0, y, x]) == (0 if bad[y, x] else float(before[0, 0, y, x]))
    gone.save(tmp_path / "gone.nc")
    torch.testing.assert_close(Snapshot.load(tmp_path / "gone.nc").camera.codes()[1], gone.camera.codes()[1])


@pytest.mark.parametrize("make", [dispersed, shuttered])
def test_pixels_whose_saturation_is_not_known_cannot_be_withheld(tmp_path, make):
    (capture, mask), own, _ = make(tmp_path, None)
    how = {"name": "one"} if mask is None else {}
    with pytest.raises(SettingError, match="--withhold-saturated: found no saturation in the prototype"):
        import_capture(capture, own, mask, **how, withhold_saturated=True)
    assert "saturated_share" not in import_capture(capture, own, mask, **how).notes


def test_a_capture_without_any_pixel_left_is_refused(tmp_path):
    (capture, _), own, _ = shuttered(tmp_path, 10.001)
    with pytest.raises(DataError, match=r"c\.mat: found nothing below the saturation"):
        import_capture(capture, own, name="one", withhold_saturated=True)


@pytest.mark.slow
def test_withholding_saturated_wine_hardly_helps_the_pixels_that_are_not(real_data):
    """Figures of docs/real-captures.md: errors of predicted pixels below saturation, of all and of moving ones."""
    name, share, kept, gone = "opt", 0.162, (0.0228, 0.0362), (0.0229, 0.0331)
    file, own = real_data / "cassi" / "pixel_shutter_wine" / "wine.mat", load_prototype("pixel-shutter-wine")
    taken = import_capture(file, own, name=name)
    bad = import_capture(file, own, name=name, withhold_saturated=True).camera.codes()[1].amax(0) == 0
    assert taken.notes["saturated_share"] == pytest.approx(share, abs=5e-4)
    operator, (blind, hidden), moving = frame_operator(taken.camera, 16), withheld(taken), moving_part(taken)
    for shown, wanted in ((blind, kept), (without_pixels(blind, bad), gone)):
        guessed = decode(shown, "kriging", frames=16).values
        found = [prediction_error(operator, guessed, taken.values, hidden & ~bad & part)
                 for part in (torch.ones_like(bad), moving)]  # fmt: skip
        assert found == pytest.approx(wanted, abs=4e-4)
    assert float(operator.A(guessed)[0, 0][bad].mean()) < 0.97 * float(taken.values[0, 0][bad].mean())
