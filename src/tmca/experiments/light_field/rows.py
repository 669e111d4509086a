"""What the light-field table compares: codes, noises, decoders, and how the trained ones are trained."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from tmca.data.light_field_scenes import RENDERED
from tmca.experiments.decoder_labels import DecoderLabels

EFFORT = {"descents": 2, "steps": 120, "flips": 2000}
"""Of every search, static or not."""


@dataclass(frozen=True)
class Sizes:
    """How large everything is.

    Args:
        views: n of the centre n×n views.
        period: side of the tile of codes, pixels.
        frame: (H, W) middle of the light fields from files that are measured.
        rendered: (H, W) of the rendered ones.
        crop: (H, W) middle of the frame, for the dictionary.
        patch: side of the patches that networks learn from.
    """

    views: int = 5
    period: int = 16
    frame: tuple[int, int] = (270, 480)
    rendered: tuple[int, int] = RENDERED
    crop: tuple[int, int] = (96, 96)
    patch: int = 56


CODES: dict[str, dict[str, Any]] = {
    "CLFP static random": {"slots": 1, "shutter": "open"},
    "TMCA random K = 8": {"slots": 8},
    "TMCA one-hot K = 4": {"slots": 4, "shutter": "one-hot"},
    "TMCA one-hot K = 8": {"slots": 8, "shutter": "one-hot"},
}
NOISES: dict[str, dict[str, Any]] = {
    "noise-free": {},
    "σ = 0.05": {"read_noise": 0.05},
    "10 000 e⁻ full well, 3 e⁻ read noise": {"full_well": 10_000, "read_noise_electrons": 3},
}
_STATIC, _MULTIPLEXED = ("static", 1), ("free", 8)
DESIGNED: dict[str, tuple[tuple[str, int], str | None]] = {
    "CLFP optimised": (_STATIC, "σ = 0.05"),
    "TMCA optimised K = 8": (_MULTIPLEXED, "σ = 0.05"),
    "CLFP optimised for this noise": (_STATIC, None),
    "TMCA optimised K = 8 for this noise": (_MULTIPLEXED, None),
}
"""Kind and slots of a search and the noise it is for; the column's own with None."""
LEARNED: dict[str, tuple[str, str]] = {
    "CLFP E2E": ("CLFP optimised", "aperture"),
    "TMCA E2E K = 8": ("TMCA optimised K = 8", "both"),
}
"""Codes learned end to end with a network: the design that they start from, and what learns."""
TRAINED = (*CODES, *list(DESIGNED)[:2], *LEARNED)
"""Codes that networks are trained behind: one network for all noises."""
STATIC_CODES = tuple(name for name in (*CODES, *DESIGNED, *LEARNED) if name.startswith("CLFP"))
SHOWN_DECODERS = {
    "dictionary": "dictionary (LASSO)",
    "lmmse": "patch LMMSE",
    "mixture": "patch mixture",
    "sub-network": "thesis' sub-network",
    "consistent": "measurement-consistent network",
}
"""Decoders of the published table."""
DECODER_NAMES = DecoderLabels("light-field", SHOWN_DECODERS)
NETWORKS: dict[str, dict[str, Any]] = {
    "sub-network": {
        "kind": "spatial-angular", "stages": 0, "start": "dagger", "width": 32, "blocks": 4, "gather": 2,
    },
    "consistent": {"kind": "spatial-angular", "start": "lmmse"},
}  # fmt: skip
PACE = {"sub-network": 0.6, "consistent": 1.0}
"""Steps in the minutes of one step of the measurement-consistent network, its first estimates included."""
LEARNING = {"sub-network": 0.7, "consistent": 0.6}
"""Steps of a run that learns codes, relative to one with fixed codes, in the same minutes."""
FROZEN = {"sub-network": 0.5, "consistent": 0.9}
"""Share of the steps after which codes stay: behind the LMMSE a step that learns codes costs several others."""
SHOWN_NOISE = "noise-free"
SHOWN = (
    ("CLFP static random", "lmmse"),
    ("CLFP optimised for this noise", "lmmse"),
    ("TMCA one-hot K = 8", "lmmse"),
    ("TMCA optimised K = 8 for this noise", "lmmse"),
    ("CLFP optimised", "consistent"),
    ("TMCA optimised K = 8", "consistent"),
)
"""Rows that are pictured."""


def rows(noise: str) -> list[str]:
    """Codes that decoders without training are measured behind; no design twice."""
    return [*CODES, *(name for name, (_, target) in DESIGNED.items() if target is not None or noise not in _targets())]


def _targets() -> set[str | None]:
    return {target for _, target in DESIGNED.values()}


def search_of(code: str, noise: str) -> tuple[str, int, str]:
    """Kind, slots and noise of a designed code's search."""
    (kind, slots), target = DESIGNED[code]
    return kind, slots, target or noise


def training_of(code: str, decoder: str, seed: int, steps: int, sizes: Sizes, codes: str | None) -> dict[str, Any]:
    """Settings of a trained row, without its scenes: one network for all noises, on the mean PSNR.

    Args:
        codes: file of designed codes.
    """
    start, learn = LEARNED.get(code, (code, "none"))
    camera = CODES.get(start) or {"slots": DESIGNED[start][0][1]}
    frame, period = 2 * [-(-sizes.patch // sizes.period) * sizes.period], 2 * [sizes.period]
    camera = {**camera, "views": sizes.views, "size": frame, "period": period, "seed": seed}
    camera["learn"] = learn
    if camera["slots"] == 1:
        camera["shutter"] = "open"
    steps = max(4, round(steps * PACE[decoder] * (1 if learn == "none" else LEARNING[decoder])))
    learning = {} if learn == "none" else {"frozen": FROZEN[decoder], "slope": [2.0, 40.0]}
    return {
        "camera": camera,
        "noise": list(NOISES.values()),
        "decoder": NETWORKS[decoder],
        "codes": {**({"start": codes} if codes else {}), **learning},
        "data": {"patch": sizes.patch, "batch": 4, "pool": 1024, "brightness": 1.0},
        "optimiser": {"steps": steps, "loss": "log", "decoder_rate": 3e-3, "code_rate": 0.06},
        "validate_every": max(1, steps // 4),
        "seed": seed,
    }


def scenes_of(train: Sequence[str]) -> dict[str, Any]:
    """Light fields that networks learn from: given ones thrice and the rendered ones; their prior knows the given ones.

    Rendered ones among the prior's cost up to 1.8 dB on a given one that was left out, and gained up to 0.8 dB on
    another.
    """
    from tmca.data import split_rendered_light_fields

    rendered = split_rendered_light_fields()
    names = [*train, *train, *train, *sorted(rendered["train"])] if train else sorted(rendered["train"])
    return {"train": names, "prior": list(train) or ["rendered"], "validation": sorted(rendered["validation"])}
