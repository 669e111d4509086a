"""How a prior is found for a camera: given, read, learned from scenes, or learned once from the rendered ones."""

from __future__ import annotations

import hashlib
import inspect
import json
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import partial
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any
from warnings import warn

from tmca.arguments import described
from tmca.errors import DataError, SettingError, check_choice, check_range
from tmca.operators.window_moments import WINDOW, needed_block
from tmca.plugins import foreign_source
from tmca.priors.learning import PATCH, common_channels, cubes_of, fitting_block, source_of, values_of
from tmca.priors.prior import Prior, check_kind, load_prior, prior_kinds
from tmca.priors.subspace import SubspacePrior, warn_of_bands_beyond

if TYPE_CHECKING:
    import xarray as xr

Progress = Callable[[float, str], None]
"""Takes the share that is done, and what is done next."""
_SIZE, _RANGE = (256, 256), (400e-9, 700e-9)
_VIEWS_SIZE, _VIEWS_SEEDS = (128, 160), (0, 1)
_LARGEST_BLOCKS = {"gaussian": (12, 5184), "mixture": (8, 3456), "subspace": (12, 26880)}
"""Most rows, and entries."""
_COMPLETE, _MOST_COMPLETE = 14, 40
"""Columns that see all their light from inside a block: these, or three quarters of the dispersion."""
_FEWEST_ROWS = 2
_MEASURED_ROWS, _MEASUREMENTS = 8, 400
"""Most rows that blocks under a Gaussian get beyond these limits, and most measurements in such a block."""
_WIDEST = 54
"""Columns of dispersion for which priors of any bands are learned: two pixels for each of 28 bands."""
_VIEW_ENTRIES, _LARGEST_SIDE = 2600, 11
_RENDERING = 1
"""Raised when the rendering changes: priors cached by earlier versions are then learned anew."""
_FROM_SCENES = ("sources", "wavelengths", "views", "seed", "progress")
"""Arguments of ``learn`` that are no settings of a kind."""


class NarrowBlocks(UserWarning):
    """A prior of any bands whose blocks see little of a wide dispersion: estimates suffer."""


def find_prior(
    camera: Any,
    given: str | Path | Prior | None = None,
    kind: str = "gaussian",
    progress: Progress | None = None,
    *,
    block: tuple[int, int] | None = None,
) -> Any:
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

    Warns:
        NarrowBlocks, BandsBeyond: a prior of any bands that was learned for less dispersion, or for other wavelengths.
    """
    _check_camera(camera)
    if given is None:
        return _of_rendered(camera, kind, block, progress or (lambda share, step: None))
    prior = load_prior(given, kind) if isinstance(given, (str, Path)) else given
    if isinstance(prior, SubspacePrior) and kind == "gaussian" and camera.views is None:
        prior = _at_bands(prior, camera, block or block_of(camera, prior.kind))
    check_kind(prior, kind)
    prior.check(camera)
    return prior


def _at_bands(prior: SubspacePrior, camera: Any, block: tuple[int, int]) -> Prior:
    """A prior of any bands at those of a camera; warns where its estimates suffer."""
    there = prior.at(camera.wavelengths, block)
    if block[1] > prior.block[2]:
        text = f"the prior's blocks of {prior.block[2]} columns are narrow for a dispersion of so many columns"
        text += f": {block[1]} are wanted, and estimates may be worse than those of admm-tv"
        warn(f"{text}; use admm-tv, or learn a prior with a larger --spread", NarrowBlocks, stacklevel=3)
    warn_of_bands_beyond(camera.wavelengths, prior.wavelengths, "prior")
    return there


def _check_camera(camera: Any) -> None:
    if isinstance(camera, type) or not hasattr(camera, "psf_window"):
        raise SettingError("camera", described(camera), "a camera, such as tmca.SpectralCamera()")


def has_rendered(camera: Any) -> bool:
    """Whether the rendered scenes give a prior of a camera's scenes: bands of 400 to 700 nm, a square grid of views."""
    try:
        _rendered_scenes(camera)
    except SettingError:
        return False
    return True


