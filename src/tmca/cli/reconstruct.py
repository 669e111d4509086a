"""``tmca reconstruct``: snapshot files go in, scenes come out, of several snapshots or decoders side by side."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from tmca.cli.cameras import READING
from tmca.cli.options.numbers import MaybeOn, MaybeWhole
from tmca.cli.options.output import OutputOptions, check_targets, say, warned
from tmca.cli.reconstructions import Reconstructed, Reconstruction, Request
from tmca.errors import OutputError, SettingError, TmcaError, check_choice
from tmca.specs import CAMERA_SPECS, TruthReading

app = App(name="reconstruct", help="Recover the scene from a snapshot file, which says itself which camera took it.")
_OUTPUT, _READING = OutputOptions(), TruthReading()


@app.default
def reconstruct(
    snapshot: Path,
    /,
    *others: Path,
    decoder: Annotated[str | None, Parameter(alias="-d")] = None,
    truth: str | None = None,
    weights: str | None = None,
    prior: Path | None = None,
    set_: Annotated[list[str] | None, Parameter(name="--set")] = None,
    calibration: Path | None = None,
    dictionary: Path | None = None,
    tv_weight: float | None = None,
    uncertainty: MaybeOn = None,
    window: MaybeWhole = None,
    device: str | None = None,
    bank: Path | None = None,
    register: str | None = None,
    reading: Annotated[TruthReading, READING] = _READING,
    output: OutputOptions = _OUTPUT,
) -> None:
    """Recover the scene from SNAPSHOT, a file written by `tmca simulate`.

    With several snapshots, or several decoders separated by commas, every estimate is written to a file of its own, and
    comparison.png shows them side by side.

    Args:
        snapshot: snapshot file; it carries codes, optics, exposure and noise, and says which camera took it.
        others: more of them.
        decoder: one that `tmca decoders` lists for the camera: lmmse (default; behind codes that come with tmca the
            network that comes with them), admm-tv, pnp-subspace, tikhonov, dagger, network, …;
            space-time-mixture for scenes that move; of a spectral snapshot also lmmse-adapted (its prior refitted to
            the snapshot itself); of a light-field snapshot also dictionary, dictionary-omp. Of a spectral-depth
            snapshot likelihood: depth and spectrum by the likelihood of every plane under a patch prior; or network.
            Your own is FILE.py:Class, or FILE.pt2 of `tmca decoder export`. Several are separated by commas.
        truth: the scene, for errors and metrics: a file or the name of a rendered scene; a light field is read as it
            was for the snapshot.
        weights: of a network: a file or run of `tmca train`; or one that comes with tmca: universal (spectral, any
            bands of 400 to 700 nm, any codes, one bucket or two) or default (with the codes of --weights default);
            the decoder is then network.
        prior: file made by `tmca prior learn` or `learn-views`; the rendered scenes' prior without it (learned once,
            then cached).
        set_: NAME=VALUE, any setting of the decoder; `tmca decoders` lists them. May be given several times.
        calibration: of the camera, by `tmca calibrate`: a file, or its name without the date for the newest. Snapshots
            in digital numbers need one.
        dictionary: file made by `tmca prior learn-views --dictionary`; the decoder is then dictionary.
        tv_weight: weight of the total variation; chosen from the noise level without it.
        uncertainty: also estimate every pixel's standard deviation (lmmse, lmmse-adapted and mixture, which take less
            time without, and the networks that come with tmca); networks of your own have none.
        window: side of the windows of likelihood, pixels; 12 without it, or the tile of the codes if that is larger.
        device: where it is decoded: cpu, cuda or cuda:1.
        bank: file that stores what lmmse computes for camera, noise and prior, some hundred MB: written where there is
            none, read by the next command.
        register: auto finds where the mask lies from the snapshot alone (shift up to 2.4 pixels, rotation, scale,
            stretch, shear, blur, dispersion), prints the place with its standard deviation, and decodes by it.
    """
    from tmca.lab.decoder_files import decoders_named

    names: list[str | None] = [*decoders_named(decoder, "decoder")] if decoder else [None]
    how = {"tv_weight": tv_weight, "weights": weights, "uncertainty": uncertainty, "window": window}
    if register is not None:
        check_choice("--register", register, ("auto",))
    request = Request(how, set_ or [], truth, prior, calibration, dictionary, device, bank, register, reading, output)
    several = len(names) > 1
    jobs = [Reconstruction.of(file, name, request, several) for file in (snapshot, *others) for name in names]
    if several:
        _check_taken(jobs, request)
    if len(jobs) == 1:
        done = jobs[0].run(output.out or jobs[0].target)
        say(done.report, output.json, *done.lines())
        return
    _run_all(jobs, request)


def _run_all(jobs: Sequence[Reconstruction], request: Request) -> None:
    """Reconstructions one after the other, and all of them in one picture; what fails is told, and the others go on."""
    output, folder = request.output, _folder(request.output.out)
    targets = _targets(jobs, folder)
    picture = folder / "comparison.png"
    written = [file for job, target in zip(jobs, targets, strict=True) for file in job.files(target)]
    check_targets([*written, *([picture] if output.figures else [])], output.overwrite)
    done, failed = dict[tuple[str, str], Reconstructed](), list[str]()
    for job, target in zip(jobs, targets, strict=True):
        try:
            done[job.file.stem.removesuffix("_snapshot"), job.decoder] = job.run(target)
        except TmcaError as error:
            failed.append(f"{job.file.name} by {job.decoder}")
            warned(f"{failed[-1]}: {error}")
    reports, lines = [one.report for one in done.values()], [line for one in done.values() for line in one.lines()]
    if output.figures and len(done) > 1:
        lines += _compared(done, picture, output.overwrite)
    say(reports, output.json, *lines)
    if failed:
        found = f"{len(failed)} of {len(jobs)} that failed ({', '.join(failed)})"
        raise SettingError("reconstruct", found, "estimates of all", "the others are written")


def _targets(jobs: Sequence[Reconstruction], folder: Path) -> list[Path]:
    """Files of the estimates, each of which is one's own."""
    targets = [folder / job.target for job in jobs]
    for target in targets:
        if targets.count(target) > 1:
            raise SettingError("snapshot", f"several for {target}", "snapshots of different names", "rename one")
    return targets


