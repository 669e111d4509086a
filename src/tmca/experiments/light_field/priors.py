"""Priors and dictionaries of light fields as files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tmca.data.light_field_scenes import NOTHING, Reading, check_asked, load_light_field
from tmca.errors import SettingError
from tmca.plots.style import save_figure
from tmca.priors import Prior, learn_prior

if TYPE_CHECKING:
    import xarray as xr

Told = Callable[[float, str], None]


def learn_views_to_file(
    sources: Sequence[str],
    out: Path,
    *,
    split: Path | None = None,
    views: int = 5,
    reading: Reading = NOTHING,
    kind: str = "gaussian",
    atoms: int = 1024,
    seed: int = 0,
    figure: Path | None = None,
    overwrite: bool = False,
    progress: Told | None = None,
) -> Prior:
    """Learn a prior or a dictionary of light fields, and write it with its picture.

    Args:
        sources: what ``load_light_field`` reads.
        out: file to write.
        split: a split file whose light fields are added.
        views: n for the centre n×n views.
        reading: of those from files.
        kind: ``"gaussian"``, ``"mixture"`` (of Gaussians) or ``"dictionary"``.
        atoms: of the dictionary.
        seed: of the patches that a dictionary or a mixture learns from.
        figure: PNG to write.
        overwrite: replace files.
        progress: called with the share that is done and what is done.

    Raises:
        SettingError: no light fields, an unknown kind, or a reading that applies to none of them.
        OutputError: a file exists.
    """
    from tmca.data import check_target, read_split

    for file in (out, figure):
        if file is not None:
            check_target(file, overwrite)
    if kind not in ("gaussian", "mixture", "dictionary"):
        raise SettingError("kind", repr(kind), "gaussian, mixture or dictionary")
    names = [*sources, *(map(str, read_split(split)) if split else ())]
    if not names:
        raise SettingError("prior learn-views", "no light fields", "folders, files, rendered scenes or --split")
    check_asked(names, **vars(reading))
    told = progress or (lambda share, step: None)
    fields = _read(names, views, reading, told)
    told(0.3, f"learning the {'dictionary' if kind == 'dictionary' else 'prior'}")
    settings: dict[str, Any] = {}
    if kind == "dictionary":
        settings = {"atoms": atoms, "progress": lambda share: told(0.3 + 0.7 * share, "learning the dictionary")}
    prior = learn_prior(fields, None, kind, seed=seed, **settings)
    prior.save(out, overwrite=overwrite)
    if figure is not None:
        save_figure(prior.figure(), figure, overwrite=overwrite)
    return prior


def _read(names: Sequence[str], views: int, reading: Reading, told: Told) -> list[xr.DataArray]:
    fields = []
    for index, name in enumerate(names):
        told(0.3 * index / len(names), f"reading {name}")
        fields.append(load_light_field(name, views=views, **reading.of(name)))
    return fields
