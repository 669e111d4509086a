"""What rows of a study gain over others: codes over codes, time-multiplexed ones over static ones and over a burst."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import product

from tmca.applications.report import Section
from tmca.evaluation.study import Study
from tmca.evaluation.tables import MEASURED, Column, Row, columns_there, grouped, mean

WHO: tuple[Column, ...] = (("decoder", "decoder", ""), ("noise", "noise", ""))
ONE_SLOT, A_BURST = "one slot", "a burst"
"""What time-multiplexed codes are held against."""


def parts_of(found: Row) -> dict[str, list[str]]:
    """Scenes that the study names, and those of known geometry beside them where there are any."""
    real, names = found["split"]["real"], found["split"]["test"]
    others = [name for name in names if name not in real]
    return {"of the study": list(real), "rendered": others} if others else {"": list(real)}


def level(row: Row, scenes: Iterable[str], name: str) -> float | None:
    """Mean of a metric over those scenes that have it."""
    known = [row["scenes"][scene][name] for scene in scenes if name in row["scenes"].get(scene, ())]
    return mean(known) if known else None


def over(row: Row, base: Row, scenes: Sequence[str], study: Study) -> Row:
    """What a row gains over another on those scenes that both have: differences of metrics; of the metric by which
    codes are chosen the ratio, where it is an error; seed by seed, where both have all, and scene by scene."""
    metric = study.evaluation.metric
    spec = "+.2f" if metric == "psnr" else ".2f"
    scenes = [scene for scene in scenes if scene in row["scenes"] and scene in base["scenes"]]
    whole = MEASURED[0] not in row and MEASURED[0] not in base
    pairs = zip(row.get(f"seed_{metric}", ()), base.get(f"seed_{metric}", ()), strict=False)
    seeds = [_gain(one, other, metric) for one, other in pairs] if whole else []
    each = {scene: _gain(level(row, [scene], metric), level(base, [scene], metric), metric) for scene in scenes}
    names = [name for name, *_ in study.evaluation.columns]
    differences = {name: _difference(level(row, scenes, name), level(base, scenes, name)) for name in names}
    return {
        **differences, "gain": _gain(level(row, scenes, metric), level(base, scenes, metric), metric),
        "seeds": ", ".join(format(gain, spec) for gain in seeds),
        "scenes": ", ".join(f"{scene} {format(gain, spec)}" for scene, gain in each.items() if gain is not None),
    }  # fmt: skip


def _gain(one: float | None, other: float | None, metric: str) -> float | None:
    """dB of PSNR; of an error the ratio."""
    if metric == "psnr" or one is None or other is None:
        return _difference(one, other)
    return one / other


def _difference(one: float | None, other: float | None) -> float | None:
    return None if one is None or other is None else one - other


def gain_columns(study: Study) -> list[Column]:
    """Columns of what ``over`` tells."""
    columns, metric = study.evaluation.columns, study.evaluation.metric
    heading = next(heading for name, heading, _ in columns if name == metric)
    signed: list[Column] = [(n, h, f"+{spec}") for n, h, spec in columns if n != metric or metric != "psnr"]
    first: Column = ("gain", f"gain, {heading}", "+.2f") if metric == "psnr" else ("gain", f"ratio of {heading}", ".2f")
    return [first, ("seeds", "seed by seed", ""), ("scenes", "scene by scene", ""), *signed]


def margins(found: Row, study: Study) -> list[Row]:
    """Time-multiplexed codes against those with one slot, and against other bases, decoder by decoder and noise by
    noise: the best of either as they are chosen without a test scene, or in hindsight where nothing is known so.
    Bursts are neither. In a study for a paper, those of one bucket and of two apart, and bursts are a base, too."""
    static = [name for name, code in study.codes.items() if code.one_slot]
    bursts = [name for name, code in study.codes.items() if code.burst]
    bases, rows = {ONE_SLOT: static, **({A_BURST: bursts} if study.figure else {}), **study.bases}, []
    groups = grouped(found["rows"], "decoder", "noise").items()
    several = _by_buckets(study, {*static, *bursts})
    for ((decoder, noise), own), (part, scenes) in product(groups, parts_of(found).items()):
        known = study.evaluation.scores(found, decoder, noise)
        there = [row for row in own if level(row, scenes, "psnr") is not None]
        for (name, base), (buckets, codes) in product(bases.items(), several.items()):
            many, single = ([row for row in there if row["code"] in group] for group in (codes, base))
            if many and single:
                rows.append({"decoder": study.decoder_labels[decoder], "noise": noise, "part": part, "against": name,
                             "buckets": buckets, **_best_over_best(many, single, known, scenes, study)})  # fmt: skip
    return rows


def _by_buckets(study: Study, apart: Collection[str]) -> dict[str, list[str]]:
    """Time-multiplexed codes, all but those ``apart``, by the buckets of a pixel that they need in a study for a
    paper."""
    codes = {name: code.buckets for name, code in study.codes.items() if name not in apart}
    if not study.figure:
        return {"": [*codes]}
    said = {1: "one", 2: "two"}
    return {said.get(n, str(n)): [name for name, own in codes.items() if own == n] for n in sorted({*codes.values()})}


def multiplexing(found: Row, study: Study) -> list[str]:
    """What time multiplexing gains in a study for a paper: a sentence for every decoder and noise."""
    if not study.figure:
        return []
    said = []
    known = [row for row in margins(found, study) if row["gain"] is not None]
    for (decoder, noise, part), rows in grouped(known, "decoder", "noise", "part").items():
        where = ", ".join([decoder, *([noise] if len(study.noises) > 1 else []), *([part] if part else [])])
        gained = []
        for (against, base), own in grouped(rows, "against", "base").items():
            what = "" if base == against.removeprefix("a ") else f" ({against})"
            gained.append(f"over {base}{what} {', '.join(_gained(row, study) for row in own)}")
        said.append(f"Time multiplexing ({where}): {'; '.join(gained)}.")
    return said


def _gained(row: Row, study: Study) -> str:
    """Of one row of ``margins``."""
    first = gain_columns(study)[0]
    unit = " dB" if study.evaluation.metric == "psnr" else f", {first[1]},"
    counted = f"{row['buckets']} bucket{'s'[: row['buckets'] != 'one']}"
    return f"{row['gain']:{first[2]}}{unit} with {counted} ({row['best']})"


def _best_over_best(
    several: Sequence[Row], single: Sequence[Row], known: Mapping[str, float], scenes: Sequence[str], study: Study
) -> Row:
    """The best of some rows over the best of others."""
    metric, groups = study.evaluation.metric, (several, single)
    sign = -1 if metric == "psnr" else 1

    def measured(row: Row) -> float:
        return sign * (level(row, scenes, metric) or 0.0)

    judged = [[row for row in group if row["code"] in known] for group in groups]
    top, bottom = (min(group, key=measured) for group in groups)
    best, base = (min(group, key=lambda row: known[row["code"]]) for group in judged) if all(judged) else (top, bottom)
    hindsight = over(top, bottom, scenes, study)["gain"]
    return {"best": best["code"], "base": base["code"], **over(best, base, scenes, study),
            **({"hindsight": hindsight} if all(judged) else {})}  # fmt: skip


def multiplexed(found: Row, study: Study) -> Iterator[Section]:
    """The section of a page about time-multiplexed codes; none where the study has no two rows to compare."""
    columns: list[Column] = [*WHO, ("part", "scenes", ""), ("buckets", "buckets", ""), ("against", "against", "")]
    gains, rows = gain_columns(study), margins(found, study)
    columns += [("best", "best time-multiplexed", ""), ("base", "best of the others", ""), gains[0]]
    columns += [("hindsight", "in hindsight", gains[0][2]), *gains[1:]]
    text = "Codes are chosen without a test scene where something is known of them: by a network's validation, or as "
    text += "the table of predictions says; else, and where it says so, in hindsight."
    if study.figure and not any("hindsight" in row for row in rows):
        text = "For each decoder, the best code of several slots over the best of one slot, with one bucket of a pixel "
        text += "and with two. Both are chosen by what was measured on these scenes. A burst multiplexes nothing: it "
        text += "is held against them, too."
    if rows:
        said = [*multiplexing(found, study), text]
        yield Section("Time-multiplexed over static codes", said, rows, columns_there(columns, rows))
