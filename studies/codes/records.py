"""What the study of codes asks for, cell by cell, and the rows that its files hold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NotRequired, TypedDict

from studies.grid import Settings

Figures = dict[str, float]
"""Figures of merit, or one of them scene by scene."""


@dataclass(frozen=True)
class Code:
    """Codes that are ranked.

    Args:
        slots: K.
        design: kind of the design; None of random codes.
        tune: planes that a network tunes: ``"none"``, ``"aperture"`` or ``"both"``.
        settings: further arguments of the camera of random codes.
    """

    slots: int
    design: str | None = None
    tune: str = "none"
    settings: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Cell:
    """One piece of work; all of a study share what stands first.

    Args:
        examples: folder of what was learned of the given scenes; ``wide``: the same with the rendered ones.
        mixture: file of a Gaussian mixture of the given scenes.
        prior: file of the decoder's prior.
        designs: folder where designs are kept.
        bands: number of bands from 400 to 700 nm.
        period: (rows, columns) of the tile, pixels.
        effort: of every search.
        source: digest of the source of the numbers.
        light: mean irradiance of the test scenes, share of white.
        kind: name in `studies.codes.study.KINDS`.
        name: that progress shows.
        noise: its name; ``sensor``: arguments of ``tmca.Sensor``.
        slots: numbers of slots K.
        seed: of searches, random codes and noise.
        exposures: that are accumulated before one readout.
        test: files of test scenes; ``checksums``: of these.
        codes: name of ``code``, which is ranked on the middles of the test scenes.
        train, validation: scenes that its network learns from, and that choose the best step.
        steps: of the optimiser; no network is trained with 0.
        folder: of the network.
    """

    examples: str
    wide: str
    mixture: str
    prior: str = ""
    designs: str
    bands: int
    period: tuple[int, int]
    effort: dict[str, int]
    source: str
    light: float | None = None
    kind: str = ""
    name: str = ""
    noise: str = ""
    sensor: dict[str, float] = field(default_factory=dict)
    slots: tuple[int, ...] = ()
    seed: int = 0
    exposures: int = 1
    test: tuple[str, ...] = ()
    checksums: tuple[str | None, ...] = ()
    codes: str = ""
    code: Code | None = None
    train: tuple[str, ...] = ()
    validation: tuple[str, ...] = ()
    steps: int = 0
    folder: str = ""

    @classmethod
    def of(cls, settings: Settings) -> Cell:
        """The cell that ``dataclasses.asdict`` made these settings of."""
        return cls(**{**settings, "code": Code(**settings["code"]) if settings["code"] else None})


class GridRow(TypedDict):
    """A design of the grid; PSNR and gains in dB, gains over the static design."""

    noise: str
    exposures: int
    kind: str
    slots: int
    psnr: float
    random_psnr: float
    gain: float
    held_out_psnr: float
    held_out_random: float
    held_out_gains: Figures
    throughput: float
    seconds: float


class TestRow(TypedDict):
    """Codes on one test scene: figures of merit by the name of the codes."""

    noise: str
    scene: str
    seed: int
    metrics: dict[str, Figures]


class LightRow(TestRow):
    """The same for codes that were designed for the light of the test scenes.

    ``metrics`` are of a dimmed prior, ``plain_prior`` of the prior as it was learned; ``there`` is the gain that is
    predicted for the scene's light, dB.
    """

    plain_prior: dict[str, Figures]
    there: Figures


class RankedRow(TypedDict):
    """One code: expected PSNR, and that of decoders by scene, dB; of networks at the corners with their seed."""

    noise: str
    codes: str
    seed: NotRequired[int]
    expected: float
    expected_mixture: NotRequired[float]
    lmmse: Figures
    unrolled: NotRequired[Figures]
    throughput: float
    expected_there: NotRequired[float]


class IngredientRow(TypedDict):
    """Gain over the static design, expected and under the prior of the other scenes, dB."""

    ingredient: str
    gain: float
    held_out: float
    throughput: float


class AblationRow(TypedDict):
    """All ingredients under one noise."""

    noise: str
    rows: list[IngredientRow]


class Correlation(TypedDict):
    """Spearman's rank correlations of expected PSNR with a decoder's."""

    noise: str
    decoder: str
    codes: int
    rank_correlation: float
    rank_correlation_there: float
    mixture_rank_correlation: float


class Results(TypedDict):
    """What ``codes.json`` holds; ``note`` is of numbers that were measured later."""

    command: str
    commit: str | None
    note: NotRequired[str]
    effort: dict[str, int]
    steps: int
    period: list[int]
    slots: int
    split: dict[str, list[str]]
    mean_irradiance: float | None
    grid: list[GridRow]
    test: list[TestRow]
    light: list[LightRow]
    ranking: list[RankedRow]
    network: list[RankedRow]
    ablation: list[AblationRow]
    rank_correlation: list[Correlation]
