"""``tmca reconstruct``: a snapshot file goes in, the scene comes out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import App, Parameter

from tmca.cli.cameras import READING
from tmca.cli.options.numbers import MaybeWhole, On
from tmca.cli.options.output import OutputOptions, check_targets, meaning, say
from tmca.cli.progress import progress_bar
from tmca.errors import SettingError
from tmca.specs import CAMERA_SPECS, TruthReading

if TYPE_CHECKING:
    from tmca.decoders import Decoder

app = App(name="reconstruct", help="Recover the scene from a snapshot file, which says itself which camera took it.")
_OUTPUT, _READING = OutputOptions(), TruthReading()


@app.default
def reconstruct(
    snapshot: Path,
    /,
    *,
    decoder: Annotated[str | None, Parameter(alias="-d")] = None,
    truth: str | None = None,
    weights: str | None = None,
    prior: Path | None = None,
    set_: Annotated[list[str] | None, Parameter(name="--set")] = None,
    calibration: Path | None = None,
    dictionary: Path | None = None,
    tv_weight: float | None = None,
    uncertainty: On = True,
    window: MaybeWhole = None,
    device: str | None = None,
    bank: Path | None = None,
    reading: Annotated[TruthReading, READING] = _READING,
    output: OutputOptions = _OUTPUT,
) -> None:
    """Recover the scene from SNAPSHOT, a file written by `tmca simulate`.

    Args:
        snapshot: snapshot file; it carries codes, optics, exposure and noise, and says which camera took it.
        decoder: one that `tmca decoders` lists for the camera: lmmse (default), admm-tv, pnp-subspace, tikhonov,
            dagger, network, …; space-time-lmmse for scenes that move; of a spectral snapshot also lmmse-adapted (its
            prior refitted to the snapshot itself); of a light-field snapshot also dictionary, dictionary-omp. Of a
            spectral-depth snapshot likelihood: depth and spectrum by the likelihood of every plane under a patch prior;
            or network.
        truth: the scene, for errors and metrics: a file or the name of a rendered scene; a light field is read as it
            was for the snapshot.
        weights: of a network: a file or run of `tmca train`; or one that comes with tmca for spectral snapshots:
            universal (any bands from 400 to 700 nm, any codes, one bucket or two) or default (12 bands, learned
            codes); the decoder is then network.
        prior: file made by `tmca prior learn` or `learn-views`; the rendered scenes' prior without it (learned once,
            then cached).
        set_: NAME=VALUE, any setting of the decoder; `tmca decoders` lists them. May be given several times.
        calibration: of the camera, by `tmca calibrate`: a file, or its name without the date for the newest. Snapshots
            in digital numbers need one.
        dictionary: file made by `tmca prior learn-views --dictionary`; the decoder is then dictionary.
        tv_weight: weight of the total variation; chosen from the noise level without it.
        uncertainty: also estimate every pixel's standard deviation (lmmse, lmmse-adapted, mixture); the universal
            network always does.
        window: side of the windows of likelihood, pixels; 12 without it, or the tile of the codes if that is larger.
        device: where it is decoded: cpu, cuda or cuda:1.
        bank: file that stores what lmmse computes for camera, noise and prior, some hundred MB: written where there is
            none, read by the next command.
    """
    from tmca.applications import application_of, evaluate
    from tmca.applications.imaging import metric_notes
    from tmca.applications.pictures import estimate_files, estimate_pictures
    from tmca.data.in_memory import warn_of_estimate
    from tmca.data.scene_names import compare_scene
    from tmca.decoders import decode, decoders_for
    from tmca.lab.calibration.apply import load_snapshot

    taken = load_snapshot(snapshot, calibration)
    camera, application = taken.camera, application_of(taken.camera)
    decoder = decoder or ("network" if weights else "dictionary" if dictionary else application.default_decoder)
    target = output.out or Path(f"{snapshot.stem.removesuffix('_snapshot')}_{decoder}.nc")
    available = decoders_for(camera.kind, moving=None)
    cls = available.get(decoder)
    how = {"tv_weight": tv_weight, "weights": weights, "uncertainty": uncertainty, "window": window}
    settings = _given(cls, how) | _settings(cls, set_ or [])
    if dictionary is not None:
        _check_dictionary(dictionary, decoder, camera.kind, available)
        prior = dictionary
    asked, moving = reading.of(application.kind), cls is not None and cls.moving
    check_targets(estimate_files(target, camera.kind, output.figures, moving), output.overwrite, snapshot)
    if truth is not None:
        compare_scene(taken.notes, truth)
    scene = None if truth is None else application.truth(truth, camera, taken.notes, len(taken.values) > 1, **asked)
    with progress_bar(f"{decoder}: {snapshot.name}") as progress:
        estimate = decode(taken, decoder, prior=prior, progress=progress, device=device, bank=bank, **settings)
    metrics = {} if scene is None else evaluate(estimate, scene)
    if scene is None:
        warn_of_estimate(estimate.values.numpy(force=True), "estimate")
    estimate.notes |= metric_notes(metrics)
    written = [estimate.save(target, overwrite=output.overwrite)]
    if output.figures:
        written += estimate_pictures(estimate, target, truth=scene, snapshot=taken, overwrite=output.overwrite)
    _tell(estimate, metrics, target, written, output)


def _given(decoder: type[Decoder] | None, options: dict[str, Any]) -> dict[str, Any]:
    """Settings that have an option of their own; a standard deviation only of decoders that predict it."""
    predicts = decoder is None or decoder.deviation
    return {name: v for name, v in options.items() if v is not None and (predicts or name != "uncertainty")}


def _check_dictionary(file: Path, decoder: str, kind: str, available: dict[str, type[Decoder]]) -> None:
    using = [name for name, cls in available.items() if cls.prior_kind == "dictionary"]
    if decoder not in using:
        wanted = f"one for {', '.join(using)} alone" if using else f"none: no decoder of a {kind} camera uses one"
        raise SettingError("dictionary", str(file), wanted, "leave it out")


def _settings(decoder: type[Decoder] | None, texts: list[str]) -> dict[str, Any]:
    """Settings of a decoder from ``NAME=VALUE``."""
    from tmca.arguments import checked_settings

    pairs = [text.partition("=") for text in texts]
    for name, equals, _ in pairs:
        if not (name and equals):
            raise SettingError("set", repr(name), "NAME=VALUE, such as iterations=50")
    named = {name.strip(): value.strip() for name, _, value in pairs}
    return dict(named) if decoder is None else checked_settings(decoder, named, texts=True)


def _tell(result: Any, metrics: dict[str, float], target: Path, written: list[Path], output: OutputOptions) -> None:
    report: dict[str, Any] = {
        "estimate": str(target),
        "decoder": result.decoder,
        "seconds": round(result.seconds, 2),
        "metrics": metrics,
        "files": [str(file) for file in written],
    }
    figures = (f"  {name:8s} {value:.4g} {meaning(name)}".rstrip() for name, value in metrics.items())
    say(report, output.json, f"{target}: {result.decoder}, {result.seconds:.1f} s", *figures)


for _camera in CAMERA_SPECS:
    app.command(reconstruct, name=_camera, help=f"The same, for the {_camera} camera.")