def _folder(out: Path | None) -> Path:
    """Where several estimates go: a folder, made if it is not there."""
    from tmca.data import make_folder

    if out is None:
        return Path()
    if out.suffix and not out.is_dir():
        raise OutputError(out, "one file for several estimates", "a folder")
    make_folder(out)
    return out


def _compared(done: dict[tuple[str, str], Reconstructed], picture: Path, overwrite: bool) -> list[str]:
    """Draw all estimates side by side where they and their truths fit together; what is said of it."""
    from tmca.plots.side_by_side import side_by_side, what_differs
    from tmca.plots.style import save_figure

    differing = what_differs([one.estimate for one in done.values()], [one.scene for one in done.values()])
    if differing:
        return [f"no comparison.png: the estimates differ in {differing}"]
    snapshots = dict.fromkeys(name for name, _ in done)
    decoders = dict.fromkeys(name for _, name in done)
    names = {
        (snapshot, decoder): (decoder, "") if len(snapshots) == 1 else (snapshot, decoder if len(decoders) > 1 else "")
        for snapshot, decoder in done
    }
    scene = next(iter(done.values())).scene
    figure = side_by_side({names[key]: one.estimate for key, one in done.items()}, scene)
    return [f"{save_figure(figure, picture, overwrite=overwrite, dpi=200)}: all side by side"]


def _check_taken(jobs: Sequence[Reconstruction], request: Request) -> None:
    """Raises SettingError for a setting that none of several decoders has."""
    from tmca.arguments import setting_names

    known = {name for job in jobs if job.cls is not None for name in setting_names(job.cls)}
    named = [text.partition("=")[0].strip() for text in request.texts]
    named += [name for name, value in request.how.items() if value is not None and name != "uncertainty"]
    for name in named:
        if name not in known:
            used = ", ".join(dict.fromkeys(job.decoder for job in jobs))
            raise SettingError(name, f"a setting of none of {used}", "one of theirs", "leave it out")


for _camera in CAMERA_SPECS:
    app.command(reconstruct, name=_camera, help=f"The same, for the {_camera} camera.")
