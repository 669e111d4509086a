"""The camera's frames of projected fringes: all there, in order, neither saturated nor dark."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tmca.errors import DataError
from tmca.lab.frames import Frames, check_distinct, read_frames
from tmca.lab.structured_light.fringes import FringePlan
from tmca.lab.structured_light.phase import Array, Phases
from tmca.lab.structured_light.unwrap import rung_offsets

_SATURATED, _LIT = 0.5, 0.01
"""Shares of the pixels: more saturated, or fewer lit ones than these, and the capture is refused."""
_CONTRAST = 8.0
"""A lit pixel's swing over the steps, in standard deviations of the noise."""
_NO_COSINE = 0.125
"""Share of a pixel's variation over the steps that may be no cosine. A projector's gamma of 2.2 leaves 0.08, one of 2.6
0.11, noise at the least contrast 0.01 of four steps; one of four steps that shows another's fringes 0.14 or more."""
_AGREE, _TURNED = 0.5, 1.0
"""Frequencies in order agree on more than this (1 is all pixels alike), and to fewer radians."""


_OTHER_LIGHT = 0.15
"""Share of a step's part in the mean, of the fringes' amplitude, by which frequencies may differ in it at most pixels,
beside twice their noise. A frame of another frequency among the steps takes 0.3 to 0.5."""


@dataclass(frozen=True)
class Capture:
    """``values`` ``(F, N, H, W)`` digital numbers, ``saturated`` ``(H, W)`` in any frame."""

    source: Path
    values: NDArray[np.float32]
    saturated: NDArray[np.bool_]
    step: float


def read_capture(path: str | Path, plan: FringePlan, saturation: float | None = None) -> Capture:
    """Read what the camera saw of a plan's fringes.

    Frames are known by the plan's names (``fringe_0016_02.png``); where none has such a name they count in the order of
    their own names, or of the stack.

    Args:
        path: folder of frames or stack, as for `tmca.lab.frames.read_frames`.
        plan: what was projected.
        saturation: see `tmca.lab.frames.read_frames`.

    Raises:
        DataError: missing frames, too many of them, copies among them, or more than half of the pixels saturated.
    """
    frames = read_frames(path, saturation)
    chosen = _in_order(frames, plan)
    values, saturated = frames.values[chosen], frames.saturated[chosen]
    share = saturated.any(axis=0).mean()
    if share > _SATURATED:
        worst = frames.names[chosen[int(saturated.mean(axis=(1, 2)).argmax())]]
        found = f"{share:.0%} of the pixels saturated (most in {worst})"
        raise DataError(path, found, f"{_SATURATED:.0%} at most", "expose for less time")
    check_distinct(replace(frames, names=tuple(frames.names[i] for i in chosen), values=values))
    shape = (len(plan.fringes), plan.steps, *values.shape[1:])
    return Capture(Path(path), values.reshape(shape), np.asarray(saturated.any(axis=0)), frames.step)


def _in_order(frames: Frames, plan: FringePlan) -> list[int]:
    """Index of each of the plan's frames."""
    there, wanted = {name.lower(): i for i, name in enumerate(frames.names)}, plan.names
    if any(name in there for name in wanted):
        gone = [name for name in wanted if name not in there]
        if gone:
            found = f"no {', '.join(gone[:3])}{' …' if len(gone) > 3 else ''} ({len(gone)} of {len(wanted)} missing)"
            raise DataError(frames.source, found, f"all {len(wanted)} frames of the plan", "capture them again")
        return [there[name] for name in wanted]
    if len(frames.names) != len(wanted):
        expected = f"{len(wanted)}: {len(plan.fringes)} frequencies of {plan.steps} steps"
        remedy = f"name them {wanted[0]} … {wanted[-1]}, or pass the manifest they were projected from"
        raise DataError(frames.source, f"{len(frames.names)} frames", expected, remedy)
    return list(range(len(wanted)))


def check_light(capture: Capture, plan: FringePlan) -> None:
    """Refuse frequencies of which a frame is dark, or lit by something else.

    The steps of a frequency add up to the same light at every pixel, whichever frequency it is; a frame without light
    takes a number-of-steps-th of the fringes' amplitude away.

    Raises:
        DataError: naming the frequency and the frame, where it is more than half of that.
    """
    inside, steps = ~capture.saturated, plan.steps
    light = capture.values[:, :, inside].mean(axis=2, dtype=np.float64)
    mean, amplitude = light.mean(axis=1), np.median(np.ptp(capture.values, axis=1)[:, inside].mean(axis=1)) / 2
    if np.ptp(mean) <= amplitude / (2 * steps):
        return
    away = mean - np.median(mean)
    worst = int(np.abs(away).argmax()) if len(mean) > 2 else int(mean.argmin())
    dark = away[worst] < 0
    frame = plan.names[worst * steps + int(light[worst].argmin() if dark else light[worst].argmax())]
    of = f"light on frames of {plan.fringes[worst]} fringes than on others (look at {frame})"
    found = f"{'less' if dark else 'more'} {of}"
    raise DataError(capture.source, found, "the same light in all", _remedy(plan) + ", or capture them again")


