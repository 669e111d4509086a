"""Rows of the report on real captures, and what its file holds; errors are shares of a snapshot's norm."""

from __future__ import annotations

from typing import Any, TypedDict


class SceneRow(TypedDict):
    """One capture by one decoder."""

    scene: str
    decoder: str
    seconds: float
    reprojection: float
    withheld: float
    neighbours: float


class PairRow(TypedDict):
    """How far two decoders agree on one capture: PSNR in dB, spectral angle in degrees."""

    scene: str
    one: str
    other: str
    psnr: float
    sam: float


class ControlRow(TypedDict):
    """A scene that is known, behind the mask of a capture: errors against the truth, and what withheld pixels say."""

    scene: str
    decoder: str
    psnr: float
    sam: float
    withheld: float
    truth: float
    neighbours: float


class MovieRow(TypedDict):
    """Frames of one capture by one decoder; errors of withheld pixels, and of those where something moved."""

    capture: str
    decoder: str
    seconds: float
    reprojection: float
    withheld: float
    neighbours: float
    withheld_moving: float
    neighbours_moving: float
    agreement_psnr: float


class OrderErrors(TypedDict):
    """Of a decoder that takes the bands in one order."""

    withheld: float
    reprojection: float


class Geometry(TypedDict):
    """What captures say of mask, displacement and order of bands.

    ``explained`` is the share of the captures' fine structure by how the mask lies, ``light`` that of the copies of the
    mask at ``offsets`` in columns; ``deviation`` is that of blocks from ``registration``, pixels.
    """

    explained: dict[str, float]
    explained_registered: float
    offsets: list[int]
    light: list[float]
    registration: dict[str, Any]
    deviation: float
    order: dict[str, dict[str, OrderErrors]]


class Network(TypedDict):
    """Which network decodes, from which start, and its steps of adaptation at most."""

    weights: str
    kind: str
    start: str
    adapt: int


class Results(TypedDict):
    """What ``real.json`` holds."""

    command: str
    commit: str | None
    geometry: Geometry
    network: Network | None
    rows: list[SceneRow]
    pairs: list[PairRow]
    control: list[ControlRow]
    movies: list[MovieRow]
