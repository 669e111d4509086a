"""Phase unwrapping by graph cuts: PUMA, whose cuts are scipy's maximum flows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_TURN = 2 * np.pi
_UNITS = 1000
"""Whole units of flow per unit of energy: scipy's flows are whole numbers."""
_MOVES = 200


def graph_cut_unwrap(phase: Array, inside: NDArray[np.bool_], start: Array, threshold: float = np.pi) -> Array:
    """Whole turns that make neighbours agree: the sum over neighbours of ``min(|difference|, threshold)²`` goes down.

    From ``start`` binary moves (some pixels a turn up, or a turn down) are found as minimum cuts until none lowers the
    energy: PUMA of Bioucas-Dias and Valadão, IEEE Trans. Image Process. 16, 2007. Without a threshold (``inf``) the
    energy is convex and the result its minimum; the truncation keeps true jumps, where pairs that no cut can express
    take the nearest energy above that one can (their majorise–minimise step). The cuts are
    `scipy.sparse.csgraph.maximum_flow`: the usual library for them, PyMaxflow, is under the GPL, which this package's
    licence cannot take in.

    Args:
        phase: ``(H, W)`` wrapped, radians.
        inside: the pixels to unwrap; the others keep ``start``.
        start: ``(H, W)`` an unwrapping to begin from; made congruent to ``phase`` first.
        threshold: of differences in radians; ``inf`` for none.

    Returns:
        ``(H, W)`` radians, congruent to ``phase`` inside.
    """
    first, second = _neighbours(inside)
    values = (phase + _TURN * np.round((start - phase) / _TURN))[inside]
    energy = _energy(values[first] - values[second], threshold).sum()
    quiet, up = 0, True
    for _ in range(_MOVES):
        moved = values + (_TURN if up else -_TURN) * _best_move(values, first, second, up, threshold)
        lower = _energy(moved[first] - moved[second], threshold).sum()
        if lower < energy * (1 - 1e-9) - 1e-9:
            values, energy, quiet = moved, lower, 0
        else:
            quiet, up = quiet + 1, not up
        if quiet == 2:
            break
    result = start.copy()
    result[inside] = values
    return result


def _energy(difference: Array, threshold: float) -> Array:
    return np.minimum(np.abs(difference), threshold) ** 2


def _neighbours(inside: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs of pixels inside, side by side or one above the other, by their number among those inside."""
    number = np.cumsum(inside).reshape(inside.shape) - 1
    across, down = inside[:, 1:] & inside[:, :-1], inside[1:] & inside[:-1]
    first = np.concatenate([number[:, :-1][across], number[:-1][down]])
    return first, np.concatenate([number[:, 1:][across], number[1:][down]])


def _best_move(
    values: Array, first: NDArray[np.int64], second: NDArray[np.int64], up: bool, threshold: float
) -> NDArray[np.bool_]:
    """The pixels that a turn up (down) moves to the lowest energy, by a minimum cut."""
    step = _TURN if up else -_TURN
    difference = values[first] - values[second]
    stay = _energy(difference, threshold)
    alone, other = _energy(difference + step, threshold), _energy(difference - step, threshold)
    # a cut can express the pair only if both moves alone cost at least as much as none: raise the dearer one
    lack = np.maximum(2 * stay - alone - other, 0)
    alone, other = alone + np.where(alone >= other, lack, 0), other + np.where(alone >= other, 0, lack)
    # pair energy: stay + (alone - stay) x₁ + (stay - alone) x₂ + (alone + other - 2 stay) x₂ (1 - x₁)
    cost = np.bincount(first, alone - stay, len(values)).astype(np.float64)
    cost -= np.bincount(second, alone - stay, len(values))
    return _cut(cost, first, second, alone + other - 2 * stay)


def _cut(cost: Array, first: NDArray[np.int64], second: NDArray[np.int64], weight: Array) -> NDArray[np.bool_]:
    """The x in {0, 1} that minimises ``Σ cost x + Σ weight x₂ (1 - x₁)``: x is 1 on the sink's side."""
    from scipy.sparse import coo_array, csr_array
    from scipy.sparse.csgraph import breadth_first_order, maximum_flow

    count = len(cost)
    source, sink, pixel = count, count + 1, np.arange(count)
    paid, won = cost > 0, cost < 0
    tails = np.concatenate([first, np.full(paid.sum(), source), pixel[won]])
    heads = np.concatenate([second, pixel[paid], np.full(won.sum(), sink)])
    flows = np.concatenate([weight, cost[paid], -cost[won]])
    room = coo_array((np.round(flows * _UNITS).astype(np.int32), (tails, heads)), shape=(count + 2,) * 2).tocsr()
    left = csr_array(room - maximum_flow(room, source, sink).flow)
    left.eliminate_zeros()
    reached = breadth_first_order(left, source, return_predecessors=False)
    moved = np.ones(count + 2, dtype=bool)
    moved[reached] = False
    return moved[:count]
