"""Cameras of one period, whose codes can be designed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tmca.cameras import CodedCamera, SpectralCamera
from tmca.errors import SettingError

KINDS: dict[str, dict[str, str]] = {
    "static": {"aperture": "random", "shutter": "open"},
    "free": {"aperture": "random", "shutter": "random"},
    "one-hot": {"aperture": "random", "shutter": "one-hot"},
    "open-shutter": {"aperture": "random", "shutter": "open"},
    "static-aperture": {"aperture": "static", "shutter": "random"},
    "complementary": {"aperture": "complementary", "shutter": "random"},
    "blue-noise": {"aperture": "blue-noise", "shutter": "blue-noise"},
    "s-matrix": {"aperture": "random", "shutter": "s-matrix"},
}
"""Structure of codes by name: what the optimiser starts from and, where planes are no random, blue-noise or S-matrix
ones, keeps."""
_SPREAD = 0.9


def check_kind(kind: str) -> None:
    """Raise SettingError unless it is one of ``KINDS``."""
    if kind not in KINDS:
        raise SettingError("kind", repr(kind), f"one of {', '.join(KINDS)}")


def designable(
    kind: str,
    slots: int,
    period: tuple[int, int],
    *,
    seed: int = 0,
    start: CodedCamera | None = None,
    camera_type: Callable[..., CodedCamera] = SpectralCamera,
    **camera: Any,
) -> CodedCamera:
    """A camera as large as one period of its learnable codes.

    Args:
        kind: name in ``KINDS``.
        slots: number of time slots K; 1 for ``"static"``.
        period: (rows, columns) of the tile, pixels.
        seed: of the codes.
        start: a camera of the same period whose codes are started from; of one with fewer slots, each is shown in
            several slots in a row: the same camera in finer time.
        camera_type: ``SpectralCamera`` or ``LightFieldCamera``.
        camera: its further arguments.

    Raises:
        SettingError: unknown kind, a static camera with slots, a start whose slots do not divide these, or whose codes
            are not of this kind.
    """
    check_kind(kind)
    if kind == "static" and slots != 1:
        raise SettingError("slots", f"{slots} of a static code", "1", "choose another kind")
    planes: dict[str, Any] = dict(KINDS[kind])
    own = camera_type(
        size=period, period=period, slots=slots, learnable=True, spread=_SPREAD, seed=seed, **planes, **camera
    )
    if start is not None:
        _show(own, start, seed)
    return own


def _show(camera: CodedCamera, start: CodedCamera, seed: int) -> None:
    """Show the codes of a camera of as many slots, or of fewer that divide them."""
    slots = camera.slots
    if slots % start.slots:
        raise SettingError("start", f"{start.slots} slots", f"a divisor of {slots}")
    for name in ("aperture", "shutter"):
        codes = getattr(start.codes, name).tile().detach().repeat_interleave(slots // start.slots, 0)
        getattr(camera.codes, name).show(codes, spread=_SPREAD, seed=seed)
