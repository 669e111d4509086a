"""A prior in a package of its own, as CONTRIBUTING.md shows it: every command knows it."""

import json
import re
import sys
from pathlib import Path

import pytest
import torch

from tests.plugin_packages import install
from tests.priors import test_conformance
from tmca import SpectralCamera, read
from tmca.cli import main
from tmca.errors import SettingError
from tmca.plugins import BrokenPlugin, load_plugins
from tmca.priors import Prior, find_prior, learn_prior, load_prior, prior_kinds

SOURCE = re.search(r"```python\n# my_package/flat_prior.py\n(.*?)```", Path("CONTRIBUTING.md").read_text(), re.S)[1]

OWN = re.search(r"```python\n# my_package/levels.py\n(.*?)```", Path("CONTRIBUTING.md").read_text(), re.S)[1]
USE = re.search(r"```python\nimport my_package.flat_prior.*?\n(.*?)```", Path("CONTRIBUTING.md").read_text(), re.S)[1]


@pytest.fixture
def installed(tmp_path, monkeypatch):
    monkeypatch.setattr(Prior, "kinds", dict(Prior.kinds))
    monkeypatch.chdir(tmp_path)
    yield lambda source: install(tmp_path, monkeypatch, "tmca.priors", "flat_prior", source)
    sys.modules.pop("flat_prior", None)
    monkeypatch.undo()
    load_plugins.cache_clear()


@pytest.mark.slow
def test_it_is_learned_read_and_reconstructs(installed, capsys):
    installed(SOURCE)
    scene = read("coffee", bands=3, size=(32, 40))
    learned = learn_prior([scene], SpectralCamera(bands=3), "flat", block=(4, 10))
    learned.save("flat.nc")
    Prior.kinds.pop("flat")  # as in another process
    sys.modules.pop("flat_prior")
    load_plugins.cache_clear()
    assert load_prior("flat.nc").kind == "flat"
    main(["inspect", "flat.nc"])
    assert "flat prior of scene blocks" in capsys.readouterr().out
    main(["prior", "show", "flat.nc"])
    main(["prior", "expect", "flat.nc", "--slots", "2", "--read-noise", "0.01"])
    assert "expected PSNR" in capsys.readouterr().out
    main(["simulate", "spectral", "coffee", "--bands", "3", "--crop", "24x24", "--no-figures", "--out", "s.nc"])
    main(["reconstruct", "s.nc", "--prior", "flat.nc", "--no-figures", "--out", "e.nc", "--json"])
    assert json.loads(capsys.readouterr().out.partition("{")[2].join(("{", "")))


def test_one_of_another_form_is_drawn(installed, capsys):
    installed(OWN)
    learn_prior([read("coffee", bands=3, size=(32, 40))], SpectralCamera(bands=3), "levels").save("levels.nc")
    main(["prior", "show", "levels.nc"])
    assert Path("levels.png").read_bytes().startswith(b"\x89PNG")


def test_one_of_another_form_conforms(installed, tmp_path):
    installed(OWN)
    assert "levels" in prior_kinds()
    test_conformance.test_it_comes_back_from_its_file("levels", tmp_path)
    test_conformance.test_samples_are_blocks_and_the_seed_alone_decides_them("levels")
    test_conformance.test_it_is_drawn_and_says_what_it_is("levels")
    test_conformance.test_no_samples_are_refused("levels")
    test_conformance.test_cameras_of_other_bands_or_views_are_refused("levels")


@pytest.mark.parametrize("part", ["called", "learned_by", "dimensions"])
def test_one_without_a_part_is_told_which(part):
    parts = {"kind": "bare", "called": "a bare prior", "learned_by": "nobody", "dimensions": {"low": ("band",)}}
    with pytest.raises(SettingError, match="give the class one") as refusal:
        type("Bare", (Prior,), {**parts, part: ""})
    assert refusal.value.where.endswith(f"Bare.{part}")
    assert "bare" not in Prior.kinds


@pytest.mark.slow
def test_it_is_used_as_contributing_shows(installed):
    installed(SOURCE)
    shown = {}
    exec(USE, shown)
    assert shown["estimate"].values.shape == (1, 6, 64, 64)


def test_one_that_was_edited_is_learned_anew_from_the_rendered_scenes(installed, tmp_path, monkeypatch):
    def render(name, wavelengths, size):
        return read("coffee", bands=3, size=(32, 40))

    monkeypatch.setenv("TMCA_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr("tmca.data.rendered_scene", render)
    monkeypatch.setattr("tmca.data.split_rendered", lambda: {"train": ["coffee"]})
    installed(SOURCE)
    before = find_prior(SpectralCamera(bands=3), None, "flat", block=(4, 10))
    (tmp_path / "flat_prior.py").write_text(SOURCE.replace("prior.mean.mean(", "2 * prior.mean.mean("))
    Prior.kinds.pop("flat")
    sys.modules.pop("flat_prior")  # as in another process
    load_plugins.cache_clear()
    after = find_prior(SpectralCamera(bands=3), None, "flat", block=(4, 10))
    torch.testing.assert_close(after.mean, 2 * before.mean)


@pytest.mark.parametrize(("source", "reason"), [
    ("import a_package_that_is_not_there\n", "a_package_that_is_not_there"),
    (SOURCE.replace('"flat", "a flat', '"gaussian", "a flat'), "'gaussian', which tmca.priors.gaussian has"),
])  # fmt: skip
def test_one_that_cannot_be_loaded_is_warned_of_and_left_out(installed, source, reason):
    installed(source)
    before = dict(Prior.kinds)
    with pytest.warns(BrokenPlugin, match=reason):
        assert prior_kinds() == before
