"""Which prior a decoder uses: a given one, a file's, or that of the rendered scenes; and whether it fits the camera."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from tmca.cameras import LightFieldCamera, SpectralDepthCamera
from tmca.errors import SettingError
from tmca.priors import (
    GaussianMixturePrior,
    GaussianPrior,
    PatchDictionary,
    load_prior,
    rendered_light_field_prior,
    rendered_prior,
)
from tmca.priors.files import HOW_TO_LEARN, kind_of
from tmca.priors.light_field import check_views
from tmca.priors.spectral_depth import needed_block

Prior = GaussianPrior | GaussianMixturePrior | PatchDictionary
WINDOW = 12
"""Side of the windows of a spectral-depth snapshot, pixels, where its codes have no larger tile."""
_WORDS = {"gaussian": "a Gaussian prior", "mixture": "a Gaussian-mixture prior", "dictionary": "a dictionary"}
_KINDS: dict[type, str] = {GaussianPrior: "gaussian", GaussianMixturePrior: "mixture", PatchDictionary: "dictionary"}


def find_prior(
    camera: Any,
    given: str | Path | Prior | None = None,
    kind: str = "gaussian",
    progress: Callable[..., None] | None = None,
) -> Any:
    """The prior for snapshots of a camera.

    Args:
        camera: whose scenes it is of.
        given: a prior, its file, or None for that of the rendered scenes, learned on first use and cached.
        kind: ``"gaussian"``, ``"mixture"`` or ``"dictionary"``.
        progress: told what is done, where it has to be learned.

    Raises:
        SettingError, ShapeError: none where there is no rendered one, one of another kind, or one that does not fit.
        DataError: no such file, or no prior in it.
    """
    if given is None:
        return _rendered(camera, kind, progress)
    prior = _loaded(given, kind) if isinstance(given, (str, Path)) else given
    if prior_kind(prior) != kind:
        found = _WORDS.get(prior_kind(prior), "something else")
        raise SettingError("prior", found, f"{_WORDS[kind]}", _remedy(camera, kind))
    check_prior(prior, camera)
    return prior


def prior_kind(prior: object) -> str:
    """``"gaussian"``, ``"mixture"``, ``"dictionary"``, or nothing for what is no prior."""
    return _KINDS.get(type(prior), "")


def _loaded(path: str | Path, kind: str) -> Prior:
    """A file's prior; where a dictionary is wanted the file has to hold one."""
    if kind == "dictionary" or kind_of(path) == "dictionary":
        return PatchDictionary.load(path)
    return load_prior(path)


def check_prior(prior: Prior, camera: Any) -> None:
    """Raises SettingError unless the prior's bands are the camera's to a nanometre, ShapeError unless its views are."""
    if isinstance(camera, LightFieldCamera):
        if not isinstance(prior, PatchDictionary):
            check_views(prior, camera.views)
        return
    base = prior.base if isinstance(prior, GaussianMixturePrior) else prior
    bands = getattr(base, "wavelengths", None)
    if bands is None or len(bands) != len(camera.wavelengths):
        return  # the block model names a wrong number of bands
    for band, (one, wanted) in enumerate(zip(bands, camera.wavelengths, strict=True), start=1):
        if abs(one - wanted) > 1e-9:
            found, there = f"band {band} at {one * 1e9:.4g} nm", f"the camera's {wanted * 1e9:.4g} nm"
            raise SettingError("prior", found, there, "learn a prior at the camera's bands")


def _rendered(camera: Any, kind: str, progress: Callable[..., None] | None) -> Any:
    if isinstance(camera, SpectralDepthCamera) and kind == "gaussian":
        return rendered_depth_prior(camera, max(WINDOW, camera.tile_size), progress)
    if isinstance(camera, LightFieldCamera) and kind == "gaussian":
        if camera.views[0] == camera.views[1]:
            return rendered_light_field_prior(camera.views[0], progress=progress)
        found = f"none for {camera.views[0]}×{camera.views[1]} views"
        raise SettingError("prior", found, "one: the rendered light fields are square", "learn one")
    if camera.kind == "spectral" and kind != "dictionary":
        spread = camera.dispersion.spread
        return rendered_prior(camera.wavelengths, spread, mixture=kind == "mixture", progress=progress)
    where = "dictionary" if kind == "dictionary" else "prior"
    raise SettingError(where, "none", _WORDS[kind], _remedy(camera, kind))


def rendered_depth_prior(
    camera: SpectralDepthCamera, window: int, progress: Callable[..., None] | None = None
) -> GaussianPrior:
    """That of the rendered scenes at a camera's bands, for windows of so many pixels."""
    block = needed_block(max(WINDOW, window), camera.bench.window)  # smaller windows share that of usual ones
    prior = rendered_prior(camera.wavelengths, 0, block=block, progress=progress)
    assert isinstance(prior, GaussianPrior)
    return prior


def _remedy(camera: Any, kind: str) -> str:
    if kind == "dictionary":
        return f"learn one with {HOW_TO_LEARN['dictionary']} and name it with dictionary= (--dictionary)"
    command = "learn-views" if camera.kind == "light-field" else "learn"
    return f"learn one with `tmca prior {command} …{' --mixture' if kind == 'mixture' else ''}`"
