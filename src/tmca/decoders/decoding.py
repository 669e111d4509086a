"""From a snapshot to its scene in one call: decoders by name, class or instance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, replace
from inspect import isabstract
from pathlib import Path
from typing import Any

import torch

from tmca.arguments import checked_settings, described, settings_of
from tmca.cameras import Snapshot
from tmca.decoders.decoder import Decoder, Estimate, Progress
from tmca.decoders.registry import check_parts, decoders, decoders_for, usual_decoder
from tmca.devices import usual_device
from tmca.errors import SettingError, check_choice
from tmca.priors import Prior


def decode(
    snapshot: Snapshot[Any] | str | Path,
    decoder: str | type[Decoder] | Decoder | None = None,
    *,
    prior: str | Path | Prior | None = None,
    progress: Progress | None = None,
    device: str | torch.device | None = None,
    bank: str | Path | None = None,
    **settings: Any,
) -> Estimate:
    """Recover the scene of a snapshot of any camera.

    Args:
        snapshot: values and camera, or the file that holds them.
        decoder: a name of `decoders_for` the camera, a class or an instance; None for the camera's usual one.
        prior: a prior, its file, or None for that of the rendered scenes, learned on first use.
        progress: called with the share that is done.
        device: where it is decoded, and where the estimate lies: ``"cuda"``, ``"cpu"``; None where the snapshot
            is, or as `tmca.devices.computing_on` says.
        bank: file that stores what depends on camera, noise and prior alone, for the next snapshot (lmmse); see
            `Decoder.prepare`.
        settings: of the decoder.

    Raises:
        SettingError: an unknown decoder or setting, a camera or prior that does not fit, or a device that is not there.
        DataError: a file that holds no snapshot, or a bank of something else.

    >>> import torch, tmca.cameras
    >>> camera = tmca.cameras.SpectralCamera(3, (8, 8), slots=2)
    >>> decode(Snapshot(camera(torch.rand(1, 3, 8, 8)), camera), "dagger").values.shape
    torch.Size([1, 3, 8, 8])
    """
    if decoder is None and "method" in settings:
        decoder = settings.pop("method")  # its name in version 0.1
    if isinstance(snapshot, str | Path):
        snapshot = Snapshot.load(snapshot)
    if not isinstance(snapshot, Snapshot):
        raise SettingError("snapshot", described(snapshot), "a Snapshot", "take one with tmca.simulate")
    where = usual_device() if device is None else device
    snapshot = snapshot if where is None else snapshot.to(where)
    kind = snapshot.camera.kind
    made = make_decoder(decoder or usual_decoder(kind), kind, settings)
    if bank is None:
        return made(snapshot, prior, progress)
    prepared = made.prepare(snapshot.camera, prior, progress, bank=bank)
    estimate = prepared(snapshot, progress)
    return replace(estimate, seconds=estimate.seconds + prepared.seconds)


def make_decoder(
    decoder: str | type[Decoder] | Decoder, kind: str, settings: Mapping[str, Any] | None = None
) -> Decoder:
    """A decoder of snapshots of a kind of camera, with some settings; unknown ones are named in a SettingError."""
    if isinstance(decoder, str):
        choices = decoders_for(kind, moving=None)
        if decoder not in choices and decoder in decoders():
            found = f"{decoder!r}, which is for {', '.join(sorted(decoders()[decoder].cameras))} cameras"
            raise SettingError("decoder", found, f"one of {', '.join(choices)}")
        check_choice("decoder", decoder, choices)
        decoder = choices[decoder]
    cls = decoder if isinstance(decoder, type) else type(decoder)
    if not issubclass(cls, Decoder) or isabstract(cls):
        raise SettingError("decoder", repr(decoder), "a name, a subclass of Decoder, or one of its objects")
    checked = checked_settings(cls, settings) if settings else {}
    check_parts(cls)
    if isinstance(decoder, Decoder):
        return replace(decoder, **checked)
    for setting in settings_of(cls):
        if setting.default is MISSING and setting.name not in checked:
            raise SettingError(setting.name, "nothing", f"a {setting.type}: {cls.name} has no default of it")
    return decoder(**checked)
