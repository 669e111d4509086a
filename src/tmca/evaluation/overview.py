"""What a study of several noises says at a glance: one table and one picture of all rows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from tmca.applications.report import Section
from tmca.evaluation.study import Study
from tmca.evaluation.tables import Column, Row, columns_there, grouped

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PICTURE = "glance"
"""Ending of the picture's name."""
_FEWEST = 3
"""Codes of a study that a picture is worth drawing of."""


def overview(found: Row, study: Study) -> Iterator[Section]:
    """The metric by which codes are compared, a row for each code and decoder, a column for each noise; nothing of
    studies of one noise."""
    if len(study.noises) == 1 or not known_rows(found, study):
        return
    metric, heading, spec = _metric(study)
    rows = [
        {"code": code, "label": study.decoder_labels[decoder], **{row["noise"]: row[metric] for row in own}}
        for (code, decoder), own in grouped(known_rows(found, study), "code", "decoder").items()
    ]  # fmt: skip
    columns: list[Column] = [("code", "code", ""), ("label", "decoder", "")]
    columns += [(noise, noise, spec) for noise in study.noises]
    said = [f"{heading}, means over scenes and seeds."]
    if is_drawn(study):
        said += [f"![{_caption(study)}]({study.name}_{PICTURE}.png)"]
    yield Section("At a glance", said, rows, columns_there(columns, rows))


def is_drawn(study: Study) -> bool:
    """Whether a picture belongs to the table: of several codes and noises, and beside a page in Markdown."""
    return len(study.noises) > 1 and len(study.codes) >= _FEWEST and not study.figure


def overview_figure(found: Row, study: Study) -> Figure:
    """The rows of `overview` with colours: what each gains over the best code of one slot behind the same decoder,
    over the first one where none has a single slot."""
    from tmca.plots.curves import coloured_table

    groups = grouped(known_rows(found, study), "code", "decoder")
    values = np.full((len(groups), len(study.noises)), np.nan)
    for place, rows in enumerate(groups.values()):
        for row in rows:
            values[place, [*study.noises].index(row["noise"])] = row[study.evaluation.metric]
    labels = study.decoder_labels
    several = len({decoder for _, decoder in groups}) > 1
    names = [f"{code} + {labels[decoder]}" if several else code for code, decoder in groups]
    gains = _gains(values, [*groups], study)
    return coloured_table(names, [*study.noises], values, gains, _metric(study)[2], _caption(study), _unit(study))


def _gains(values: np.ndarray, rows: Sequence[tuple[str, str]], study: Study) -> np.ndarray:
    """Of values (R, C) of codes behind decoders: dB of PSNR, of an error -10 log10 of the ratio."""
    gains = np.full_like(values, np.nan)
    decoders = np.array([decoder for _, decoder in rows])
    single = np.array([study.codes[code].one_slot for code, _ in rows])
    for decoder in dict.fromkeys(decoders.tolist()):
        behind = decoders == decoder
        base = values[behind & single] if (behind & single).any() else values[behind][:1]
        base = np.where(np.isnan(base).all(0), np.inf, base)
        if study.evaluation.metric == "psnr":
            gains[behind] = values[behind] - np.nanmax(base, 0)
        else:
            gains[behind] = 10 * np.log10(np.nanmin(base, 0) / values[behind])
    return np.where(np.isfinite(gains), gains, np.nan)


def _caption(study: Study) -> str:
    base = "the best code of one slot" if any(code.one_slot for code in study.codes.values()) else "the first code"
    return f"{_metric(study)[1]}; colours: {_unit(study)} over {base} with the same decoder"


def _unit(study: Study) -> str:
    """What the colours are."""
    metric, heading, _ = _metric(study)
    return "gain (dB)" if metric == "psnr" else f"−10 log₁₀ of the ratio of {heading.partition(' (')[0]}"


def _metric(study: Study) -> Column:
    metric = study.evaluation.metric
    return next(column for column in study.evaluation.columns if column[0] == metric)


def known_rows(found: Row, study: Study) -> list[Row]:
    """Rows that have the metric by which codes are compared."""
    return [row for row in found["rows"] if study.evaluation.metric in row]
