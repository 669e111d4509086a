"""Ratios of the light-field operators to a plain copy of the views: ``python benchmarks/light_field.py``.

One thread, CPU time, medians, 5×5 views of 270×480. Bounds: forward and adjoint ≤ 2.5 copies; at K = 8 and batch 4,
code and forward ≤ 0.6 of slot by slot.
"""

from __future__ import annotations

from itertools import product

import torch
from timing import asked, milliseconds, show
from torch import Tensor

from tmca.codes import pattern
from tmca.operators import coded_mask
from tmca.optics import ViewShear, view_coordinates

VIEWS, SIZE, SLOTS, BATCH = (5, 5), (270, 480), 8, 4
BOUNDS = {"forward": 2.5, "adjoint": 2.5, "code + forward / slot by slot": 0.6}


def slot_by_slot(scene: Tensor, aperture: Tensor, shutter: Tensor) -> Tensor:
    """The plain reference: every slot's views through its shifted mask, one multiply-add per view, then its shutter."""
    height, width = scene.shape[-2:]
    places = list(product(view_coordinates(VIEWS[0]), view_coordinates(VIEWS[1])))
    snapshot = scene.new_zeros(len(scene), height, width)
    for mask, open_ in zip(aperture, shutter, strict=True):
        slot = torch.zeros_like(snapshot)
        for view, (v, u) in enumerate(places):
            slot.addcmul_(scene[:, view], mask[2 + v : 2 + v + height, 2 + u : 2 + u + width])
        snapshot.addcmul_(slot, open_)
    return snapshot / len(aperture)


def measure(repeats: int) -> dict[str, float]:
    shear = ViewShear(VIEWS)
    aperture = pattern("random", SLOTS, shear.mask_size(SIZE))
    shutter = pattern("random", SLOTS, SIZE, seed=1)
    operator = coded_mask(aperture, shutter, shear)
    one, four = torch.rand(1, 25, *SIZE), torch.rand(BATCH, 25, *SIZE)
    target, snapshot = torch.empty_like(one), operator.A(one)
    assert torch.allclose(operator.A(four)[:, 0], slot_by_slot(four, aperture, shutter), atol=1e-4)
    return {
        "copy": milliseconds(lambda: target.copy_(one), repeats),
        "forward": milliseconds(lambda: operator.A(one), repeats),
        "adjoint": milliseconds(lambda: operator.A_adjoint(snapshot), repeats),
        "code + forward, batch": milliseconds(lambda: coded_mask(aperture, shutter, shear).A(four), repeats),
        "slot by slot, batch": milliseconds(lambda: slot_by_slot(four, aperture, shutter), repeats),
    }


def main() -> None:
    arguments = asked(__doc__, 15)
    torch.set_num_threads(1)
    times = measure(arguments.repeats)
    ratios = {name: times[name] / times["copy"] for name in ("forward", "adjoint")}
    ratios["code + forward / slot by slot"] = times["code + forward, batch"] / times["slot by slot, batch"]
    show({"milliseconds": times, "ratios": ratios}, {"ratios": BOUNDS}, arguments.json)


if __name__ == "__main__":
    main()
