"""What the study of codes asks for, cell by cell, and the rows that its files hold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NotRequired, TypedDict

from studies.grid import Settings

Figures = dict[str, float]
"""Figures of merit, or one of them scene by scene."""


@dataclass(frozen=True, kw_only=True)
class Cell:
    """One piece of work; all designs of a study share what stands first.

    Args:
        examples: folder of what was learned of the given scenes.
        wide: the same with the rendered ones.
        mixture: file of a Gaussian mixture of the given scenes.
        designs: folder where designs are kept.
        bands: number of bands from 400 to 700 nm.
        period: (rows, columns) of the tile, pixels.
        effort: of every search.
        source: digest of the source of the numbers.
        kind: name in `studies.codes.study.KINDS`.
        name: that progress shows.
        noise: its name.
        sensor: arguments of ``tmca.Sensor``.
        slots: numbers of slots K.
        seed: of searches, random codes and noise.
        exposures: that are accumulated before one readout.
        light: mean irradiance of the test scenes, share of white.
        prior: file of the decoder's prior.
    """

    examples: str
    wide: str
    mixture: str
    designs: str
    bands: int
    period: tuple[int, int]
    effort: dict[str, int]
    source: str
    kind: str = ""
    name: str = ""
    noise: str = ""
    sensor: dict[str, float] = field(default_factory=dict)
    slots: tuple[int, ...] = ()
    seed: int = 0
    exposures: int = 1
    light: float | None = None
    prior: str = ""


@dataclass(frozen=True, kw_only=True)
class SceneCell(Cell):
    """Designs on one test scene.

    Args:
        scene: its name.
        path: of its file.
        checksum: of the file, None of a rendered scene.
    """

    scene: str
    path: str
    checksum: str | None


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


@dataclass(frozen=True)
class Training:
    """Networks behind the codes.

    Args:
        scenes: that they learn from.
        validation: that choose the best step.
        checksums: of both.
        steps: of the optimiser; no network is trained with 0.
    """

    scenes: tuple[str, ...]
    validation: tuple[str, ...]
    checksums: tuple[str | None, ...]
    steps: int


@dataclass(frozen=True, kw_only=True)
class CodeCell(Cell):
    """One code on the middles of the test scenes.

    Args:
        codes: name of the code.
        code: the code.
        test: files of the test scenes.
        checksums: of these.
        size: (H, W) of their middles, pixels.
        training: of a network for this code.
        folder: of the network.
    """

    codes: str
    code: Code
    test: tuple[str, ...]
    checksums: tuple[str | None, ...]
    size: tuple[int, int]
    training: Training
    folder: str = ""


def cell_of(settings: Settings) -> Cell:
    """The cell that ``dataclasses.asdict`` made these settings of."""
    if "code" in settings:
        parts = {"code": Code(**settings["code"]), "training": Training(**settings["training"])}
        return CodeCell(**{**settings, **parts})
    return SceneCell(**settings) if "scene" in settings else Cell(**settings)


class DesignRow(TypedDict):
    """A design of the grid; PSNR and gains in dB, gains over the static design."""

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


class GridRow(DesignRow):
    """The same with its noise and the exposures that are accumulated."""

    noise: str
    exposures: int


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
    """One code: expected PSNR, and that of decoders by scene, in dB."""

    noise: str
    codes: str
    expected: float
    expected_mixture: float
    lmmse: Figures
    unrolled: NotRequired[Figures]
    throughput: float
    expected_there: NotRequired[float]


class NetworkRow(TypedDict):
    """A network behind one code: PSNR in dB, of decoders by scene."""

    noise: str
    codes: str
    seed: int
    expected: float
    lmmse: Figures
    unrolled: Figures
    throughput: float


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
    network: list[NetworkRow]
    ablation: list[AblationRow]
    rank_correlation: list[Correlation]
