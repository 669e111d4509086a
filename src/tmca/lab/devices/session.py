"""A capture: every frame of an export, kept as soon as it is there, and joined into a snapshot."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from tmca.cameras import Camera, Snapshot
from tmca.errors import DataError, OutputError
from tmca.lab.devices.export import Export
from tmca.lab.devices.manifest import NAME, checksum, read_manifest
from tmca.lab.devices.protocol import Device
from tmca.lab.devices.reading import check_export, read_export

CAPTURES, DARK, WHOLE = "captures.json", "dark", "exposure"
_SATURATED, _DARK = 0.5, 3.0
"""Share of saturated pixels, and mean above the dark frame in its standard deviations, that are refused."""
Progress = Callable[[int, int, str], None]


@dataclass(frozen=True)
class Step:
    """One frame of a capture.

    Args:
        name: of its file.
        slot: that is shown; None for dark, and for a whole exposure.
    """

    name: str
    slot: int | None


def steps(manifest: dict[str, Any]) -> list[Step]:
    """Frames of an export: a dark one, then one a slot, or one exposure of a sensor whose shutter is coded."""
    whole = any(plane["device"]["kind"] == "coded-exposure" for plane in manifest["planes"])
    slots = [Step(WHOLE, None)] if whole else [Step(f"slot_{k:03d}", k) for k in range(manifest["slots"])]
    return [Step(DARK, None), *slots]


def capture(
    export: str | Path, device: Device, out: str | Path, *, gain: float = 1.0, progress: Progress | None = None
) -> Path:
    """Capture every frame of an export; what is there already stays.

    Writes ``dark.tif``, ``slot_NNN.tif`` or ``exposure.tif`` (16 bits), and ``captures.json`` with their checksums.

    Args:
        export: its folder.
        device: the bench.
        out: folder of the capture; a capture that was stopped goes on there.
        gain: snapshot units of a digital number, for files.
        progress: told (frames done, all, name).

    Raises:
        DeviceError: the bench does not answer; frames so far are kept.
        DataError: an export or a kept frame that was changed, a saturated or a dark capture.
        OutputError: the folder holds something else.
    """
    manifest, folder = check_export(export), Path(out)
    kept = _kept(folder, export)
    device.load(Export(Path(export), manifest))
    wanted = steps(manifest)
    for done, step in enumerate(wanted):
        if step.name not in kept["frames"]:
            device.show(step.slot)
            frame = device.capture(whole=step.name == WHOLE)
            _check_light(frame, step, device.saturation, folder)
            _keep(frame, step, kept, folder, gain, device.saturation)
        if progress:
            progress(done + 1, len(wanted), step.name)
    return folder


def _kept(folder: Path, export: str | Path) -> dict[str, Any]:
    """What a folder holds of this export's capture."""
    of = checksum(Path(export) / NAME)
    if not (folder / CAPTURES).exists():
        if folder.exists() and (folder.is_file() or any(folder.iterdir())):
            raise OutputError(folder, "something that is no capture", "a new folder", "choose another")
        return {"export": str(export), "export_sha256": of, "frames": {}}
    kept = read_captures(folder)
    if kept["export_sha256"] != of:
        raise OutputError(folder, f"a capture of {kept['export']}", "one of this export", "choose another folder")
    return kept