def lit_pixels(capture: Capture) -> NDArray[np.bool_]:
    """Pixels ``(H, W)`` whose light changes over the steps of every frequency, whatever their order.

    Raises:
        DataError: hardly any.
    """
    swing = np.ptp(capture.values, axis=1).min(axis=0)
    floor = _CONTRAST * max(_frame_noise(capture.values), capture.step / np.sqrt(12))
    lit = (swing > floor) & ~capture.saturated
    if lit.mean() < _LIT:
        found = f"fringes on {lit.mean():.1%} of the pixels (the median swing is {np.median(swing):.3g})"
        raise DataError(capture.source, found, f"{_LIT:.0%} or more", "give more light, or put the frames in order")
    return np.asarray(lit)


def _frame_noise(values: NDArray[np.float32]) -> float:
    """Standard deviation of a frame's noise: the smaller of two estimates, each of which can only be too large.

    One is from second differences between neighbours, where texture counts too; the other from the mean light of each
    frequency, which is the same in any order but not where a frame is missing.
    """
    from scipy.stats import chi2

    frequencies, steps = values.shape[:2]
    mixed = np.diff(np.diff(values[0, :2], axis=-1), axis=-2)
    between = float(np.median(np.abs(mixed)) / 0.6745 / 2)
    if frequencies == 1:
        return between
    spread = values.mean(axis=1, dtype=np.float64).var(axis=0, ddof=1)
    return min(between, float(np.sqrt(steps * np.median(spread) * (frequencies - 1) / chi2.median(frequencies - 1))))


def check_order(capture: Capture, plan: FringePlan, phases: Phases, lit: NDArray[np.bool_]) -> None:
    """Refuse frames that are out of order, by the light in them.

    The steps of a frequency have to make a cosine (four steps or more) and to add up to the light of the others. The
    frequencies have to tell the same phase; steps that begin elsewhere turn it. A shift that all frequencies share can
    stay unseen.

    Raises:
        DataError: naming the frequency.
    """
    remedy = _remedy(plan)
    for count, misfit in zip(plan.fringes, phases.misfit, strict=True):
        if np.median(misfit[lit]) > _NO_COSINE:
            found = f"frames of {count} fringes of whose variation {np.median(misfit[lit]):.0%} is no cosine"
            raise DataError(capture.source, found, f"{plan.steps} steps in order", remedy)
    _check_sums(capture, plan, phases, lit & _clear(phases))
    for count, mean in rung_offsets(phases, plan.fringes, lit & _clear(phases)):
        if abs(mean) < _AGREE or abs(np.angle(mean)) > _TURNED:
            how = "from pixel to pixel" if abs(mean) < _AGREE else f"by {np.angle(mean):.2f} rad"
            found = f"frames of {count} fringes that disagree with the coarser ones ({how})"
            raise DataError(capture.source, found, "steps and frequencies in order", remedy)


def _check_sums(capture: Capture, plan: FringePlan, phases: Phases, inside: NDArray[np.bool_]) -> None:
    """Raises DataError where the steps of a frequency add up to other light, at most pixels, than those of the others:
    a frame of another frequency is among them, and one of them among its own."""
    if len(plan.fringes) < 2 or not inside.any():
        return
    amplitude, light = np.median(phases.modulation[:, inside], axis=0), phases.offset[:, inside]
    others = [np.median(np.delete(light, f, axis=0), axis=0) for f in range(len(light))]
    # a lamp that drifts makes all of a frequency brighter alike
    even = [own * np.median(other) / np.median(own) for own, other in zip(light, others, strict=True)]
    away = [float(np.median(np.abs(own - other) / amplitude)) for own, other in zip(even, others, strict=True)]
    first, second = sorted(np.argsort(away)[-2:])
    noise = 0.6745 * _frame_noise(capture.values) / np.sqrt(plan.steps) / float(np.median(amplitude))
    if max(away) > _OTHER_LIGHT / plan.steps + 2 * noise:
        counts = f"{plan.fringes[first]} and {plan.fringes[second]} fringes"
        found = f"frames of {counts} whose steps add up to different light at most pixels"
        raise DataError(capture.source, found, "each frame among the steps of its own frequency", _remedy(plan))


def _remedy(plan: FringePlan) -> str:
    return f"put them in the order {plan.names[0]} … {plan.names[-1]}"


def _clear(phases: Phases) -> NDArray[np.bool_]:
    """The better half of the pixels: there noise does not look like a wrong order."""
    worst: Array = phases.std.max(axis=0)
    return np.asarray(worst <= np.median(worst))
