"""The frames of a capture as the snapshot of one exposure."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import torch

from tmca.cameras import Camera, Snapshot
from tmca.errors import DataError
from tmca.lab.captured_notes import AVERAGED, DRIVER, GAIN, SATURATED, WHITE
from tmca.lab.codes_date import CODES_DATE
from tmca.lab.devices.captures import DARK, WHOLE, is_of, read_captures, read_tif, steps
from tmca.lab.devices.descriptions import DeviceDescription
from tmca.lab.devices.manifest import read_manifest
from tmca.lab.devices.mirror import terms_of
from tmca.lab.devices.reading import device_of, read_export
from tmca.lab.devices.response import step_of
from tmca.lab.devices.sources import Planes, planes_of
from tmca.sensor import Sensor

_SAME_SURFACE = 1e-10
"""Metres by which Zernike terms of the same masks may differ."""


def joined(folder: str | Path, export: str | Path, camera: Camera) -> Snapshot[Any]:
    """The snapshot of a capture: frames less the dark one, masked by the shutter's codes and averaged.

    Repeats of a frame are averaged first. A shutter that was not exported is that of the camera.

    Args:
        folder: of the capture.
        export: that was captured.
        camera: as it is known.

    The share of pixels that saturate in any frame is a note: behind the dark frame and the mask nobody can tell.

    Raises:
        DataError: frames that are missing or changed, of another size than the camera's, or of another export; codes
            that are not the camera's.
    """
    kept, place = read_captures(folder), Path(folder)
    if not is_of(kept, export):
        raise DataError(folder, f"a capture of {kept['export']}", f"one of {export}", "name the export it is of")
    check_camera(export, camera)
    manifest = read_manifest(export)
    wanted = steps(manifest)
    if missing := [step.name for step in wanted if step.name not in kept["frames"]]:
        raise DataError(folder, f"no frame {', '.join(missing[:3])}", "all of the export", "go on with `tmca capture`")
    means, saturated = _means(place, kept, camera)
    how = kept["taken_with"]
    names = [step.name for step in wanted if step.of != DARK]
    frames = torch.stack([means[name] - means[DARK] for name in names]) * float(how["gain"])
    opened = torch.ones(1, *camera.snapshot_shape[1:]) if names == [WHOLE] else _shutter(export, camera)
    frames = frames * opened.to(frames)[:, None]
    values = frames.sum(0) if camera.exposure == "per-slot" else frames.mean(0)
    taken = Counter(about["of"] for about in kept["frames"].values())
    repeats = torch.tensor([float(taken[name]) for name in names])
    alike = _repeats(repeats, opened)
    read = float(how["gain"]) * _read_noise(place, kept, repeats, opened, camera)
    camera = _with_noise(camera, read, alike)
    about: dict[str, Any] = {"device": ", ".join(plane["device"]["name"] for plane in manifest["planes"])}
    about |= {GAIN: how["gain"], "capture": str(folder), "export": str(export), DRIVER: how.get(DRIVER, "")}
    whole = names == [WHOLE]
    about |= {SATURATED: saturated, WHITE: camera.full_scale if whole else camera.white}
    about |= {AVERAGED: alike * (1 if whole or camera.exposure == "per-slot" else camera.slots)}
    about |= {CODES_DATE: manifest[CODES_DATE]} if CODES_DATE in manifest else {}
    return Snapshot(values[None].float(), camera, about)


def _repeats(taken: torch.Tensor, opened: torch.Tensor) -> float:
    """Of every slot alike, that leave as much shot noise of even light as those that were taken of each; whole numbers
    where all are alike, else less than their mean."""
    left = (opened / taken[:, None, None]).sum()
    return float(taken[0]) if bool((taken == taken[0]).all()) or not left else float(opened.sum() / left)


def _read_noise(
    folder: Path, kept: dict[str, Any], repeats: torch.Tensor, opened: torch.Tensor, camera: Camera
) -> float:
    """Root mean square over the pixels of what reading leaves in a joined snapshot, digital numbers.

    Frames of the open slots k, each the mean of R_k repeats, less for each the mean of D dark ones, n times in all:
    ``σ² (Σ 1 / R_k + n² / D)``, over K² where they are averaged.
    """
    darks = torch.stack(
        [_frame(folder / f"{name}.tif", camera) for name, a in kept["frames"].items() if a["of"] == DARK]
    )
    opened = opened.to(darks)
    share = ((opened / repeats.to(darks)[:, None, None]).sum(0) + opened.sum(0) ** 2 / len(darks)).mean()
    over = 1 if camera.exposure == "per-slot" else len(opened)
    return float((darks.var(0).mean() * share).sqrt()) / over


def _with_noise(camera: Camera, read: float, repeats: float) -> Camera:
    """The camera, whose sensor reads with this noise in snapshot units, and collects the light of all repeats."""
    settings: dict[str, Any] = {**camera.sensor.settings(), "read_noise": read, "read_noise_electrons": 0.0}
    if settings["full_well"] is not None:
        settings["full_well"] *= repeats
    return camera.replace(sensor=Sensor(**settings))


def _shutter(export: str | Path, camera: Camera) -> torch.Tensor:
    shown = read_export(export)
    if "shutter" not in shown.planes:
        shown = planes_of(camera, str(export))
    return shown.full("shutter", camera.snapshot_shape[1:])


def _means(folder: Path, kept: dict[str, Any], camera: Camera) -> tuple[dict[str, torch.Tensor], float]:
    """(C, H, W) digital numbers of every frame, the mean of its repeats; share of the pixels that saturate in any."""
    top, counts = float(kept["taken_with"]["saturation"]), Counter(about["of"] for about in kept["frames"].values())
    means: dict[str, torch.Tensor] = {}
    reached = torch.zeros(camera.snapshot_shape[1:], dtype=torch.bool)
    for name, about in kept["frames"].items():
        frame, of = _frame(folder / f"{name}.tif", camera), about["of"]
        reached |= (frame >= top).any(0)
        means[of] = means.get(of, torch.zeros_like(frame)) + frame / counts[of]
    return means, float(reached.double().mean())


def _frame(file: Path, camera: Camera) -> torch.Tensor:
    found = read_tif(file).astype(np.float64)
    found = found[None] if found.ndim == 2 else found
    if found.shape != camera.snapshot_shape:
        shape = "×".join(map(str, camera.snapshot_shape))
        raise DataError(file, f"a frame of {'×'.join(map(str, found.shape))}", f"{shape} pixels")
    return torch.from_numpy(found)


def check_camera(export: str | Path, camera: Camera) -> None:
    """Raises DataError unless an export shows the codes of a camera: else its snapshot would name codes that were not
    shown."""
    shown, own = read_export(export), planes_of(camera, str(export))
    known = {plane["plane"]: plane for plane in read_manifest(export)["planes"]}
    remedy = "name a snapshot of the camera with these codes (--like)"
    if shown.slots != camera.slots:
        raise DataError(export, f"{shown.slots} slots", f"the camera's {camera.slots}", remedy)
    for name, plane in own.planes.items():
        if name in known:
            _check_plane(export, name, device_of(known[name], export), shown, own, remedy)
        elif name != "shutter" and not torch.equal(plane, plane[:1].expand_as(plane)):
            raise DataError(export, f"no {name}", "one, which changes from slot to slot", "export it to a device too")


def _check_plane(
    export: str | Path, name: str, device: DeviceDescription, shown: Planes, own: Planes, remedy: str
) -> None:
    if device.kind == "deformable-mirror":
        assert shown.modes is not None
        found, wanted = shown.modes["coefficients"], torch.from_numpy(terms_of(own, device).rms).float()
        allowed = _SAME_SURFACE
    else:
        found, wanted = shown.planes[name], own.planes[name]
        allowed = step_of(device) if device.kind == "lcos" else 0.0
    if found.shape != wanted.shape:
        size = f"{name} of {tuple(found.shape)}"
        raise DataError(export, size, f"the camera's {tuple(wanted.shape)}", f"export it for that size, or {remedy}")
    if float((found - wanted).abs().max()) > allowed:
        raise DataError(export, f"other codes in the {name}", "those of the camera", remedy)
