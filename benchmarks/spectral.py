"""Ratios of the spectral camera's operators to a plain copy of the cube, in one run: ``python benchmarks/spectral.py``.

One thread, CPU time, medians. Bounds: forward and adjoint ≤ 2.5 copies; at K = 8 and the first shape, code and forward
≤ 0.35 of slot by slot, gradient to aperture and shutter ≤ 10 copies, forward and backward within 3 cubes of memory; two
buckets ≤ 2.2 times one.
"""

from __future__ import annotations

import torch
from timing import asked, milliseconds, peak_memory, show, times_as_long
from torch import Tensor

from tmca.codes import pattern
from tmca.operators import of_buckets, single_disperser
from tmca.optics import Dispersion

SHAPES = ((8, 12, 128, 128), (1, 28, 256, 256))
SLOTS = 8
BOUNDS = {
    "forward": 2.5,
    "adjoint": 2.5,
    "code + forward / slot by slot": 0.35,
    "gradient to codes": 10.0,
    "memory of forward + backward, cubes": 3.0,
    "forward, two buckets / one": 2.2,
    "adjoint, two buckets / one": 2.2,
}


def slot_by_slot(scene: Tensor, aperture: Tensor, shutter: Tensor) -> Tensor:
    """The plain reference: image every slot in place, one multiply-add per band, and let the shutter integrate."""
    batch, bands, rows, columns = scene.shape
    snapshot = scene.new_zeros(batch, rows, columns + bands - 1)
    for mask, open_ in zip(aperture, shutter, strict=True):
        slot = torch.zeros_like(snapshot)
        for band in range(bands):
            slot[:, :, band : band + columns].addcmul_(scene[:, band], mask)
        snapshot.addcmul_(slot, open_)
    return snapshot / len(aperture)


def planes(shape: tuple[int, int, int, int]) -> tuple[Tensor, Tensor, Dispersion]:
    """Aperture, shutter and dispersion of scenes of a shape."""
    _, bands, rows, columns = shape
    dispersion = Dispersion.linear(bands)
    shutter = pattern("random", SLOTS, (rows, columns + dispersion.extent), seed=1)
    return pattern("random", SLOTS, (rows, columns)), shutter, dispersion


def measure(shape: tuple[int, int, int, int], repeats: int) -> dict[str, float]:
    scene, target = torch.rand(shape), torch.empty(shape)
    *fixed, dispersion = planes(shape)
    aperture, shutter = (plane.clone().requires_grad_() for plane in fixed)
    operator = single_disperser(*fixed, dispersion)
    snapshot = operator.A(scene)

    def gradient() -> None:
        aperture.grad = shutter.grad = None
        single_disperser(aperture, shutter, dispersion).A(scene).backward(snapshot)

    times = {
        "copy": milliseconds(lambda: target.copy_(scene), repeats),
        "forward": milliseconds(lambda: operator.A(scene), repeats),
        "adjoint": milliseconds(lambda: operator.A_adjoint(snapshot), repeats),
        "code + forward": milliseconds(lambda: single_disperser(*fixed, dispersion).A(scene), repeats),
        "slot by slot": milliseconds(lambda: slot_by_slot(scene, *fixed), repeats),
        "gradient to codes": milliseconds(gradient, repeats),
    }
    assert torch.allclose(snapshot[:, 0], slot_by_slot(scene, *fixed), atol=1e-5)
    return times


def bucket_ratios(shape: tuple[int, int, int, int], repeats: int) -> dict[str, float]:
    """Two buckets over one, forward and adjoint."""
    scene, (aperture, shutter, dispersion) = torch.rand(shape), planes(shape)
    one, other = (single_disperser(aperture, shown, dispersion) for shown in (shutter, 1 - shutter))
    two = of_buckets([one, other])
    first, both = one.A(scene), two.A(scene)
    return {
        "forward, two buckets / one": times_as_long(lambda: two.A(scene), lambda: one.A(scene), repeats),
        "adjoint, two buckets / one": times_as_long(lambda: two.A_adjoint(both), lambda: one.A_adjoint(first), repeats),
    }


def cubes_of_memory(shape: tuple[int, int, int, int]) -> float:
    """Peak of forward and backward above the scene, the codes and their gradients, in cubes (the allocator's count)."""
    from torch.profiler import ProfilerActivity, profile

    *fixed, dispersion = planes(shape)
    scene, aperture, shutter = (part.requires_grad_() for part in (torch.rand(shape), *fixed))
    with profile(activities=[ProfilerActivity.CPU], profile_memory=True) as record:
        single_disperser(aperture, shutter, dispersion).A(scene).square().sum().backward()
    level = peak = 0
    for event in record.profiler.kineto_results.events():
        if event.name() == "[memory]":
            level += event.nbytes()
            peak = max(peak, level)
    return peak / (scene.numel() * scene.element_size())


def main() -> None:
    options = asked(__doc__, 50)
    torch.set_num_threads(1)
    found, bounds = {}, {}
    for shape in SHAPES:
        times = measure(shape, options.repeats)
        ratios = {name: times[name] / times["copy"] for name in ("forward", "adjoint", "gradient to codes")}
        ratios["code + forward / slot by slot"] = times["code + forward"] / times["slot by slot"]
        ratios |= bucket_ratios(shape, options.repeats)
        ratios["memory of forward + backward, cubes"] = cubes_of_memory(shape)
        size = "×".join(map(str, shape))
        found |= {f"{size}, milliseconds": times, f"{size}, ratios": ratios}
        bounded = BOUNDS if shape == SHAPES[0] else ("forward", "adjoint")
        bounds[f"{size}, ratios"] = {name: BOUNDS[name] for name in bounded}
    show(found | {"memory": {"peak, GB": peak_memory()}}, bounds, options.json)


if __name__ == "__main__":
    main()