def _of_rendered(camera: Any, kind: str, block: tuple[int, int] | None, progress: Progress) -> Prior:
    """The prior of the rendered training scenes: cached, or learned now."""
    from tmca.data.folders import cache_folder, make_folder

    check_choice("kind", kind, prior_kinds())
    cls = Prior.kinds[kind]
    if not cls.of_rendered:
        raise SettingError(cls.argument, "none", cls.called, f"learn one with {cls.learned_by}")
    identity, scenes = _rendered_scenes(camera)
    name = _cache_name(cls, kind, block or block_of(camera, kind), camera.views, identity)
    file = cache_folder() / name
    if file.exists():
        with suppress(DataError):  # a damaged file of ours: learned anew below, and replaced
            return load_prior(file)
    examples = []
    for index, (scene, render) in enumerate(scenes):
        progress(0.5 * index / len(scenes), f"first use: rendering {scene} for the prior, which is then cached")
        examples.append(values_of(render()).assign_attrs(name=scene))
    progress(0.5, f"first use: learning the {kind} prior, which is then cached")
    prior = learn_prior(examples, camera, kind, block=block)
    make_folder(file.parent)
    prior.save(file, overwrite=True)
    return prior


def _cache_name(
    cls: type[Prior], kind: str, block: tuple[int, int], views: tuple[int, int] | None, scenes: dict[str, Any]
) -> str:
    """The file of a prior of scenes: by all that makes it."""
    foreign = foreign_source(cls)
    identity = scenes | ({"source": foreign} if foreign else {})
    identity |= {"block": block, "learner": [kind, cls.version, _defaults(cls, views)]}
    digest = hashlib.sha256(json.dumps(identity).encode()).hexdigest()[:16]
    label = kind if views is None else f"light-field-{kind}"
    return f"rendered-{label}-{digest}.nc"


def _rendered_scenes(camera: Any) -> tuple[dict[str, Any], list[tuple[str, partial[xr.Dataset]]]]:
    """What decides the training scenes, and these by name, each rendered when called."""
    from tmca import __version__, data

    rendering = {"rendering": _RENDERING, "version": __version__}
    if camera.views is not None:
        side, names = camera.views[0], sorted(data.split_rendered_light_fields()["train"])
        if camera.views != (side, side):
            found, wanted = f"none for {side}×{camera.views[1]} views", "one: the rendered light fields are square"
            raise SettingError("prior", found, wanted, "learn one")
        size, render = _VIEWS_SIZE, data.rendered_light_field
        calls = [(n, partial(render, n, views=side, size=size, seed=seed)) for n in names for seed in _VIEWS_SEEDS]
        return {**rendering, "views": side, "scenes": names, "size": size, "seeds": _VIEWS_SEEDS}, calls
    lengths, names = list(camera.wavelengths), sorted(data.split_rendered()["train"])
    if not lengths or min(lengths) < _RANGE[0] - 1e-12 or max(lengths) > _RANGE[1] + 1e-12:
        bands = f"bands from {min(lengths) * 1e9:.4g} to {max(lengths) * 1e9:.4g} nm" if lengths else "no bands"
        remedy = "pass --prior with one from `tmca prior learn --all-bands`, or use admm-tv"
        raise SettingError("prior", bands, "400 to 700 nm, where the rendered scenes are given", remedy)
    picometres = [round(length * 1e12) for length in lengths]
    calls = [(n, partial(data.rendered_scene, n, wavelengths=lengths, size=_SIZE)) for n in names]
    return {**rendering, "picometres": picometres, "scenes": names, "size": _SIZE}, calls


