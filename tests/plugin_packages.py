"""Packages of others, as pip installs them: one module, named in an entry point."""

import importlib

from tmca.plugins import load_plugins


def install(folder, monkeypatch, group, module, source, classes=()):
    """Write the package into a folder and find it there, by its module or some classes; `load_plugins` loads anew."""
    (folder / f"{module}.py").write_text(source)
    about = folder / f"{module}-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module}\nVersion: 1.0\n")
    points = [f"{name.lower()} = {module}:{name}" for name in classes] or [f"{module} = {module}"]
    (about / "entry_points.txt").write_text("\n".join([f"[{group}]", *points, ""]))
    monkeypatch.syspath_prepend(str(folder))
    importlib.invalidate_caches()
    load_plugins.cache_clear()
