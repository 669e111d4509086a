"""``register``: a snapshot whose camera has its mask, and its bands, where the snapshot says that they lie."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from warnings import warn

import numpy as np

from tmca.arguments import described
from tmca.cameras import Snapshot
from tmca.cameras.coded import CodedCamera
from tmca.errors import DataError, SettingError
from tmca.priors import Prior, find_prior
from tmca.registration.dispersion import dispersion_std, with_dispersion
from tmca.registration.evidence import MaskEvidence
from tmca.registration.placement import NAMES, MaskPlacement
from tmca.registration.search import LAST, Climbed, deviations, gain_over_drawn, search


class NotRegistered(UserWarning):
    """A snapshot under which no place of the mask stands out: the mask stays where it was drawn."""


@dataclass(frozen=True)
class Registered:
    """A snapshot and where its mask lies.

    Args:
        snapshot: with a camera whose mask and dispersion are in place; as it was given where nothing stood out.
        placement: of the mask on the scene.
        std: standard deviations of shift down and right (pixels), rotation (degrees), scale, stretch and shear, behind
            the dispersion that was found, and of the dispersion where it is not as drawn, with the mask where it was
            found: from the curvature of the evidence, the least that they can be; NaN where it has none.
        dispersion: displacement of the bands over that which was drawn, about the middle.
        evidence_gain: of the logarithm of a block's evidence over that of the mask as drawn.
        converged: whether a place stood out; if not, the placement is that of the mask as drawn.
        seconds: that it took.
    """

    snapshot: Snapshot[Any]
    placement: MaskPlacement
    std: dict[str, float]
    dispersion: float
    evidence_gain: float
    converged: bool
    seconds: float

    def __str__(self) -> str:
        if not self.converged:
            return "not registered: no place of the mask stands out, it stays where it was drawn"
        more = "" if self.dispersion == 1 else f"; dispersion {self.dispersion:.5f} times as drawn"
        return f"mask {self.placement}{more} ({self.seconds:.0f} s)"

    def lines(self) -> list[str]:
        """The sentence of ``str``, and below it the standard deviations."""
        if not self.converged:
            return [str(self)]
        if math.isnan(self.std["down"]):
            return [str(self), "  ± not known: the evidence has no maximum there"]
        exact = "  ± {down:.3f} and {right:.3f} px, {rotation:.4f}°, {scale:.5f} of scale".format(**self.std)
        dispersion = self.std.get("dispersion")
        if dispersion is not None:
            exact += ", dispersion not known" if math.isnan(dispersion) else f", {dispersion:.5f} of dispersion"
        return [str(self), exact]

    def described(self) -> dict[str, Any]:
        """Place, dispersion and standard deviations as plain numbers, None where one is not known."""
        std = {name: value if math.isfinite(value) else None for name, value in self.std.items()}
        place = {**self.placement.described(), "dispersion": self.dispersion, "std": std}
        return {"converged": self.converged, **place, "evidence_gain": self.evidence_gain}


def register(
    snapshot: Snapshot[Any],
    prior: str | Path | Prior | None = None,
    *,
    progress: Callable[[float], None] | None = None,
) -> Registered:
    """Where the mask of a snapshot lies: the place under which the snapshot is most probable.

    The density of blocks of the snapshot under a Gaussian prior of scenes (its evidence) is climbed over shift (up to
    2.4 pixels), rotation and scale (up to 2 pixels at the frame's edge), stretch and shear (up to 1), light, blur and,
    of a spectral camera, dispersion (up to 1.5 %), from coarse to fine (evidence maximisation); no truth and no
    calibration is needed. Whether the place stands out is told by the signed ranks of blocks (Wilcoxon).

    Args:
        snapshot: of a spectral or light-field camera with masks of pixels.
        prior: Gaussian prior of scenes, its file, or None for that of the rendered scenes.
        progress: called with the share that is done.

    Raises:
        SettingError: a camera without masks of pixels, or a prior of another kind.
        DataError: values that are not finite.

    Warns:
        NotRegistered: no place stands out.

    >>> import tmca
    >>> camera = tmca.SpectralCamera(12, (64, 96), slots=1, shutter="open", sensor=tmca.Sensor(read_noise=0.01))
    >>> snapshot = tmca.simulate(tmca.read("coffee", size=(64, 96)), camera)
    >>> registered = register(snapshot)  # doctest: +SKIP
    >>> estimate = tmca.reconstruct(registered.snapshot)  # doctest: +SKIP
    """
    began, camera, device = time.perf_counter(), snapshot.camera, snapshot.values.device
    if not isinstance(camera, CodedCamera):
        raise SettingError("snapshot", f"one of {described(camera)}", "one of a camera behind masks of pixels")
    if not bool(snapshot.values.isfinite().all()):
        raise DataError("snapshot", "NaN or infinite values", "finite values", "mask or replace the bad pixels first")
    of_scenes, taken = find_prior(camera, prior, "gaussian"), snapshot.to("cpu")
    evidence = MaskEvidence(taken.camera, taken.values, of_scenes)
    climbed, factor = search(evidence, progress), 1.0
    if climbed.converged and getattr(camera, "disperser", None) == "single":
        factor, climbed, evidence = with_dispersion(taken, of_scenes, climbed, evidence)
    if not climbed.converged:
        lost = _not_registered(snapshot, evidence.size, time.perf_counter() - began)
        warn(f"{lost}", NotRegistered, stacklevel=2)
        return lost
    blocks = evidence.among(LAST.share * max(evidence.size) / 2, LAST.cells)
    std = _std(deviations(evidence, climbed.vector, blocks), evidence.size)
    of_bands = (taken, of_scenes, climbed.vector, blocks, factor - 1)
    std |= {} if factor == 1 else {"dispersion": dispersion_std(*of_bands)}
    gain, moved = gain_over_drawn(evidence, climbed.vector, blocks), _moved(taken, evidence, climbed).to(device)
    placement, seconds = MaskPlacement.of(climbed.vector, evidence.size), time.perf_counter() - began
    return Registered(moved, placement, std, factor, gain, True, seconds)


def _not_registered(snapshot: Snapshot[Any], size: tuple[int, int], seconds: float) -> Registered:
    nowhere = np.zeros(len(NAMES))
    std = _std(np.full(len(NAMES), np.nan), size)
    return Registered(snapshot, MaskPlacement.of(nowhere, size), std, 1.0, 0.0, False, seconds)


def _moved(snapshot: Snapshot[Any], evidence: MaskEvidence, climbed: Climbed) -> Snapshot[Any]:
    """The snapshot on the columns of a camera with its mask in place."""
    import torch

    with torch.no_grad():
        camera = evidence.moved(torch.as_tensor(climbed.vector, dtype=torch.float32))
    return replace(snapshot, values=evidence.values, camera=camera)


def _std(deviation: np.ndarray, size: tuple[int, int]) -> dict[str, float]:
    """By name, in pixels, degrees and shares."""
    half = max(size) / 2
    down, right, turn, *rest = map(float, deviation[:6])
    shares = dict(zip(("scale", "stretch", "shear"), (one / half for one in rest), strict=True))
    return {"down": down, "right": right, "rotation": math.degrees(turn / half), **shares}