def _defaults(cls: type[Prior], views: tuple[int, int] | None) -> dict[str, Any]:
    """Settings of ``learn`` where none are given."""
    defaults = {one.name: one.default for one in _keywords(cls) if one.name not in _FROM_SCENES}
    return defaults | (dict(cls.settings_of_views) if views is not None else {})


def _keywords(cls: type[Prior]) -> list[inspect.Parameter]:
    """The keyword arguments of a kind's ``learn``."""
    return [one for one in inspect.signature(cls.learn).parameters.values() if one.kind is one.KEYWORD_ONLY]


def block_of(camera: Any, kind: str = "gaussian", window: int | None = None) -> tuple[int, int]:
    """(rows, columns) of the blocks of a camera's prior.

    Args:
        camera: of any kind.
        kind: of the prior.
        window: side of the windows that depth is decoded from; the usual one, or a tile of the codes, if None. Smaller
            windows share the blocks of usual ones.

    Raises:
        SettingError: no window is given for a camera of depth whose shutter patterns do not repeat.
    """
    if camera.psf_window is not None:
        side = camera.tile_size if window is None else window
        return needed_block(max(WINDOW, side), camera.psf_window)
    one_prism = camera.snapshot_shape[-1] - camera.size[1] == camera.dispersion_extent
    plain = one_prism and camera.buckets == 1
    return usual_block(kind, prod(camera.scene_shape[:-2]), camera.dispersion_extent, camera.views, plain=plain)


