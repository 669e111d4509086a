"""Reconstructions of any camera, as files too."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray as xr


@dataclass(kw_only=True)
class Reconstruction(ABC):
    """What a decoder made of a snapshot.

    Args:
        decoder: which one.
        seconds: wall time.
        metrics: against the truth, if it is known.
        notes: settings and provenance, kept as attributes.
    """

    decoder: str
    seconds: float
    metrics: dict[str, float] = field(default_factory=dict)
    notes: dict[str, Any] = field(default_factory=dict)

    @abstractmethod
    def parts(self) -> Mapping[str, xr.DataArray | None]:
        """Arrays of the file by name; None for what is not known."""

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write the parts to a NetCDF file, notes and metrics as its attributes.

        Raises:
            OutputError: the file exists, or cannot be written.
        """
        import xarray as xr

        from tmca.data import write_dataset

        known = {name: part for name, part in self.parts().items() if part is not None}
        measured = {f"metric_{name}": value for name, value in self.metrics.items()}
        attrs = {**self.notes, "decoder": self.decoder, "seconds": self.seconds, **measured}
        return write_dataset(xr.Dataset(known, attrs=attrs), path, overwrite=overwrite)
