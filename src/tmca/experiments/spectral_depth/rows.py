"""What the spectral-depth table compares: codes, noises, decoders, and how the trained ones are trained."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from tmca.experiments.decoder_labels import DecoderLabels

_STATIC: dict[str, Any] = {"slots": 1, "shutter": "open"}
_CLEAR, _COLOURED = {"filters": "clear"}, {"filters": "gaussian"}
_MULTIPLEXED: dict[str, Any] = {"slots": 4, "shutter": "one-hot"}
_FREE = {"mask": "free-form"}

CODES: dict[str, dict[str, Any]] = {
    "diffractive element only, random": {**_STATIC, **_CLEAR},
    "diffractive element only, optimised": {**_STATIC, **_CLEAR},
    "diffractive element only, free-form, optimised": {**_STATIC, **_CLEAR, **_FREE},
    "static mask + CCA, optimised": {**_STATIC, **_COLOURED},
    "TMCA random K = 4 + CCA": {**_MULTIPLEXED, **_COLOURED},
    "TMCA optimised K = 4 + CCA": {**_MULTIPLEXED, **_COLOURED},
    "TMCA random K = 4": {**_MULTIPLEXED, **_CLEAR},
    "TMCA optimised K = 4": {**_MULTIPLEXED, **_CLEAR},
    "TMCA free-form, optimised K = 4": {**_MULTIPLEXED, **_CLEAR, **_FREE},
    "TMCA free-form, optimised K = 4 + CCA": {**_MULTIPLEXED, **_COLOURED, **_FREE},
    "diffractive element only, learned": {**_STATIC, **_CLEAR},
    "diffractive element only, free-form, learned": {**_STATIC, **_CLEAR, **_FREE},
    "static mask + CCA, learned": {**_STATIC, **_COLOURED},
    "TMCA learned K = 4": {**_MULTIPLEXED, **_CLEAR},
    "TMCA learned K = 4 + CCA": {**_MULTIPLEXED, **_COLOURED},
    "TMCA free-form, learned K = 4": {**_MULTIPLEXED, **_CLEAR, **_FREE},
    "TMCA free-form, learned K = 4 + CCA": {**_MULTIPLEXED, **_COLOURED, **_FREE},
}
"""Settings of the camera beside the preset's: RGB sensor, masks of Zernike modes where none is named, equal exposure
time."""
DESIGNED = tuple(name for name in CODES if "optimised" in name)
"""Codes whose masks are searched for least confusion of depths and judged on training scenes, with equal effort."""
LEARNED = {
    "diffractive element only, learned": "diffractive element only, optimised",
    "diffractive element only, free-form, learned": "diffractive element only, free-form, optimised",
    "static mask + CCA, learned": "static mask + CCA, optimised",
    "TMCA learned K = 4": "TMCA optimised K = 4",
    "TMCA learned K = 4 + CCA": "TMCA optimised K = 4 + CCA",
    "TMCA free-form, learned K = 4": "TMCA free-form, optimised K = 4",
    "TMCA free-form, learned K = 4 + CCA": "TMCA free-form, optimised K = 4 + CCA",
}
"""Codes that go on being learned together with a network, and the codes they start from."""
STATIC_CASES = {
    "TMCA learned K = 4": "diffractive element only, learned",
    "TMCA learned K = 4 + CCA": "static mask + CCA, learned",
    "TMCA free-form, learned K = 4": "diffractive element only, free-form, learned",
}
"""Static special cases of learned codes: equal masks in all slots."""
LEARNED_WITH = "two-headed"
"""The network: its gradient reaches the masks through the snapshot, and no first stage is made anew in every step.
Depth they learn from the patch likelihood."""
STATIC_CODES = tuple(name for name, settings in CODES.items() if settings["slots"] == 1)
DIFFRACTIVE = tuple(name for name in CODES if name.startswith("diffractive"))
STARTS = dict.fromkeys(STATIC_CODES, 4)
"""How many times the descents of a search: as much processor time as four slots take, whose search contains a static
one."""
STEPS = {code: 5 for code in LEARNED if code in DIFFRACTIVE}
"""How many times the steps in which codes are learned: a step of one mask without filters takes a fifth of the time."""
NOISES: dict[str, dict[str, Any]] = {
    "σ = 0.002": {"read_noise": 0.002},
    "10 000 e⁻ full well, 3 e⁻ read noise": {"full_well": 10_000, "read_noise_electrons": 3},
}
DECODER_NAMES = DecoderLabels("spectral-depth", {
    "likelihood": "patch likelihood",
    "two-headed": "two-headed U-Net",
    "physics": "two-headed U-Net from the likelihood",
})  # fmt: skip
NETWORKS: dict[str, dict[str, Any]] = {
    "two-headed": {"kind": "two-headed", "start": "snapshot"},
    "physics": {"kind": "two-headed", "start": "likelihood"},
}
TRAINED = tuple(name for name in CODES if name != "diffractive element only, random")
"""Codes that networks are trained behind: one network for all noises."""
CONSTANT = "constant guess"
"""Row of a depth map that is the middle of the range, in inverse metres, everywhere."""


@dataclass(frozen=True)
class Sizes:
    """How large everything is.

    Args:
        preset: of the camera.
        side: scenes from files are averaged down while their shorter side keeps at least this many pixels.
        crop: (H, W) middle of every scene that is measured.
        window: of the patch likelihood, pixels.
        patch: side of the patches that networks learn from.
        searched: side of the windows that masks are searched for.
    """

    preset: str = "quick"
    side: int = 256
    crop: tuple[int, int] = (96, 128)
    window: int = 12
    patch: int = 64
    searched: int = 8


def _learned(code: str) -> list[str]:
    """All of a code that can be learned."""
    own = CODES[code]
    shutter, filters = own["shutter"] != "open", own["filters"] != "clear"
    return ["mask", *(["shutter"] if shutter else []), *(["filters"] if filters else [])]


def training_of(
    code: str,
    decoder: str,
    seed: int,
    steps: int,
    sizes: Sizes,
    noises: Sequence[str],
    codes: str | None,
    learn: bool = False,
) -> dict[str, Any]:
    """Settings of a trained row, without its scenes.

    Args:
        codes: file of designed codes or weights with learned ones, to decode or to go on from.
        learn: whether they go on being learned.
    """
    camera: dict[str, Any] = {"preset": sizes.preset, "size": [sizes.patch, sizes.patch], "seed": seed}
    camera |= {"slots": CODES[code]["slots"], "learn": _learned(code) if learn else "none"}
    if code not in LEARNED or learn:
        camera |= CODES[code]  # learned codes are no longer of a kind
    return {
        "camera": camera,
        "noise": [NOISES[name] for name in noises],
        "decoder": NETWORKS[decoder],
        "codes": {"start": codes} if codes else {},
        "data": {"patch": sizes.patch, "batch": 4, "pool": 256, "side": sizes.side, "brightness": 1.0},
        "optimiser": {"steps": steps * (STEPS.get(code, 1) if learn else 1), "decoder_rate": 2e-3},
        "validate_every": max(1, steps // 4),
        "seed": seed,
    }
