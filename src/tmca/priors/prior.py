"""Priors of scene blocks: what all have in common, and their files."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields, replace
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
import torch
from torch import Tensor

from tmca.arguments import described
from tmca.attributes import Attributes, attributes_of
from tmca.errors import DataError, SettingError, ShapeError, check_choice
from tmca.plugins import load_plugins, take
from tmca.stored_numbers import finite_numbers
from tmca.summaries import Summary, range_nm, sizes

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

FORMAT = "tmca prior 1"
_DRAWN, _QUICK = 4, 2000
"""Blocks of a small picture, and most entries of one."""


@dataclass(frozen=True, eq=False, repr=False)
class Prior(Summary, ABC):
    """What scene blocks (L, h, w) look like.

    A subclass says what kind it is, and is then learned, found and read from files too; the package's ``__init__`` has
    to import it, or an entry point of the group ``tmca.priors`` to name it. Its class attributes: ``kind``; ``called``,
    with its article; ``learned_by``, the command that writes its file; ``dimensions`` of the arrays in its file;
    ``meanings``, what these are, in a few words for whoever opens the file;
    ``in_files``, its kind as files spell it, where that differs; ``argument``, by which decoders take it; ``of_views``,
    whether it is of light fields alone; ``of_rendered``, whether that of the rendered scenes is learned where none is
    given; ``stated``, the model of ``attributes`` in a file; ``version`` of ``learn``, raised when it makes other
    priors of the same scenes; ``settings_of_views``, those of ``learn`` that light fields have otherwise.
    """

    kind: ClassVar[str]
    called: ClassVar[str]
    learned_by: ClassVar[str]
    dimensions: ClassVar[Mapping[str, tuple[str, ...]]]
    meanings: ClassVar[Mapping[str, str]] = {}
    in_files: ClassVar[str] = ""
    argument: ClassVar[str] = "prior"
    of_views: ClassVar[bool] = False
    of_rendered: ClassVar[bool] = True
    version: ClassVar[int] = 1
    stated: ClassVar[type[Attributes]] = Attributes
    settings_of_views: ClassVar[Mapping[str, Any]] = {}
    kinds: ClassVar[dict[str, type[Prior]]] = {}

    def __init_subclass__(cls, **settings: Any) -> None:
        super().__init_subclass__(**settings)
        if "kind" in vars(cls):  # a subclass without one is of its parent's
            take(cls, _register, "prior")

    @property
    @abstractmethod
    def block(self) -> tuple[int, int, int]:
        """(L, h, w)."""

    @property
    @abstractmethod
    def wavelengths(self) -> tuple[float, ...] | None:
        """Of the L channels, in metres; None where they are views or not known."""

    @property
    @abstractmethod
    def sources(self) -> tuple[str, ...]:
        """Names (and checksums) of the scenes it was learned from."""

    @classmethod
    @abstractmethod
    def learn(cls, *examples: Any, **settings: Any) -> Self:
        """The prior of blocks (h, w) cut from example cubes (L, H, W).

        Raises:
            ShapeError: no cube, different band counts or views, or a block larger than a cube.
            DataError: values that are not finite.
        """

    @abstractmethod
    def sample(self, count: int, seed: int) -> Tensor:
        """(count, L, h, w) random blocks of this prior; SettingError unless there is one at least."""

    @abstractmethod
    def figure(self) -> Figure:
        """A picture of it."""

    @abstractmethod
    def arrays(self) -> dict[str, Tensor]:
        """What its file holds, by name."""

    def attributes(self) -> dict[str, Any]:
        """What else its file says."""
        return {}

    @classmethod
    @abstractmethod
    def from_arrays(cls, arrays: Mapping[str, Tensor], about: Mapping[str, Any]) -> Self:
        """The prior of a file that says this about it; KeyError or ValueError where it is damaged."""

    def check(self, camera: Any) -> None:
        """Whether it is one of the scenes that a camera sees.

        Raises:
            ShapeError: another number of bands or views.
            SettingError: bands that are more than a nanometre away.
        """
        sides = camera.scene_shape[:-2]
        if self.block[0] != prod(sides):
            found, wanted = f"{self.block[0]} channels", f"the camera's {'×'.join(map(str, sides))} {camera.channel}s"
            raise ShapeError(self.argument, found, wanted, "learn one for them")
        pairs = zip(self.wavelengths or camera.wavelengths, camera.wavelengths, strict=False)
        for band, (length, seen) in enumerate(pairs, start=1):
            if abs(length - seen) > 1e-9:
                found, wanted = f"band {band} at {length * 1e9:.4g} nm", f"the camera's {seen * 1e9:.4g} nm"
                raise SettingError(self.argument, found, wanted, "learn one at the camera's bands")

    def plot(self) -> Figure:
        """The same as `figure`."""
        return self.figure()

    def _facts(self) -> dict[str, str]:
        count = len(self.sources)
        first = ", ".join(name.partition(" ")[0] for name in self.sources[:4]) + ("…" if count > 4 else "")
        return {
            "kind": self.kind,
            "blocks": sizes(self.block),
            "bands": range_nm(self.wavelengths),
            "scenes": f"{count}: {first}" if count else "",
        }

    def in_a_line(self) -> str:
        """Its kind and what it was learned from, in a few words."""
        count = len(self.sources)
        return f"{self.kind}, learned from {count} scene{'s'[: count != 1]}"

    def _picture(self) -> Figure | None:
        """Blocks that it draws, where that is quick."""
        if prod(self.block) > _QUICK:
            return None
        from tmca.plots.thumbnails import Panel, row_figure

        drawn = self.sample(_DRAWN, 0).flatten(1, -3).mean(1).numpy(force=True)
        top = float(np.quantile(drawn, 0.995))
        return row_figure([Panel(f"draw {number}", one, top=top) for number, one in enumerate(drawn, start=1)])

    def to(self, device: torch.device | str) -> Self:
        """The prior on a device; itself if it is there."""
        parts = {part.name: getattr(self, part.name) for part in fields(self)}
        moved = {name: part.to(device) for name, part in parts.items() if isinstance(part, (Tensor, Prior))}
        return self if all(part is parts[name] for name, part in moved.items()) else replace(self, **moved)

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write the prior as labelled NetCDF4, whole or not at all.

        Raises:
            OutputError: the file exists, or cannot be written.
        """
        from tmca.data import write_dataset

        return write_dataset(self.to_xarray(), path, overwrite=overwrite)

    def to_xarray(self) -> xr.Dataset:
        """What its file holds, labelled."""
        import xarray as xr

        from tmca.data.axes import WAVELENGTH

        variables = {
            name: (self.dimensions[name], values.cpu().numpy(), self._about(name))
            for name, values in self.arrays().items()
        }
        about = {"format": FORMAT, "kind": self.in_files or self.kind, "sources": "\n".join(self.sources)}
        data = xr.Dataset(variables, attrs={**about, "block": list(self.block), **self.attributes()})
        if self.wavelengths is not None:
            data = data.assign_coords(wavelength=("channel", np.array(self.wavelengths), WAVELENGTH))
        return data

    def _about(self, name: str) -> dict[str, str]:
        return {"units": "1", "long_name": self.meanings[name]} if name in self.meanings else {}

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a prior of this kind that ``save`` wrote.

        Raises:
            DataError: no such file, no prior of this kind in it, or damaged content.
        """
        prior = load_prior(path, cls.kind)
        if not isinstance(prior, cls):
            raise DataError(path, prior.called, cls.called, f"name one that {cls.learned_by} wrote")
        return prior


def _register(cls: type[Prior]) -> None:
    """Raises SettingError where another module has a prior of that kind, or a part of it is missing."""
    where = f"{cls.__module__}.{cls.__qualname__}"
    before = Prior.kinds.get(cls.kind, cls)
    if before.__module__ != cls.__module__:
        raise SettingError(f"{where}.kind", f"{cls.kind!r}, which {before.__module__} has", "a kind of its own")
    for part, kind in (("called", str), ("learned_by", str), ("dimensions", Mapping)):
        value = getattr(cls, part, None)
        if not (isinstance(value, kind) and value):
            wanted = "axes of every array, by name" if part == "dimensions" else "a short text"
            raise SettingError(f"{where}.{part}", repr(value), wanted, "give the class one")
    cls.in_files = vars(cls).get("in_files", "")
    Prior.kinds[cls.kind] = cls


def _registered() -> Collection[type[Prior]]:
    return Prior.kinds.values()


def prior_kinds() -> dict[str, type[Prior]]:
    """Every kind of prior by its name, those of other packages included."""
    load_plugins("tmca.priors", _registered, "a subclass of Prior with a kind")
    return Prior.kinds


def load_prior(path: str | Path, kind: str = "gaussian") -> Prior:
    """Read a prior file of any kind.

    Args:
        path: of the file.
        kind: that is wanted, for the error.

    Raises:
        DataError: no such file, no prior in it, or damaged content.
        SettingError: a kind that there is not.
    """
    from tmca.data import read_dataset

    check_choice("kind", kind, prior_kinds())
    data = read_dataset(path)
    about = attributes_of(_PriorAttributes, data.attrs, path)
    cls = {one.in_files or one.kind: one for one in Prior.kinds.values()}.get(about.kind)
    if about.format != FORMAT or cls is None:
        raise DataError(path, "no prior in it", f"a file written by {Prior.kinds[kind].learned_by}", "learn one")
    arrays = {name: _numbers(data, name, path) for name in cls.dimensions if name in data}
    lengths = tuple(_numbers(data, "wavelength", path).tolist()) if "wavelength" in data.coords else None
    sources = tuple(line for line in about.sources.split("\n") if line)
    said = {**data.attrs, **dict(attributes_of(cls.stated, data.attrs, path))}
    try:
        return cls.from_arrays(arrays, {**said, "wavelengths": lengths, "sources": sources})
    except (IndexError, KeyError, TypeError, ValueError) as error:
        raise DataError(path, f"a damaged prior ({error})", "every part of it", "copy the file again") from error


class _PriorAttributes(Attributes):
    format: str = ""
    kind: str = ""
    sources: str = ""


def _numbers(data: xr.Dataset, name: str, path: str | Path) -> Tensor:
    """A variable in double precision; DataError unless its numbers are finite."""
    values = finite_numbers(data[name].values, path, f"variable {name}", np.float64, "learn the prior again")
    return torch.from_numpy(values)


def check_kind(prior: Prior, kind: str) -> None:
    """Raises SettingError unless a prior is of this kind."""
    check_choice("kind", kind, prior_kinds())
    wanted = Prior.kinds[kind]
    if not isinstance(prior, wanted):
        found, remedy = getattr(prior, "called", described(prior)), f"learn one with {wanted.learned_by}"
        raise SettingError(wanted.argument, found, wanted.called, remedy)