def read_captures(folder: str | Path) -> dict[str, Any]:
    """What was captured, every frame there and as it was written.

    Raises:
        DataError: no capture, or a frame that is missing, changed, or in another's place.
    """
    file = Path(folder) / CAPTURES
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
        frames = {name: about["sha256"] for name, about in found["frames"].items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise DataError(file, "no list of captures", "what `tmca capture` wrote", "capture it again") from None
    for name, known in frames.items():
        frame = Path(folder) / f"{name}.tif"
        if not frame.is_file():
            raise DataError(frame, "no such file", f"the frame {name}", "capture it again in a new folder")
        there = checksum(frame)
        if there != known:
            other = [n for n, value in frames.items() if value == there]
            what = f"that of {other[0]}: frames in the wrong order" if other else "another content"
            raise DataError(frame, what, "what was captured", "capture it again in a new folder")
    return dict(found)


def _check_light(frame: NDArray[np.integer], step: Step, saturation: float, folder: Path) -> None:
    share = float((frame >= saturation).mean())
    if share > _SATURATED:
        remedy = "open the aperture of the lens less, or expose shorter"
        raise DataError(folder / step.name, f"{share:.0%} saturated pixels", f"{_SATURATED:.0%} at most", remedy)
    if step.name == DARK:
        return
    dark = read_tif(folder / f"{DARK}.tif").astype(np.float64)
    above = float(frame.mean() - dark.mean())
    if above <= _DARK * float(dark.std()) / np.sqrt(frame.size):
        found = f"a frame {above:.3g} digital numbers above the dark one"
        raise DataError(folder / step.name, found, "light", "check lamp, shutter and lens cap")


def _keep(
    frame: NDArray[np.integer], step: Step, kept: dict[str, Any], folder: Path, gain: float, saturation: float
) -> None:
    import tifffile

    from tmca.data import make_folder, write_json
    from tmca.data.write import atomic_path

    file = make_folder(folder) / f"{step.name}.tif"
    with atomic_path(file, overwrite=True) as temporary:
        tifffile.imwrite(temporary, frame.astype(np.uint16), photometric="minisblack")
    about = {"slot": step.slot, "sha256": checksum(file), "taken": datetime.now(UTC).isoformat(timespec="seconds")}
    kept["frames"][step.name] = about
    kept |= {"gain": gain, "saturation": saturation}
    write_json(kept, folder / CAPTURES, overwrite=True)


def read_tif(file: Path) -> NDArray[np.integer]:
    """A frame as it was kept."""
    import tifffile

    try:
        return np.asarray(tifffile.imread(file))
    except (OSError, ValueError, tifffile.TiffFileError):
        raise DataError(file, "no TIFF", "a frame of the capture", "capture it again") from None


def joined(folder: str | Path, export: str | Path, camera: Camera) -> Snapshot[Any]:
    """The snapshot of a capture: frames less the dark one, masked by the shutter's codes and averaged.

    Args:
        folder: of the capture.
        export: that was captured.
        camera: as it is known.

    Raises:
        DataError: frames that are missing or changed, of another size than the camera's, or of another export.
    """
    kept, place = read_captures(folder), Path(folder)
    if kept["export_sha256"] != checksum(Path(export) / NAME):
        raise DataError(folder, f"a capture of {kept['export']}", f"one of {export}", "name the export it is of")
    manifest = read_manifest(export)
    missing = [step.name for step in steps(manifest) if step.name not in kept["frames"]]
    if missing:
        raise DataError(folder, f"no frame {', '.join(missing[:3])}", "all of the export", "go on with `tmca capture`")
    dark = _frame(place, DARK, camera)
    names = [step.name for step in steps(manifest)[1:]]
    frames = torch.stack([_frame(place, name, camera) - dark for name in names]) * float(kept["gain"])
    if names != [WHOLE]:
        shutter = read_export(export).full("shutter", camera.snapshot_shape[1:]).to(frames)
        frames = frames * shutter[:, None]
    values = frames.sum(0) if camera.exposure == "per-slot" else frames.mean(0)
    about = {"device": ", ".join(plane["device"]["name"] for plane in manifest["planes"])}
    about |= {"gain_per_digital_number": kept["gain"], "capture": str(folder), "export": str(export)}
    return Snapshot(values[None].float(), camera, about)


def _frame(folder: Path, name: str, camera: Camera) -> torch.Tensor:
    """(C, H, W) digital numbers."""
    found = read_tif(folder / f"{name}.tif").astype(np.float64)
    found = found[None] if found.ndim == 2 else found
    if found.shape != camera.snapshot_shape:
        shape = "×".join(map(str, camera.snapshot_shape))
        raise DataError(folder / f"{name}.tif", f"a frame of {'×'.join(map(str, found.shape))}", f"{shape} pixels")
    return torch.from_numpy(found)
