"""``tmca capture``: an export on a bench, frame by frame, and the frames as a snapshot."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cyclopts import App

from tmca.cli.lab.bench import SIMULATED, BenchOptions
from tmca.cli.options.numbers import Whole
from tmca.cli.options.output import Json, Overwrite, say
from tmca.errors import OutputError
from tmca.progress import progress_bar

app = App(name="capture", help="Show an export on a bench, keep every frame, join them into a snapshot.")
_BENCH = BenchOptions()
_OF_ITS_OWN = ("noise_seed", "hardware", "motion_pixels", "values", "codes_date", "simulated_calibration")
"""Notes of a simulated snapshot that a capture of the same camera does not share; how scenes are read it does."""


@app.default
def capture(
    export: Path,
    /,
    *,
    out: Path = Path("captures"),
    snapshot: Path | None = None,
    repeat: Whole = 1,
    overwrite: Overwrite = False,
    scene: Annotated[str | None, SIMULATED] = None,
    bench: BenchOptions = _BENCH,
    json: Json = False,
) -> None:
    """Capture EXPORT, a folder of `tmca export`: a dark frame, then one a slot, or one exposure of a coded shutter.

    Frames are kept in --out as they come; a capture that was stopped goes on there. They become the snapshot file
    SNAPSHOT, less the dark frame, masked by the shutter and averaged, for `tmca reconstruct`. The device folder joins
    frames of other software: --set path=FOLDER.

    Args:
        export: folder of the export.
        out: folder of frames.
        snapshot: file to write; OUT.nc without it.
        repeat: frames of each kind, which are averaged; more of them later add to those that are there.
        scene: before the simulated bench: a file, or the name of a rendered scene.
    """
    from tmca.lab.acquisition.session import capture as run
    from tmca.lab.acquisition.session import check_camera
    from tmca.lab.display.manifest import exposed_whole, read_manifest

    bench.check(scene)
    taken = bench.known(export)
    check_camera(export, taken.camera)
    target = snapshot or out.with_suffix(".nc")
    if target.exists() and not overwrite:
        raise OutputError(target, "a file", "none", "choose another --snapshot, or pass --overwrite")
    bench.check_scene(scene)
    device = bench.bench(taken, exposed_whole(read_manifest(export)), scene)
    notes = {name: value for name, value in taken.notes.items() if scene and name not in _OF_ITS_OWN}
    notes |= {"scene": scene or "", **({"hardware": bench.faults.described()} if bench.faults.faults() else {})}
    captured: list[Any] = []
    with progress_bar(f"capture: {out.name}") as report:
        run(
            export, device, out, gain=None, repeats=repeat, camera=taken.camera, bench=bench.said(scene),
            timeout=bench.timeout, progress=lambda done, total, name: report(done / total, name),
            finish=lambda: captured.append(_join(out, export, taken.camera, notes, target, overwrite)),
        )  # fmt: skip
    _say(target, out, captured[0], json)


def _join(folder: Path, export: Path, camera: Any, notes: dict[str, Any], target: Path, overwrite: bool) -> Any:
    """The snapshot of a capture, written with these notes too."""
    from tmca.lab.acquisition.session import joined

    captured = joined(folder, export, camera)
    captured.notes |= notes
    captured.save(target, overwrite=overwrite)
    return captured


def _say(target: Path, out: Path, captured: Any, as_json: bool) -> None:
    from tmca.lab.acquisition.captures import said_sources

    shape = [int(n) for n in captured.values.shape[-2:]]
    about = {"snapshot": str(target), "frames": str(out), "size": shape, "notes": captured.notes}
    lines = [f"{target}: {shape[0]}×{shape[1]} pixels of {captured.notes['device']}, frames in {out}"]
    if taken_from := said_sources(out):
        lines.append(f"frames were taken from: {taken_from}")
    say(about, as_json, *lines, f"reconstruct it with: tmca reconstruct {target}")
