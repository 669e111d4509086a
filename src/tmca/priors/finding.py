"""The prior that a camera's snapshots are decoded with: a given one, a file's, or that of the rendered scenes."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

from tmca.errors import DataError, SettingError
from tmca.priors.gaussian import GaussianPrior
from tmca.priors.learning import block_of, learn_prior
from tmca.priors.prior import Prior, check_kind, load_prior

if TYPE_CHECKING:
    import xarray as xr

Progress = Callable[[float, str], None]
"""Takes the share that is done, and what is done next."""
_SIZE, _RANGE = (256, 256), (400e-9, 700e-9)
_VIEWS_SIZE, _VIEWS_SEEDS = (128, 160), (0, 1)
_RENDERING = 1
"""Raised when the rendering changes: priors cached by earlier versions are then learned anew."""


@overload
def find_prior(
    camera: Any,
    given: str | Path | Prior | None = None,
    kind: Literal["gaussian"] = "gaussian",
    progress: Progress | None = None,
    *,
    block: tuple[int, int] | None = None,
) -> GaussianPrior: ...


@overload
def find_prior(
    camera: Any,
    given: str | Path | Prior | None,
    kind: str,
    progress: Progress | None = None,
    *,
    block: tuple[int, int] | None = None,
) -> Prior: ...


def find_prior(
    camera: Any,
    given: str | Path | Prior | None = None,
    kind: str = "gaussian",
    progress: Progress | None = None,
    *,
    block: tuple[int, int] | None = None,
) -> Prior:
    """The prior of a camera's scenes.

    That of the rendered scenes is learned on first use and cached in the folder ``TMCA_CACHE``, or ``tmca`` in the
    user's cache folder.

    Args:
        camera: whose bands or views the prior has to have.
        given: it, its file, or None for that of the rendered scenes.
        kind: ``"gaussian"``, ``"mixture"`` or ``"dictionary"``.
        progress: called where it has to be learned.
        block: (rows, columns) of the rendered scenes' prior instead of the camera's.

    Raises:
        DataError: no such file, or no prior in it.
        SettingError: a prior of another kind or at other bands, or a camera for which nothing is rendered.
        ShapeError: another number of bands or views.
    """
    if given is None:
        return _rendered(camera, kind, block, progress or (lambda share, step: None))
    prior = load_prior(given, kind) if isinstance(given, (str, Path)) else given
    check_kind(prior, kind)
    prior.check(camera)
    return prior


def _cache_folder() -> Path:
    """Where priors are cached: ``TMCA_CACHE``, else ``tmca`` in the user's cache folder."""
    if "TMCA_CACHE" in os.environ:
        return Path(os.environ["TMCA_CACHE"])
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "tmca"


def _rendered(camera: Any, kind: str, block: tuple[int, int] | None, progress: Progress) -> Prior:
    """The prior of the rendered training scenes: cached, or learned now."""
    from tmca.data import make_folder

    if kind == "dictionary":
        wanted = Prior.kinds[kind]
        raise SettingError(wanted.argument, "none", wanted.called, f"learn one with {wanted.learned_by}")
    if camera.kind == "spectral-depth" and block is None:
        block = block_of(camera, kind)
    source = _light_fields if camera.kind == "light-field" else _cubes
    label, identity, scenes = source(camera, kind)
    identity += [] if block is None else [list(block)]
    digest = hashlib.sha256(json.dumps(identity).encode()).hexdigest()[:16]
    file = _cache_folder() / f"rendered-{label}-{digest}.nc"
    if file.exists():
        try:
            return load_prior(file)
        except DataError:
            pass  # a damaged file of ours: learned anew below, and replaced
    examples = []
    for index, (name, render) in enumerate(scenes):
        progress(0.5 * index / len(scenes), f"first use: rendering {name} for the prior, which is then cached")
        examples.append(render(name))
    progress(0.5, f"first use: learning the {kind} prior, which is then cached")
    prior = learn_prior(examples, camera, kind, block=block)
    make_folder(file.parent)
    prior.save(file, overwrite=True)
    return prior


_Scenes = list[tuple[str, Callable[[str], "xr.DataArray"]]]


def _cubes(camera: Any, kind: str) -> tuple[str, list[Any], _Scenes]:
    """What the file is called, what it depends on, and the cubes at the camera's bands, each rendered when called."""
    from tmca import __version__
    from tmca.data import rendered_scene, split_rendered

    wavelengths = camera.wavelengths
    if min(wavelengths) < _RANGE[0] - 1e-12 or max(wavelengths) > _RANGE[1] + 1e-12:
        raise SettingError(
            "prior",
            f"bands from {min(wavelengths) * 1e9:.4g} to {max(wavelengths) * 1e9:.4g} nm",
            "400 to 700 nm, where the rendered scenes are given",
            "pass --prior with one from `tmca prior learn --all-bands`, or use admm-tv",
        )

    def render(name: str) -> xr.DataArray:
        cube: xr.DataArray = rendered_scene(name, wavelengths=list(wavelengths), size=_SIZE)["radiance"]
        cube.attrs["name"] = name
        return cube

    names = sorted(split_rendered()["train"])
    spread = camera.dispersion.spread if camera.kind == "spectral" else 0
    lengths = [round(w * 1e12) for w in wavelengths]
    identity = [_RENDERING, __version__, lengths, spread, kind == "mixture", names, _SIZE]
    return kind, identity, [(name, render) for name in names]


def _light_fields(camera: Any, kind: str) -> tuple[str, list[Any], _Scenes]:
    """The same for light fields of the camera's views."""
    from tmca import __version__
    from tmca.data import rendered_light_field, split_rendered_light_fields

    views = camera.views
    if views[0] != views[1]:
        wanted = "one: the rendered light fields are square"
        raise SettingError("prior", f"none for {views[0]}×{views[1]} views", wanted, "learn one")

    def render(name: str, seed: int) -> xr.DataArray:
        return rendered_light_field(name, views=views[0], size=_VIEWS_SIZE, seed=seed)["light_field"]

    names = sorted(split_rendered_light_fields()["train"])
    identity = [_RENDERING, __version__, views[0], names, _VIEWS_SIZE, _VIEWS_SEEDS]
    label = "light-field" if kind == "gaussian" else f"light-field-{kind}"
    return label, identity, [(name, partial(render, seed=seed)) for name in names for seed in _VIEWS_SEEDS]
