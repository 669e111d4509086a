"""``tmca capture``: an export on a bench, frame by frame, and the frames as a snapshot."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Group, Parameter

from tmca.cli.cameras import Faults
from tmca.cli.lab.bench import AskedBench, known_camera
from tmca.cli.options.numbers import MaybeWhole, Whole
from tmca.cli.progress import progress_bar
from tmca.errors import SettingError
from tmca.specs import Hardware

app = App(name="capture", help="Show an export on a bench, keep every frame, join them into a snapshot.")
_BENCH = Group("Simulated bench", sort_key=1)
_OF_ITS_OWN = ("noise_seed", "hardware", "motion_pixels", "values", "codes_date", "simulated_calibration")
"""Notes of a simulated snapshot that a capture of the same camera does not share; how scenes are read it does."""


@app.default
def capture(
    export: Path,
    /,
    *,
    device: str = "simulated",
    out: Path = Path("captures"),
    snapshot: Path | None = None,
    like: Path | None = None,
    repeat: Whole = 1,
    set_: Annotated[list[str] | None, Parameter(name="--set")] = None,
    timeout: float | None = None,
    overwrite: bool = False,
    scene: Annotated[str | None, Parameter(group=_BENCH)] = None,
    bits: Annotated[MaybeWhole, Parameter(group=_BENCH)] = None,
    seed: Annotated[MaybeWhole, Parameter(group=_BENCH)] = None,
    stops_after: Annotated[MaybeWhole, Parameter(group=_BENCH)] = None,
    hardware: Faults = None,
    json: bool = False,
) -> None:
    """Capture EXPORT, a folder of `tmca export`: a dark frame, then one a slot, or one exposure of a coded shutter.

    Frames are kept in --out as they come; a capture that was stopped goes on there. They become the snapshot file
    SNAPSHOT, less the dark frame, masked by the shutter and averaged, for `tmca reconstruct`.

    Args:
        export: folder of the export.
        device: simulated, the name of a driver (entry points tmca.devices), or folder: frames of other software in
            --set path=FOLDER.
        out: folder of frames.
        snapshot: file to write; OUT.nc without it.
        like: snapshot file whose camera this is; that of the export where it was made from a snapshot.
        repeat: frames of each kind, which are averaged; more of them later add to those that are there.
        set_: NAME=VALUE settings of a driver, which it gets as text.
        timeout: seconds that a driver has for each answer, 0 for no limit; 30 s or three exposures without, whichever
            is longer.
        overwrite: replace the snapshot file.
        scene: before the simulated bench: a file, or the name of a rendered scene.
        bits: of its digital numbers, 16 without.
        seed: of its noise and faults, 0 without.
        stops_after: frames after which it does not answer any more.
        json: print what was written as JSON.
    """
    from tmca.lab.acquisition.session import check_camera, joined
    from tmca.lab.display.manifest import exposed_whole, read_manifest

    taken = known_camera(export, like)
    check_camera(export, taken.camera)
    target = snapshot or out.with_suffix(".nc")
    if target.exists() and not overwrite:
        from tmca.errors import OutputError

        raise OutputError(target, "a file", "none", "choose another --snapshot, or pass --overwrite")
    faults = Hardware.read(hardware)
    if device == "simulated" and scene is None:
        raise SettingError("--scene", "none", "a scene before the simulated bench", "name a file or a rendered scene")
    asked = AskedBench(device, set_ or [], bits, seed, stops_after, faults, scene, timeout)
    bench = asked.bench(taken, exposed_whole(read_manifest(export)))
    how = {"gain": None, "repeats": repeat, "camera": taken.camera, "bench": asked.said(), "timeout": timeout}
    read = {name: value for name, value in taken.notes.items() if scene and name not in _OF_ITS_OWN}
    about = {**read, "scene": scene or ""} | ({"hardware": faults.described()} if faults.faults() else {})
    captured: list[Any] = []

    def join() -> None:
        captured.append(joined(out, export, taken.camera))
        captured[0].notes |= about
        captured[0].save(target, overwrite=overwrite)

    _captured(export, bench, out, {**how, "finish": join})
    _say(target, out, captured[0], json)


def _captured(export: Path, bench: Any, out: Path, how: dict[str, Any]) -> None:
    from tmca.lab.acquisition.session import capture as run

    with progress_bar(f"capture: {out.name}") as report:
        run(export, bench, out, **how, progress=lambda done, total, name: report(done / total, name))


def _say(target: Path, out: Path, captured: Any, as_json: bool) -> None:
    from tmca.lab.acquisition.captures import said_sources

    shape = [int(n) for n in captured.values.shape[-2:]]
    if as_json:
        about = {"snapshot": str(target), "frames": str(out), "size": shape, "notes": captured.notes}
        print(json.dumps(about, indent=1))
        return
    print(f"{target}: {shape[0]}×{shape[1]} pixels of {captured.notes['device']}, frames in {out}")
    if taken_from := said_sources(out):
        print(f"frames were taken from: {taken_from}")
    print(f"reconstruct it with: tmca reconstruct {target}")
