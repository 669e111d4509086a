"""What the rows of the spectral-depth table say beside each other: margins, what learning adds, what was predicted."""

from __future__ import annotations

from functools import cache

from tmca.evaluation.spectral_depth import CONSTANT
from tmca.evaluation.study import Study, read_study
from tmca.evaluation.tables import Row, mean

STATIC_CASES = {
    "TMCA learned K = 4": "diffractive element only, learned",
    "TMCA learned K = 4 + CCA": "static mask + CCA, learned",
    "TMCA free-form, learned K = 4": "diffractive element only, free-form, learned",
}
"""Static special cases of learned codes: equal masks in all slots."""


@cache
def study() -> Study:
    """The shipped study, whose names the page knows."""
    return read_study("spectral-depth")


def labels() -> dict[str, str]:
    return study().decoder_labels


def is_static(code: str) -> bool:
    """Whether a row's codes do not change within the exposure."""
    return code in study().codes and study().codes[code].camera["slots"] == 1


def is_diffractive(code: str) -> bool:
    """Whether a row has a mask alone, one for the whole exposure."""
    return code.startswith("diffractive")


def start_of(code: str) -> str | None:
    """Codes that a learned one starts from."""
    learn = study().codes[code].learn if code in study().codes else None
    return learn.start if learn else None


_FIGURES = (
    ("placed", 1, "depth_mae"),
    ("flat", 1, "depth_mae"),
    ("confusion", 1, "depth_mae"),
    ("fisher", -1, "depth_mae"),
    ("kullback_leibler", -1, "depth_mae"),
    ("psnr", 1, "psnr"),
)
"""What is predicted, the sign of its correlation with what it predicts, and that."""


def order(found: Row) -> list[Row]:
    """Spearman's rank correlation over codes, noise by noise and decoder by decoder, of what is predicted with what was
    measured.

    Its sign is such that 1 is the right order.
    """
    from scipy.stats import spearmanr

    said = []
    told = found["foretold"]
    for noise, decoder in dict.fromkeys((row["noise"], decoder) for row in told for decoder in row["measured"]):
        own = [row for row in told if row["noise"] == noise and decoder in row["measured"]]
        if len(own) < 3:
            continue
        row = {"noise": noise, "decoder": labels()[decoder], "codes": len(own)}
        for name, sign, result in (figure for figure in _FIGURES if all(figure[0] in one for one in own)):
            predicted, made = [one[name] for one in own], [one["measured"][decoder][result] for one in own]
            row[name] = sign * float(spearmanr(predicted, made).statistic)
        said.append(row)
    return said


def margins(found: Row) -> list[Row]:
    """Noise by noise and decoder by decoder: time-multiplexed against static, and against the mask alone.

    Codes are chosen by what is known without a test scene: the patch likelihood's by their error on training scenes at
    drawn depths, networks' by the depth error in validation. What the least errors on the test scenes make, chosen in
    hindsight, is told too.
    """
    said = []
    for decoder, noise in dict.fromkeys((row["decoder"], row["noise"]) for row in found["rows"]):
        known = _known_before(found, decoder, noise)
        rows = [row for row in found["rows"] if (row["decoder"], row["noise"]) == (decoder, noise)]
        groups = (
            [row for row in rows if row["code"] != CONSTANT and not is_static(row["code"])],
            [row for row in rows if is_static(row["code"])],
            [row for row in rows if is_diffractive(row["code"])],
        )
        if not all(any(row["code"] in known for row in group) for group in groups):
            continue  # their cells failed
        best, static, alone = (
            min((row for row in group if row["code"] in known), key=lambda row: known[row["code"]]) for group in groups
        )
        least, base, mask = (min(row["depth_mae"] for row in group) for group in groups)
        said.append({
            "decoder": labels()[decoder], "noise": noise, "best": best["code"], "static": static["code"],
            "ratio": best["depth_mae"] / static["depth_mae"], "ratios": _seed_by_seed(best, static),
            "alone": best["depth_mae"] / alone["depth_mae"] - 1,
            "psnr": best["psnr"] - alone["psnr"], "sam": best["sam"] - alone["sam"],
            "ratio_in_hindsight": least / base, "alone_in_hindsight": least / mask - 1,
        })  # fmt: skip
    return said


def _seed_by_seed(best: Row, static: Row) -> str:
    """Ratios of the depth errors of either's seeds."""
    both = zip(best.get("seed_depth_mae", ()), static.get("seed_depth_mae", ()), strict=False)
    return ", ".join(f"{one / other:.2f}" for one, other in both)


def _known_before(found: Row, decoder: str, noise: str) -> dict[str, float]:
    """The depth error of codes without a test scene, under a noise or in validation."""
    if decoder == "likelihood":
        return {row["code"]: row["placed"] for row in found["foretold"] if row["noise"] == noise and "placed" in row}
    errors: dict[str, list[float]] = {}
    for training in found["budget"]["training"]:
        if training["decoder"] == decoder:
            errors.setdefault(training["code"], []).append(training["validation"]["depth_mae"])
    return {code: mean(own) for code, own in errors.items()}


def learning(found: Row) -> list[Row]:
    """Learned codes beside those that they started from, and beside their static special case, learned likewise.

    Decoder by decoder and noise by noise: depth errors in metres, PSNR in dB above either.
    """
    rows = {(row["code"], row["decoder"], row["noise"]): row for row in found["rows"]}
    said = []
    for (code, decoder, noise), row in rows.items():
        start, static = rows.get((start_of(code) or "", decoder, noise)), None
        if code in STATIC_CASES:
            static = rows.get((STATIC_CASES[code], decoder, noise))
        if start_of(code) is None or not (start or static):
            continue
        told = {"code": code, "decoder": labels()[decoder], "noise": noise, "depth_mae": row["depth_mae"]}
        for name, other in (("start", start), ("static", static)):
            if other is not None:
                told |= {name: other["depth_mae"], f"{name}_psnr": row["psnr"] - other["psnr"]}
        said.append(told)
    return said
