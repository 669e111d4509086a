"""``tmca import``: a real capture becomes a snapshot file."""

from __future__ import annotations

from pathlib import Path

from cyclopts import App

from tmca.cli.options.output import Json, Overwrite, check_targets, say

app = App(name="import", help="Make a snapshot file of a real capture, so that every decoder takes it.")


@app.default
def import_(
    capture: Path,
    /,
    *,
    prototype: str,
    out: Path,
    mask: Path | None = None,
    name: str | None = None,
    noise: float | None = None,
    withhold_saturated: bool = False,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Write CAPTURE with its codes, optics, levels and noise to a snapshot file for `tmca reconstruct`.

    Args:
        capture: file of the capture (.mat, .npy, TIFF, HDF5, …).
        prototype: tsa, pixel-shutter-wine, or a YAML description of one's own (docs/real-captures.md).
        out: snapshot file to write (.nc).
        mask: file of the mask of a single disperser.
        name: which capture, where a file holds several.
        noise: standard deviation in the capture's numbers; estimated from its darkest part without it.
        withhold_saturated: close the shutter of saturated pixels and set them to 0, so that no decoder takes them at
            their word.
    """
    from tmca.lab.importing import WITHHELD, import_capture
    from tmca.lab.notes import SATURATED
    from tmca.lab.prototype import load_prototype

    check_targets([out], overwrite, capture)
    described = load_prototype(prototype)
    taken = import_capture(capture, described, mask, name=name, noise=noise, withhold_saturated=withhold_saturated)
    taken.save(out, overwrite=overwrite)
    camera, notes = taken.camera, taken.notes
    about = {
        "snapshot": str(out), "scene": notes["scene"], "size": list(camera.size), "bands": camera.bands,
        "slots": camera.slots, "gain": notes["gain"], "noise_in_capture": notes["noise_in_capture"],
        "saturated_share": notes.get(SATURATED), "saturated_withheld": bool(notes.get(WITHHELD)),
    }  # fmt: skip
    size = f"{camera.size[0]}×{camera.size[1]} pixels, {camera.bands} bands, {camera.slots} slots"
    withheld = notes.get(SATURATED) if withhold_saturated else None
    say(
        about, json, f"{out}: {notes['scene']}, {size}",
        f"  1 of the capture is {notes['gain']:.4g}; noise {notes['noise_in_capture']:.2g} of the capture",
        *([f"  {withheld:.2%} of the pixels are saturated, and withheld"] if withheld else []),
    )  # fmt: skip
