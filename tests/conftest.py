"""Fixtures that every room's tests share."""

from __future__ import annotations

import os
from collections.abc import Iterator
from functools import lru_cache, wraps
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import pytest
import torch

_LONGEST = ("test_kill_table.py", "test_readme.py")
_APART = ("test_every_decoder.py",)
"""Files of long tests that share nothing."""
_PROVOKED = ("tmca.optics.StrayLight", "tmca.optics.Undersampled", "tmca.lab.quality.Doubtful")
"""Warnings of masks of few pixels and of short captures, which tests use everywhere; those of them ask for them by
``pytest.warns``, those of the command line read its lines."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests in a browser are slow. Files with slow tests come first, the longest before all: no worker waits for
    another at the end."""
    for item in items:
        if "browser" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.slow)
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: (item.path.name not in _LONGEST, item.path not in slow))
    ignored = pytest.mark.filterwarnings(*(f"ignore::{name}" for name in _PROVOKED))
    for item in items:
        if item.path.parent.name != "cli":
            item.add_marker(ignored, append=False)  # before the test's own, which have the last word


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """A worker takes the tests of a file one after the other: what they share is made once."""
    from xdist.scheduler import LoadScopeScheduling

    class ByFile(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = nodeid.partition("::")[0]
            return nodeid if file.endswith(_APART) else file

    config.option.loadscopereorder = False
    return ByFile(config, log)


@pytest.fixture(autouse=True)
def own_decoders_go() -> Iterator[None]:
    """Decoders of files that a test names are gone after it: others go through all that there are."""
    from tmca.decoders import DECODERS

    before = set(DECODERS)
    yield
    for name in set(DECODERS) - before:
        if not DECODERS[name].__module__.startswith("tmca.decoders"):
            DECODERS.pop(name)


@pytest.fixture(autouse=True)
def seeded() -> None:
    """Every test draws the same numbers whichever ran before it."""
    torch.manual_seed(0)


@pytest.fixture(scope="session", autouse=True)
def rendered_once() -> Iterator[None]:
    """Photographs are rendered once for all tests of a worker, which use the same few again and again."""
    from tmca.data.rendering import light_field, scene

    render, render_views = scene._render, light_field._render

    @lru_cache(maxsize=8)
    def kept(entry: Any, seed: int, crop: tuple[tuple[int, int], ...], bands: bytes, shape: Any, *how: Any) -> Any:
        found = render(entry, seed, tuple(slice(*ends) for ends in crop), np.frombuffer(bands).reshape(shape), *how)
        found[0].flags.writeable = False
        return found

    def copied(entry: Any, seed: int, crop: tuple[slice, slice], bands: Any, *how: Any) -> Any:
        ends = tuple((part.start, part.stop) for part in crop)
        spectral, depth = kept(entry, seed, ends, bands.tobytes(), bands.shape, *how)
        return spectral, depth.copy()  # what reads the large one copies it

    kept_views = lru_cache(maxsize=4)(render_views)

    def copied_views(entry: Any, seed: int, views: int, frame: Any, disparity: Any, colour: bool) -> Any:
        found = kept_views(entry, seed, views, tuple(frame), tuple(disparity), colour)
        return tuple(part.copy() for part in found)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scene, "_render", wraps(render)(copied))
        patch.setattr(light_field, "_render", wraps(render_views)(copied_views))
        yield


@pytest.fixture
def rendered_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every scene of a test is rendered for it."""
    from tmca.data.rendering import light_field, scene

    for module in (scene, light_field):
        monkeypatch.setattr(module, "_render", module._render.__wrapped__)


@pytest.fixture(scope="session", autouse=True)
def no_flushing() -> Iterator[None]:
    """Files of tests need not outlive a power cut."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda handle: None)
        yield


@pytest.fixture
def small_mixtures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mixtures of few kinds, learned in a moment, where it does not matter how good they are."""
    from tmca.priors import GaussianMixturePrior

    few = {"kinds": 3, "rank": 20, "gains": 2, "samples": 2000}
    monkeypatch.setattr(GaussianMixturePrior, "settings_of_views", few)
    for name, value in few.items():
        monkeypatch.setitem(GaussianMixturePrior.learn.__func__.__kwdefaults__, name, value)


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real captures and cubes beside the checkout (or ``TMCA_DATA``); skips where it is missing."""
    folder = Path(os.environ.get("TMCA_DATA", Path(__file__).parents[2] / "shared" / "data"))
    if not (folder / "README.md").exists():
        pytest.skip(f"no real data at {folder} (set TMCA_DATA to the folder that holds hsi/, cassi/, splits/)")
    return folder
