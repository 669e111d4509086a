"""Public data sets whose files carry no wavelengths, recognised by band count and variable name.

CAVE: Yasuma et al. 2010. ICVL: Arad & Ben-Shahar 2016. Harvard: Chakrabarti &
    Zickler 2011.
TSA-Net: Meng et al. 2020 (the bands of its simulated scenes). Flower-stars: Diaz et al. 2018 (band edges
given; the centres are used). Samson: the 95 x 95 crop of the airborne scene.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_FLOWER_EDGES_NM = (
    *((423, 436), (437, 448), (449, 463), (464, 479), (480, 499), (500, 521)),
    *((522, 546), (547, 577), (578, 618), (619, 673), (674, 700)),
)
_TSA_NM = (
    *(453.3, 457.6, 462.1, 466.8, 471.6, 476.5, 481.6, 486.9, 492.4, 498.0, 503.9, 509.9, 516.2, 522.7),
    *(529.5, 536.5, 543.8, 551.4, 558.6, 567.5, 575.3, 584.3, 594.4, 604.2, 614.4, 625.1, 636.3, 648.1),
)


def _steps(first: float, last: float, count: int) -> tuple[float, ...]:
    return tuple(float(nm) for nm in np.linspace(first, last, count))


@dataclass(frozen=True)
class KnownSet:
    """A data set's signature and what its files leave unsaid.

    Attributes:
        name: the set.
        nm: band centres in nanometres.
        variables: names under which its files keep the cube; empty if the band count alone tells.
        full_scale: the count that stands for 1 where it is not the dtype's maximum.
    """

    name: str
    nm: tuple[float, ...]
    variables: frozenset[str] = frozenset()
    full_scale: float | None = None

    @property
    def label(self) -> str:
        """How the origin of the wavelengths is told to the user."""
        return f"known set {self.name}, {self.nm[0]:g}-{self.nm[-1]:g} nm"


KNOWN_SETS = (
    KnownSet("ICVL", _steps(400, 700, 31), frozenset({"rad"}), full_scale=4095.0),
    KnownSet("Harvard", _steps(420, 720, 31), frozenset({"ref"})),
    KnownSet("CAVE", _steps(400, 700, 31)),
    KnownSet("TSA-Net simulation", _TSA_NM, frozenset({"img", "img_expand", "data_slice"})),
    KnownSet("flower-stars", tuple((a + b) / 2 for a, b in _FLOWER_EDGES_NM), frozenset({"Ori"})),
    KnownSet("Samson", _steps(401, 889, 156)),
)
"""In order of precedence: sets that ask for a variable name come before those that go by count alone."""


def find_known(variable: str, bands: int) -> KnownSet | None:
    """The known set with this many bands whose files call the cube ``variable``."""
    short = variable.rsplit("/", 1)[-1]
    fits = (known for known in KNOWN_SETS if len(known.nm) == bands)
    return next((known for known in fits if not known.variables or short in known.variables), None)
