"""What every decoder holds to on a camera."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, replace
from math import prod
from typing import Any

import torch
from torch import Tensor
from torch.nn.functional import interpolate

from tmca.cameras import Camera, Snapshot
from tmca.decoders import Decoder, Estimate, decode, make_decoder, settings_of
from tmca.errors import SettingError
from tmca.testing.comparing import close, drawn, refused, run, same_shape, say

_PARTS = ("values", "deviation", "depth", "confidence", "planes", "depth_deviation")


@dataclass(frozen=True)
class DecoderCase:
    """A decoder under test.

    Args:
        decoder: with its settings.
        camera: that it decodes.
        values: (2, *snapshot_shape) snapshots of it, of unequal brightness.
        prior: of a decoder that uses one.
        shared: difference between a batch and its snapshots one by one, of decoders that decide something for all.
        rounded: difference between single and double precision.
    """

    decoder: Any
    camera: Any
    values: Tensor
    prior: Any = None
    shared: float = 1e-4
    rounded: float = 2e-2

    def decode(self, values: Tensor | None = None, camera: Any = None, **how: Any) -> Estimate:
        """The estimate of snapshots, those of the case unless others are given."""
        taken = Snapshot(self.values if values is None else values, self.camera if camera is None else camera)
        return decode(taken, self.decoder, prior=self.prior, **how)

    def uncertain(self) -> DecoderCase:
        """The same, asked for the deviation where the decoder predicts one."""
        return replace(self, decoder=replace(self.decoder, uncertainty=True)) if self.decoder.deviation else self


def check_decoder(
    decoder: Decoder | type[Decoder] | str,
    camera: Camera,
    *,
    prior: Any = None,
    values: Tensor | None = None,
    shared: float = 1e-4,
) -> None:
    """Check what a decoder does: shapes, equal estimates of equal snapshots, batches, darkness, precision, devices.

    Args:
        decoder: an object with few iterations, so that it is quick; of a class or a name a setting ``iterations`` is 3.
        camera: a small one that it decodes, of odd sides at best.
        prior: of a decoder that uses one; that of the rendered scenes without.
        values: (2, *snapshot_shape) snapshots; smooth scenes with some noise without, of cameras without depth.
        shared: largest difference between a batch and its snapshots one by one, of a decoder that decides something for
            all of them together.

    Raises:
        AssertionError: one line: what does not hold.
    """
    made = make_decoder(decoder, camera.kind)
    if made is not decoder and any(setting.name == "iterations" for setting in settings_of(type(made))):
        made = replace(made, iterations=3)  # type: ignore[call-arg]
    taken = smooth_snapshots(camera) if values is None else values
    run(CHECKS, DecoderCase(made, camera, taken, prior, shared), type(made).__name__)


def smooth_snapshots(camera: Camera) -> Tensor:
    """(2, *snapshot_shape) of two smooth scenes of unequal brightness."""
    *front, height, width = camera.scene_shape
    coarse = drawn(1, prod(front), 4, 4, dtype=torch.float32, device=torch.device("cpu"))
    scene = interpolate(coarse, (height, width), mode="bilinear").reshape(1, *camera.scene_shape)
    with torch.no_grad():
        return camera(torch.cat((scene, 0.4 * scene)).to(next(camera.buffers()).device), generator=0)


def tensors(estimate: Estimate) -> dict[str, Tensor]:
    """What there is of an estimate."""
    return {name: getattr(estimate, name) for name in _PARTS if getattr(estimate, name) is not None}


def shapes_are_as_stated_and_equal_snapshots_have_equal_estimates(case: DecoderCase) -> None:
    """And the share that is reported rises to at most one."""
    case, shares = case.uncertain(), list[float]()
    first = case.decode(progress=lambda share, *_: shares.append(share))
    again, shape = case.decode(), (len(case.values), *case.decoder.scene_shape(case.camera))
    say(shares == sorted(shares) and all(0 < share <= 1 + 1e-9 for share in shares), f"progress of {shares[-3:]}")
    same_shape(first.values.shape, shape, "the estimate")
    say(not case.decoder.clips or float(first.values.min()) >= 0, "negative values of a decoder that clips")
    for name, part in tensors(first).items():
        say(bool(part.isfinite().all()), f"{name} that are not finite")
        say(torch.equal(part, tensors(again)[name]), f"{name} differ from one call to the next: seed what is random")
    if case.decoder.deviation:
        say(first.deviation is not None, "no deviation, though it was asked for")
        same_shape(tensors(first)["deviation"].shape, shape, "the deviation")
    say(first.decoder == case.decoder.name and len(repr(first)) < 500, f"an estimate is said to be {first!r}")


def a_batch_is_its_snapshots_one_by_one(case: DecoderCase) -> None:
    """To what the decoder decides for all of them together."""
    prepared = case.decoder.prepare(case.camera, case.prior)
    together = prepared(case.values).values
    alone = torch.cat([prepared(one).values for one in case.values.split(1)])
    close(together, alone, "a batch, and its snapshots one by one,", atol=case.shared, rtol=1e-3)


def prepared_it_decodes_as_it_does_at_once(case: DecoderCase) -> None:
    """And an earlier frame leaves nothing behind."""
    prepared = case.decoder.prepare(case.camera, case.prior)
    prepared(case.values.flip(0))
    tolerance = 1e-4 if any(getattr(prepared.state, part, None) for part in ("bank", "kept")) else 0
    close(prepared(case.values).values, case.decode().values, "prepared, and at once,", atol=tolerance, rtol=0)


def darkness_gives_numbers(case: DecoderCase) -> None:
    """A snapshot of zeros has an estimate."""
    dark = case.decode(torch.zeros_like(case.values[:1]))
    say(all(bool(part.isfinite().all()) for part in tensors(dark).values()), "values that are not finite")


def unknown_settings_are_refused(case: DecoderCase) -> None:
    """By their name."""
    refused(lambda: case.decode(no_such_setting=1), SettingError, "a setting that there is not")


def double_precision_stays_double(case: DecoderCase) -> None:
    """And says the same as single precision."""
    double = case.decode(case.values.double(), deepcopy(case.camera).double()).values
    say(double.dtype == torch.float64, f"snapshots in double precision have estimates of {double.dtype}")
    if not case.decoder.moving:
        single = case.decode().values
        close(double.float(), single, "double precision, and single,", atol=case.rounded, rtol=1e-2)


def a_graphics_processor_decodes_alike(case: DecoderCase) -> None:
    """Where there is one; the camera stays where it is."""
    if not torch.cuda.is_available():
        return
    case = case.uncertain()
    here, there = case.decode(), case.decode(device="cuda")
    say(all(one.device.type == "cpu" for one in case.camera.buffers()), "the camera was moved")
    atol = max(2e-3, 0.4 * case.shared)
    for name, part in tensors(there).items():
        say(part.device.type == "cuda", f"{name} on {part.device.type}")
        if name != "planes":
            close(part.cpu(), tensors(here)[name], f"{name} of a CUDA device", atol=atol, rtol=1e-2)


CHECKS = (
    shapes_are_as_stated_and_equal_snapshots_have_equal_estimates,
    a_batch_is_its_snapshots_one_by_one,
    prepared_it_decodes_as_it_does_at_once,
    darkness_gives_numbers,
    unknown_settings_are_refused,
    double_precision_stays_double,
    a_graphics_processor_decodes_alike,
)
