"""What tab completion offers: the public names of the package and of its rooms, loaded or not."""

import subprocess
import sys
from importlib import import_module

import pytest

import tmca

ROOMS = [name for name in dir(tmca) if name in tmca._ROOMS]


def test_the_package_offers_its_face_and_its_rooms():
    expected = {"read", "simulate", "reconstruct", "evaluate", "view", "Snapshot", "Estimate", "dbd", "adapters"}
    assert expected <= {*dir(tmca)}
    assert [name for name in dir(tmca) if name.startswith("_")] == ["__version__"]
    for name in dir(tmca):
        assert getattr(tmca, name) is not None


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_offers_what_it_exports_and_has_it(room):
    module = import_module(f"tmca.{room}")
    assert dir(module) == sorted(dir(module))
    assert len(dir(module)) > 0
    for name in dir(module):
        assert not name.startswith("_")
        assert getattr(module, name) is not None
    assert dir(module) == sorted(module.__all__)


def test_a_name_that_is_not_there_is_refused():
    for module in (tmca, tmca.dbd, tmca.evaluation, tmca.adapters):
        with pytest.raises(AttributeError, match="nothing_like_it"):
            module.nothing_like_it  # noqa: B018


def test_completion_loads_nothing_heavy():
    code = "import sys, tmca; dir(tmca); print('torch' in sys.modules, 'xarray' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False"]
