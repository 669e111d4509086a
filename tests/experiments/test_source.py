"""The digest of the source follows what a module imports, and nothing beside it."""

import subprocess
import sys

import pytest

from tmca.experiments.source import imported, source_digest

LIGHT_FIELD = "tmca.experiments.light_field.comparison"


@pytest.mark.parametrize("module", ["tmca.experiments.spectral.cells", "tmca.experiments.spectral.plan"])
def test_everything_that_runs_at_import_is_followed(module):
    ran = f"import sys, {module}; print(*(name for name in sys.modules if name.startswith('tmca.experiments.')))"
    loaded = subprocess.run([sys.executable, "-c", ran], capture_output=True, text=True, check=True).stdout.split()
    packages = {name for name in loaded if any(other.startswith(f"{name}.") for other in loaded)}
    assert set(loaded) - packages <= imported(module)


def test_what_a_package_hands_on_is_followed_to_its_module():
    found = imported(LIGHT_FIELD)
    assert {"tmca.cameras.light_field", "tmca.priors.learning", "tmca.training.light_field"} <= found
    assert "tmca.cameras" not in found


def test_imports_inside_functions_are_followed():
    assert "tmca.design.search" in imported("tmca.experiments.light_field.cells")


@pytest.mark.parametrize("camera", ["light_field", "spectral", "spectral_depth"])
def test_pictures_are_no_source_of_a_table(camera):
    found = imported(f"tmca.experiments.{camera}.comparison")
    assert not [name for name in found if name.startswith("tmca.plots") or name.endswith("figures")]


def test_digests_of_other_sources_differ():
    digests = [source_digest(LIGHT_FIELD), source_digest("tmca.design"), source_digest("tmca.errors")]
    assert len(set(digests)) == 3
    assert source_digest("tmca.errors") == digests[2]


def test_a_changed_module_changes_the_digest(tmp_path, monkeypatch):
    import tmca.experiments.source as source

    (tmp_path / "one.py").write_text("def f():\n    from tmca.two import g\n    return g()\n")
    (tmp_path / "two.py").write_text("def g():\n    return 1\n")
    (tmp_path / "beside.py").write_text("x = 1\n")
    monkeypatch.setattr(source, "_ROOT", tmp_path)

    def digest() -> str:
        source._imports.cache_clear()
        return source.source_digest.__wrapped__("tmca.one")

    first = digest()
    (tmp_path / "beside.py").write_text("x = 2\n")
    assert digest() == first
    (tmp_path / "two.py").write_text("def g():\n    return 2\n")
    assert digest() != first
    source._imports.cache_clear()