def usual_block(
    kind: str, bands: int = 0, extent: int = 0, views: tuple[int, int] | None = None, *, plain: bool = True
) -> tuple[int, int]:
    """(rows, columns) of blocks of cubes or views.

    Blocks of cubes are wide enough that some columns see all their light from inside. For 12 bands at one pixel per
    band they are 12×36 (Gaussian) and 8×36 (mixture). On training scenes left out one by one, 16×36 gives 0.1 dB more
    for twice the matrix, 6×36 0.5 dB less (``benchmarks/defaults.py``). Other cameras get as many rows as keep the
    covariance about that large. ``plain`` ones, of one bucket behind one prism, get up to 8 under a Gaussian, whose
    covariance is never stored, as keep the matrix of measurements about that large: 7×82 for 31 bands, 4×148 for 28
    bands at two pixels per band, 2 dB more than 2×122 gives (``benchmarks/many_bands.py``). Blocks of views are square
    and of odd sides: 9×9 for 5×5 views, 5×5 for 9×9, 11×11 at most.
    """
    if kind == "dictionary":
        return PATCH
    if views is not None:
        side = min(_LARGEST_SIDE, max(3, int((_VIEW_ENTRIES / (views[0] * views[1])) ** 0.5)))
        return side - 1 + side % 2, side - 1 + side % 2
    tall = plain and kind == "gaussian"
    complete = min(max(_COMPLETE, 3 * extent // 4), _MOST_COMPLETE) if tall else _COMPLETE
    columns, (most, entries) = max(2 * extent + complete, 24), _LARGEST_BLOCKS.get(kind, _LARGEST_BLOCKS["gaussian"])
    measured = min(_MEASURED_ROWS, _MEASUREMENTS // (columns - extent)) if tall else 0
    return max(_FEWEST_ROWS, min(most, entries // (bands * columns)), measured), columns


def learn_prior(
    scenes: Iterable[xr.DataArray | xr.Dataset],
    camera: Any = None,
    kind: str = "gaussian",
    *,
    extent: int | None = None,
    block: tuple[int, int] | None = None,
    seed: int = 0,
    **settings: Any,
) -> Prior:
    """Learn a prior from example scenes.

    Args:
        scenes: cubes (wavelength, y, x), all with the same wavelengths, or light fields (view_v, view_u, y, x), or with
            colours first, which count as light fields of their own, all of the same views; relative irradiance, or
            datasets that hold them; one, or several.
        camera: whose ``block_of`` the prior gets; that of most cameras shrinks to the smallest scene.
        kind: ``"gaussian"``, ``"mixture"`` or, of light fields, ``"dictionary"``.
        extent: columns by which dispersion widens the snapshot, for cubes without a camera; 0 if None, 54 for a prior
            of any bands.
        block: (rows, columns) instead of the camera's.
        seed: of random blocks.
        settings: further ones of the ``learn`` of that kind.

    Raises:
        SettingError: no scenes, or a kind that there is not.
        ShapeError: scenes with other axes.
        DataError: scenes of different wavelengths or views, or smaller than a block that is needed.
    """
    if camera is not None:
        _check_camera(camera)
    examples = _examples(scenes)
    about = common_channels(examples)
    views = about.get("views")
    cls = _learner(kind, settings, views)
    if camera is not None and (views is None) != (camera.views is None):
        found, wanted = ("light fields", "cubes") if views else ("cubes", "light fields")
        raise SettingError("scenes", found, f"{wanted}, of which the {camera.kind} camera takes snapshots")
    needed = block is not None or (camera is not None and camera.psf_window is not None)
    if block is not None:
        _check_block(block)
    elif camera is not None:
        block = block_of(camera, kind)
    else:
        block = _block_without_camera(kind, cls, extent, about)
    about |= {"seed": seed} if any(one.name == "seed" for one in _keywords(cls)) else {}
    about |= cls.settings_of_views if views is not None else {}
    about |= {"sources": [source_of(example) for example in examples], **settings}
    cubes = [cube for example in examples for cube in cubes_of(example)]
    return cls.learn(cubes, fitting_block(examples, block, needed), **about)


def _block_without_camera(kind: str, cls: type[Prior], extent: int | None, channels: dict[str, Any]) -> tuple[int, int]:
    """The usual block of scenes of these channels, whose light reaches as far as ``extent`` columns."""
    any_bands = issubclass(cls, SubspacePrior)
    extent = (_WIDEST if any_bands else 0) if extent is None else extent
    check_range("extent", extent, 0, whole=True)
    bands = 1 if any_bands else len(channels.get("wavelengths", ()))
    return usual_block(kind, bands, extent, channels.get("views"))


def _examples(scenes: Any) -> list[xr.DataArray]:
    """The cubes or light fields of scenes, one or several."""
    if hasattr(scenes, "dims"):
        return [values_of(scenes)]
    if isinstance(scenes, str) or not isinstance(scenes, Iterable):
        raise SettingError("scenes", repr(scenes), "labelled cubes or light fields", "read them with tmca.read")
    examples = [values_of(scene) for scene in scenes]
    if not examples:
        raise SettingError("scenes", "none", "at least one")
    return examples


def _learner(kind: str, settings: dict[str, Any], views: tuple[int, int] | None) -> type[Prior]:
    """The class of a kind; SettingError for a kind that there is not or not of cubes, or a setting it does not have."""
    check_choice("kind", kind, prior_kinds())
    cls = Prior.kinds[kind]
    if issubclass(cls, SubspacePrior) and views is not None:
        raise SettingError("kind", f"{kind!r} for light fields", "another: it is learned from cubes")
    if cls.of_views and views is None:
        raise SettingError("kind", f"{kind!r} for cubes", "another: it is learned from light fields")
    names = [one.name for one in _keywords(cls)]
    takes_any = any(one.kind is one.VAR_KEYWORD for one in inspect.signature(cls.learn).parameters.values())
    for name, value in settings.items():
        if name not in names and not takes_any:
            choices = ", ".join(one for one in names if one not in _FROM_SCENES)
            raise SettingError(name, repr(value), f"one of {choices}" if choices else "no settings", "leave it out")
    return cls


def _check_block(block: Any) -> None:
    if not isinstance(block, Sequence) or len(block) != 2:
        raise SettingError("block", repr(block), "(rows, columns)")
    for side in block:
        check_range("block", side, 1, whole=True, unit="pixels")
