"""Reconstructions of any camera with their metrics, as files too."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tmca.cameras import Snapshot
from tmca.decoders import Estimate, decode, decoders_for, usual_decoder

if TYPE_CHECKING:
    import xarray as xr


@dataclass
class Reconstruction:
    """What a decoder made of a snapshot.

    Args:
        data: the estimate as `Estimate.to_xarray` labels it.
        decoder: which one.
        seconds: wall time.
        metrics: against the truth, if it is given.
        notes: settings and provenance, stored as attributes.
    """

    data: xr.Dataset
    decoder: str
    seconds: float
    metrics: dict[str, float] = field(default_factory=dict)
    notes: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, estimate: Estimate, metrics: dict[str, float] | None = None) -> Reconstruction:
        """An estimate and how good it is."""
        data = estimate.to_xarray()
        notes = {name: value for name, value in data.attrs.items() if name not in ("decoder", "seconds")}
        return cls(data, estimate.decoder, estimate.seconds, metrics or {}, notes)

    @property
    def cube(self) -> xr.DataArray:
        """The scene: (wavelength, y, x), or views."""
        return self.data["radiance" if "radiance" in self.data else "estimate"]

    @property
    def light_field(self) -> xr.DataArray:
        """The scene of a light-field camera, (view_v, view_u, y, x), with colours first if there are any."""
        return self.cube

    @property
    def deviation(self) -> xr.DataArray | None:
        """Predicted standard deviation, if there is one."""
        return self.data.get("deviation")

    @property
    def depth(self) -> xr.DataArray:
        """(y, x) metres."""
        return self.data["depth"]

    @property
    def confidence(self) -> xr.DataArray:
        """(y, x) probability that the depth is right within one bin."""
        return self.data["confidence"]

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write the parts to a NetCDF file, notes and metrics as its attributes.

        Raises:
            OutputError: the file exists, or cannot be written.
        """
        from tmca.data import write_dataset

        measured = {f"metric_{name}": value for name, value in self.metrics.items()}
        attrs = {**self.notes, "decoder": self.decoder, "seconds": self.seconds, **measured}
        stored = self.data.copy()
        stored.attrs = attrs
        return write_dataset(stored, path, overwrite=overwrite)


def decoded(
    snapshot: Snapshot[Any],
    decoder: str | None = None,
    *,
    prior: Any = None,
    progress: Callable[..., None] | None = None,
    **settings: Any,
) -> Estimate:
    """`decode` as commands call it: settings that are None are left out, and so is ``uncertainty`` where a decoder
    cannot predict it."""
    name = decoder or usual_decoder(snapshot.camera.kind)
    given = {setting: value for setting, value in settings.items() if value is not None}
    cls = decoders_for(snapshot.camera.kind, moving=None).get(name)
    if cls is not None and not cls.deviation:
        given.pop("uncertainty", None)
    return decode(snapshot, name, prior=prior, progress=progress, **given)
