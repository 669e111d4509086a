"""What the spectral table compares: codes, noises, decoders, and how the trained ones are trained."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tmca.experiments.decoder_labels import DecoderLabels

CODES: dict[str, dict[str, Any]] = {
    "CASSI random": {"slots": 1, "aperture": "random", "shutter": "open"},
    "TMCA random K = 8": {"slots": 8, "aperture": "random", "shutter": "random"},
    "TMCA one-hot K = 4": {"slots": 4, "aperture": "random", "shutter": "one-hot"},
}
LEARNED: dict[str, dict[str, Any]] = {
    "CASSI learned": {"slots": 1, "aperture": "random", "shutter": "open", "learn": "aperture", "period": 32},
    "TMCA learned K = 8": {"slots": 8, "aperture": "random", "shutter": "random", "learn": "both", "period": 32},
    "TMCA learned K = 8, from random": {
        "slots": 8, "aperture": "random", "shutter": "random", "duty": 0.7, "learn": "both", "period": 32,
    },
}  # fmt: skip
"""The second starts at the codes and the decoder of the first: time multiplexing contains the static camera."""
STATIC, MULTIPLEXED, FREE = LEARNED
NOISES: dict[str, dict[str, Any]] = {
    "noise-free": {},
    "σ = 0.01": {"read_noise": 0.01},
    "10 000 e⁻ full well, 3 e⁻ read noise": {"full_well": 10_000, "read_noise_electrons": 3},
}
NETWORK_NAMES = {
    "unet-thesis": "U-Net from Φᵀy",
    "unet": "U-Net from LMMSE",
    "unrolled": "unrolled",
    "unrolled-mixture": "unrolled from mixture",
}
DECODER_NAMES = DecoderLabels("spectral", NETWORK_NAMES)
NETWORKS: dict[str, dict[str, Any]] = {
    "unet-thesis": {"kind": "unet", "start": "adjoint", "codes": False, "noise_aware": False},
    "unet": {"kind": "unet", "start": "lmmse"},
    "unrolled": {"kind": "unrolled", "start": "lmmse"},
    "unrolled-mixture": {"kind": "unrolled", "start": "mixture"},
}
OF_LEARNED_CODES = ("unet-thesis", "unrolled")
"""Decoders that codes are learned with."""
OF_UNROLLED_CODES = ("lmmse", "lmmse-adapted", "mixture")
"""Decoders without training that reconstruct from the codes learned with the unrolled network."""
PACE = {"unet-thesis": 1.7, "unet": 1.3, "unrolled": 1.0, "unrolled-mixture": 0.6}
"""Steps in the minutes that one step of the unrolled network takes with fixed codes, its first estimates included."""
LEARNING = {"unet-thesis": 0.85, "unrolled": 0.67}
"""Steps of a run that learns codes, relative to one with fixed codes, in the same minutes."""
FROZEN = {"unet-thesis": 0.5, "unrolled": 0.9}
"""Share of the steps after which codes stay: behind the LMMSE a step that learns codes costs six others."""
RATE = {"unet-thesis": 0.06, "unrolled": 0.1}
"""Learning rate of the codes."""
SHOWN_NOISE = "σ = 0.01"
SHOWN = (
    ("CASSI random", "admm-tv"),
    ("CASSI random", "unet-thesis"),
    ("TMCA random K = 8", "unet-thesis"),
    (STATIC, "unet-thesis"),
    (MULTIPLEXED, "unet-thesis"),
    ("CASSI random", "lmmse"),
    ("CASSI random", "lmmse-adapted"),
    ("TMCA random K = 8", "lmmse-adapted"),
    ("TMCA one-hot K = 4", "lmmse-adapted"),
    (STATIC, "unrolled"),
    (MULTIPLEXED, "unrolled"),
    (FREE, "unrolled"),
)
"""Rows that are pictured, the thesis' five first."""
POOL = {"lmmse": 1536, "mixture": 768, "adjoint": 0}
"""Patches whose first estimates a run keeps: the slower they are, the fewer."""


def training_of(code: str, decoder: str, seed: int, steps: int) -> dict[str, Any]:
    """Settings of a trained row, without its scenes: one network for all noises.

    The thesis' U-Net is trained as the thesis says (L2), the others on the mean PSNR.
    """
    learned = code in LEARNED
    camera = {**(CODES | LEARNED)[code], "seed": seed}
    loss = "l2" if decoder == "unet-thesis" else "log"
    steps = max(2, round(steps * PACE[decoder] * (LEARNING[decoder] if learned else 1)))
    return {
        "camera": camera,
        "noise": list(NOISES.values()),
        "decoder": NETWORKS[decoder],
        "codes": {"frozen": FROZEN[decoder] if learned else 0.5, "slope": [2.0, 40.0]},
        "data": {"pool": POOL[NETWORKS[decoder]["start"]]},
        "optimiser": {"steps": steps, "loss": loss, "code_rate": RATE[decoder] if learned else 0.06},
        "validate_every": max(1, steps // 6),
        "seed": seed,
    }


def scenes_of(train: Sequence[str]) -> dict[str, Any]:
    """Scenes that networks and their prior learn from: given ones and the rendered ones.

    Given scenes come thrice, which makes them outnumber the rendered ones, and make the prior alone: rendered scenes
    among them cost the first estimate 1.4 dB on scenes left out.
    """
    from tmca.data import split_rendered

    return {"train": [*train, *train, *train, *sorted(split_rendered()["train"])], "prior": list(train) or ["rendered"]}


def trained_rows(decoders: Sequence[str]) -> list[tuple[str, str]]:
    """(code, decoder) of the rows that are trained, those that others start from first."""
    rows = [(code, decoder) for decoder in decoders if decoder in NETWORKS for code in CODES]
    return rows + [(code, decoder) for code in LEARNED for decoder in decoders if decoder in OF_LEARNED_CODES]
