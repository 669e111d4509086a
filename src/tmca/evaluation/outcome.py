"""What a study returns: its results, as its JSON file holds them, shown as a table and bars."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from tmca.evaluation.tables import MEASURED, Column, plain_columns
from tmca.metrics.merits import MERITS
from tmca.summaries import Summary

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

_MOST = 20
"""Rows that are drawn."""


class StudyResults(Summary, dict[str, Any]):
    """The results of a study by name, ``rows`` among them: one for every code, noise and decoder.

    Args:
        found: as in the JSON file.
        column: (key, heading, format) of the figure of merit that rows are compared by.
    """

    def __init__(self, found: Mapping[str, Any], column: Column) -> None:
        super().__init__(found)
        self._column = column

    def to_pandas(self) -> pd.DataFrame:
        """A row for every code, noise and decoder, with the figures that are numbers or words."""
        import pandas as pd

        return pd.DataFrame(self["rows"], columns=plain_columns(self["rows"]))

    def to_xarray(self) -> xr.Dataset:
        """The same table, labelled."""
        import xarray as xr

        return xr.Dataset.from_dataframe(self.to_pandas().rename_axis("row"))

    def plot(self) -> Figure:
        """The figure of merit of every row, the best above."""
        from tmca.plots.thumbnails import bars_figure

        ranked = self._ranked()[:_MOST]
        several = len({row["noise"] for row in ranked}) > 1
        names = [self._called(row) + (f", {row['noise']}" if several else "") for row in ranked]
        return bars_figure(names, [float(row[self._column[0]]) for row in ranked], self._column[1])

    @staticmethod
    def _called(row: Mapping[str, Any]) -> str:
        """Name of a row, with what it is the mean of where it lacks cells."""
        return str(row["method"]) + (f" ({row[MEASURED[0]]})" if MEASURED[0] in row else "")

    def _ranked(self) -> list[dict[str, Any]]:
        """Rows that have the figure of merit, the best first."""
        rows = [row for row in self["rows"] if row.get(self._column[0]) is not None]
        merit = MERITS.get(self._column[0])
        return sorted(rows, key=lambda row: row[self._column[0]], reverse=merit is not None and merit.higher is True)

    def _facts(self) -> dict[str, str]:
        study, ranked, (key, heading, form) = self["study"], self._ranked(), self._column
        best = ranked[0] if ranked else None
        return {
            "study": f"{study['name']}, {study['camera']} camera",
            "codes": ", ".join(study["codes"]),
            "noises": ", ".join(study["noises"]),
            "decoders": ", ".join(study["decoders"]),
            "scenes": ", ".join(self["split"]["test"]),
            "rows": f"{len(self['rows'])}",
            "best": "" if best is None else f"{self._called(best)}: {heading} {best[key]:{form}}",
        }

    def _picture(self) -> Figure | None:
        return self.plot() if self._ranked() else None
