"""How the buckets of a pixel share its light: from even light sorted into each of them, and into all in turn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import ArrayLike

from tmca.codes.buckets import changing, mixed_buckets
from tmca.errors import DataError
from tmca.lab.calibration.fitting import fit_std
from tmca.lab.frames import Array
from tmca.specs.hardware import MOST_SORTED_WRONG


@dataclass(frozen=True)
class BucketMixing:
    """Light of R buckets.

    Args:
        levels: (R, R) in every bucket with all slots in one of them, (R + 1, R) with slots in turn at the end; shares
            of all light.
        predicted: the same by the fit.
        leakage: share that a bucket loses to the others, evenly.
        transfer: time after a change of bucket in which light reaches none, share of a slot.
        std: (2,) of both, from the fit; NaN where it is not known.
        residual: rms of what the fit leaves, as a share of the light.
    """

    levels: Array
    predicted: Array
    leakage: float
    transfer: float
    std: Array
    residual: float

    def unmixed(self, light: ArrayLike) -> Array:
        """(N, R) light of buckets without what leaked between them."""
        return np.asarray(np.linalg.solve(_mixing(self.levels.shape[1], self.leakage), np.asarray(light).T).T)


def measure_buckets(levels: ArrayLike, slots: int, *, source: object = "buckets") -> BucketMixing:
    """Fit light, leakage and transfer time, 0 or more, to mean levels.

    Args:
        levels: (R, R) mean light above the dark, over the flat, of every bucket with all slots in one of them;
            (R + 1, R) with slots sorted into the buckets in turn at the end, of which the transfer time follows.
        slots: K of these turns.
        source: named in errors.

    Raises:
        DataError: no light, or more than half of it in other buckets.
    """
    from scipy.optimize import least_squares

    seen = np.asarray(levels, dtype=np.float64)
    buckets = seen.shape[1]
    if not seen.max() > 0:
        raise DataError(source, "no light in any bucket", "even light", "check the lamp and the codes of the frames")
    shares, turns = seen / float(seen[:buckets].sum() / buckets), len(seen) > buckets
    shown = _sorted_slots(buckets, slots)[:, :, : len(seen)]

    def predicted(values: Array) -> Array:
        light, leakage, transfer = values[0], values[1], values[2] if turns else 0.0
        return np.asarray(light * mixed_buckets(shown - transfer * changing(shown), leakage).mean(1).T)

    bounds = ([0.0] * (2 + turns), [np.inf, 1.0, 1.0][: 2 + turns])
    start = np.array([1.0, 0.01, 0.01])[: 2 + turns]
    fit = least_squares(lambda v: (predicted(v) - shares).ravel(), start, bounds=bounds, xtol=1e-12, ftol=1e-14)
    leakage, std = float(fit.x[1]), np.full(2, np.nan)
    if leakage > MOST_SORTED_WRONG:
        what, remedy = f"{leakage:.0%} of a bucket's light in others", "check that the buckets are not exchanged"
        raise DataError(source, what, f"{MOST_SORTED_WRONG:.0%} at most", remedy)
    std[: 1 + turns] = fit_std(fit)[1:]
    transfer = float(fit.x[2]) if turns else 0.0
    return BucketMixing(shares, predicted(fit.x), leakage, transfer, std, float(np.sqrt((fit.fun**2).mean())))


def _sorted_slots(buckets: int, slots: int) -> torch.Tensor:
    """(R, K, R + 1) the buckets of K slots: all in one of them, and all in turn at the end."""
    own = torch.eye(buckets, dtype=torch.float64)
    each, in_turn = own[:, :, None].expand(-1, -1, slots), own[:, torch.arange(slots) % buckets]
    return torch.cat((each, in_turn[:, None]), 1).transpose(1, 2)


def _mixing(buckets: int, leakage: float) -> Array:
    """(R, R) share of the light sorted into a bucket (columns) that is in each of them (rows)."""
    return np.asarray(mixed_buckets(torch.eye(buckets, dtype=torch.float64), leakage))
