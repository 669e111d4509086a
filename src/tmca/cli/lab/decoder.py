"""``tmca decoder``: trained decoders as programs of their own, for use beside a camera."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cyclopts import App

from tmca.cli.options.numbers import size
from tmca.cli.options.output import Json, Overwrite, check_targets, say

if TYPE_CHECKING:
    from tmca.lab.deploy import DecoderFile

app = App(name="decoder", help="Trained decoders as files that need no tmca: torch.export and ONNX.")


@app.command
def export(
    run: Path,
    /,
    *,
    out: Path,
    formats: str | None = None,
    frame: str | None = None,
    noise: float | None = None,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Write the network of RUN, with its codes and optics, as decoder.pt2 and decoder.onnx, each checked when written.

    Args:
        run: folder of `tmca train spectral` or a weights file; its network starts from adjoint, dagger or tikhonov.
        out: folder to write into.
        formats: torch, onnx, or both separated by a comma; onnx needs `pip install 'tmca[onnx]'`. Both without, torch
            alone where onnx is not installed.
        frame: HEIGHTxWIDTH of the scene; that of the run's camera without it.
        noise: read noise that the network is told, snapshot units; that of its training without it.
    """
    from tmca.lab.deploy import export_decoder

    names = None if formats is None else tuple(name.strip() for name in formats.split(",") if name.strip())
    files = export_decoder(run, out, names, size=size(frame, "--frame"), noise=noise, overwrite=overwrite)
    _say(out, files, json)
    if names is None and len(files) == 1 and not json:
        print("no decoder.onnx: pip install 'tmca[onnx]' and run the command again with --overwrite")


@app.command
def check(folder: Path, /, *, run: Path, trust: bool = False, json: Json = False) -> None:
    """Compare the files in FOLDER with the network that they were made from, on random input.

    Args:
        folder: of `tmca decoder export`.
        run: the training run.
        trust: run whatever code decoder.pt2 holds, of a file of your own.
    """
    from tmca.lab.deploy import check_decoder

    _say(folder, check_decoder(folder, run, trust=trust), json)


@app.command
def run(
    folder: Path,
    snapshot: Path,
    /,
    *,
    out: Path,
    format: str = "torch",
    trust: bool = False,
    overwrite: Overwrite = False,
) -> None:
    """Decode SNAPSHOT with an exported decoder of FOLDER.

    Args:
        folder: of `tmca decoder export`.
        snapshot: file of the camera that the decoder was made for.
        out: NetCDF file of the estimate.
        format: torch or onnx.
        trust: run whatever code decoder.pt2 holds, of a file of your own.
    """
    from tmca.lab.deploy import decode_exported

    check_targets([out], overwrite, snapshot)
    estimate = decode_exported(folder, snapshot, format, trust)
    estimate.save(out, overwrite=overwrite)
    print(f"{out}: {format}, {estimate.seconds:.2f} s")


def _say(folder: Path, files: list[DecoderFile], json: bool) -> None:
    rows = [{"format": one.format, "file": str(folder / one.file), "error": one.error} for one in files]
    far = [f"differs from the network by {one.error:.1e} of its largest value" for one in files]
    say(rows, json, *(f"{row['file']}: {row['format']}, {by}" for row, by in zip(rows, far, strict=True)))
