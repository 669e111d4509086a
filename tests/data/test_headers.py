"""What headers say is what is read."""

import numpy as np
import pytest

from tmca.data import label, label_light_field, read_scene, rendered_scene, write_dataset, write_light_field
from tmca.data.fitting import usual_span
from tmca.data.headers import view_size_of, wavelengths_of
from tmca.data.in_memory import SceneWarning
from tmca.errors import DataError


def test_bands_and_sizes_are_those_that_are_read(tmp_path):
    file = tmp_path / "cube.nc"
    write_dataset(label(np.ones((5, 20, 24), np.float32), np.linspace(4e-7, 7e-7, 5)).to_dataset(name="cube"), file)
    assert wavelengths_of(str(file)) == pytest.approx(read_scene(file, bands=None)["wavelength"].values)
    small = rendered_scene("coffee", size=(20, 24))["radiance"]
    assert wavelengths_of("coffee") == pytest.approx(small["wavelength"].values)
    field = tmp_path / "field.nc"
    write_light_field(label_light_field(np.ones((3, 3, 21, 30), np.float32)), field)
    assert view_size_of(str(field), scale=2) == (10, 15)
    assert view_size_of("coffee:3") == view_size_of("coffee")
    with pytest.raises(DataError, match="expected a light field"):
        view_size_of(str(file))
    with pytest.raises(DataError, match="no such"):
        wavelengths_of("cofee")


@pytest.mark.parametrize(
    ("scenes", "span"),
    [
        ({"a": (400, 700)}, None),
        ({"a": (405, 695)}, None),  # half a band less
        ({"a": (380, 1000), "b": (400, 720)}, None),
        ({"a": (430, 720)}, (430, 700)),  # the rendered scenes have these
        ({"a": (600, 1000)}, (600, 1000)),
        ({"a": (600, 1000), "b": (400, 900)}, (600, 900)),
    ],
)
@pytest.mark.filterwarnings("ignore::tmca.data.in_memory.SceneWarning")
def test_the_usual_range_is_what_all_cover(scenes, span):
    found = usual_span({name: np.linspace(*ends, 11) * 1e-9 for name, ends in scenes.items()})
    assert found == (None if span is None else pytest.approx([nm * 1e-9 for nm in span]))


def test_another_range_is_said_and_scenes_that_share_none_are_refused():
    with pytest.warns(SceneWarning, match="from 700 to 1000 nm, which a covers"):
        usual_span({"a": np.linspace(7e-7, 1e-6, 5)})
    with pytest.raises(DataError, match="b: found bands from 400 to 600 nm, expected some beyond the 700 nm of a"):
        usual_span({"a": np.linspace(7e-7, 1e-6, 5), "b": np.linspace(4e-7, 6e-7, 5)})
