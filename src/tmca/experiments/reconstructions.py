"""Estimates with their metrics, as comparisons and studies take them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tmca.applications import evaluate
from tmca.applications.imaging import metric_notes
from tmca.cameras import Snapshot
from tmca.decoders import Estimate, decode, decoders_for, usual_decoder

if TYPE_CHECKING:
    import xarray as xr


@dataclass
class Reconstruction:
    """An estimate as `Estimate.to_xarray` labels it, its decoder, wall time, and metrics if the truth is known."""

    data: xr.Dataset
    decoder: str
    seconds: float
    metrics: dict[str, float] = field(default_factory=dict)

    @property
    def cube(self) -> xr.DataArray:
        """The scene: (wavelength, y, x), or views."""
        return self.data["radiance" if "radiance" in self.data else "estimate"]

    light_field = cube

    @property
    def deviation(self) -> xr.DataArray | None:
        """Predicted standard deviation, if there is one."""
        return self.data.get("deviation")

    @property
    def depth(self) -> xr.DataArray:
        """(y, x) metres."""
        return self.data["depth"]

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write it as NetCDF, metrics as attributes too.

        Raises:
            OutputError: the file exists, or cannot be written.
        """
        from tmca.data import write_dataset

        return write_dataset(self.data.assign_attrs(metric_notes(self.metrics)), path, overwrite=overwrite)


def reconstruct(
    snapshot: Snapshot[Any],
    decoder: str | None = None,
    *,
    truth: xr.DataArray | xr.Dataset | None = None,
    **how: Any,
) -> Reconstruction:
    """`decoded`, measured against a truth."""
    estimate = decoded(snapshot, decoder, **how)
    metrics = {} if truth is None else evaluate(estimate, truth)
    return Reconstruction(estimate.to_xarray(), estimate.decoder, estimate.seconds, metrics)


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
