"""``tmca reconstruct``: a snapshot file goes in, the scene comes out."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter

from tmca.cli.cameras import READING
from tmca.cli.options.numbers import MaybeWhole, On
from tmca.cli.options.output import OutputOptions, check_targets, warned
from tmca.cli.progress import progress_bar
from tmca.errors import SettingError
from tmca.specs import TruthReading

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
    reading: Annotated[TruthReading, READING] = _READING,
    output: OutputOptions = _OUTPUT,
) -> None:
    """Recover the scene from SNAPSHOT, a file written by `tmca simulate`.

    Args:
        snapshot: snapshot file; it carries codes, optics, exposure and noise, and says which camera took it.
        decoder: one that `tmca decoders` lists for the camera: lmmse (default), admm-tv, pnp-subspace, tikhonov,
            dagger, network, …; of a spectral snapshot also lmmse-adapted (its prior refitted to the snapshot itself);
            of a light-field snapshot also dictionary, dictionary-omp. Of a spectral-depth snapshot likelihood: depth
            and spectrum by the likelihood of every plane under a patch prior; or network.
        truth: the scene, for errors and metrics: a file or the name of a rendered scene; a light field is read as it
            was for the snapshot.
        weights: of a network: a file or run of `tmca train`, or default, which comes with tmca (spectral, 12 bands);
            the decoder is then network.
        prior: file made by `tmca prior learn` or `learn-views`; the rendered scenes' prior without it (learned once,
            then kept).
        set_: NAME=VALUE, any setting of the decoder; `tmca decoders` lists them. May be given several times.
        calibration: of the camera, by `tmca calibrate`: a file, or its name without the date for the newest. Snapshots
            in digital numbers need one.
        dictionary: file made by `tmca prior learn-views --dictionary`; the decoder is then dictionary.
        tv_weight: weight of the total variation; chosen from the noise level without it.
        uncertainty: also estimate every pixel's standard deviation (lmmse, lmmse-adapted, mixture).
        window: side of the windows of likelihood, pixels; 12 without it, or the tile of the codes if that is larger.
    """
    from tmca.decoders import usual_decoder
    from tmca.lab.calibration.apply import load_snapshot

    taken = load_snapshot(snapshot, calibration)
    kind = taken.camera.kind
    name = decoder or ("network" if weights else "dictionary" if dictionary else usual_decoder(kind))
    _check_dictionary(dictionary, name, kind)
    how: dict[str, Any] = {"prior": dictionary or prior, "tv_weight": tv_weight, "weights": weights}
    how |= {"uncertainty": uncertainty, "window": window, **_settings(name, kind, set_ or [])}
    asked = reading.of(kind)
    target = output.out or Path(f"{snapshot.stem.removesuffix('_snapshot')}_{name}.nc")
    check_targets(_files(kind, target, output.figures), output.overwrite, snapshot)
    scene = None if truth is None else _truth(truth, taken, asked)
    with progress_bar(f"{name}: {snapshot.name}") as progress:
        result = _decoded(taken, name, scene, how, progress)
    written = [result.save(target, overwrite=output.overwrite)]
    if output.figures:
        written += _pictures(result, taken, target, scene, output.overwrite)
    _say(result, target, written, output)


for _camera in ("spectral", "light-field", "spectral-depth"):
    app.command(reconstruct, name=_camera, help=f"The same, for the {_camera} camera.")


def _check_dictionary(dictionary: Path | None, decoder: str, kind: str) -> None:
    from tmca.decoders import decoders

    if dictionary is None:
        return
    if kind != "light-field" or decoder not in decoders() or decoders()[decoder].prior_kind != "dictionary":
        wanted = "none: only dictionary and dictionary-omp, of light fields, use it"
        raise SettingError("dictionary", f"one for {decoder}", wanted, "leave it out")


def _settings(decoder: str, kind: str, texts: list[str]) -> dict[str, Any]:
    """Settings of a decoder from ``NAME=VALUE``."""
    from tmca.decoders import decoders_for
    from tmca.decoders.settings import checked_settings

    pairs = [text.partition("=") for text in texts]
    for name, equals, _ in pairs:
        if not (name and equals):
            raise SettingError("set", repr(name), "NAME=VALUE, such as iterations=50")
    named = {name.strip(): value.strip() for name, _, value in pairs}
    known = decoders_for(kind, moving=None)
    return checked_settings(known[decoder], named, texts=True) if decoder in known else dict(named)


def _decoded(taken: Any, decoder: str, scene: Any, how: dict[str, Any], progress: Any) -> Any:
    """The estimate, with its metrics where the scene is known."""
    from tmca.applications import application_of
    from tmca.experiments.reconstructions import Reconstruction, decoded

    estimate = decoded(taken, decoder, progress=progress, **how)
    if scene is None:
        return Reconstruction.of(estimate)
    parts = {"values": estimate.values.numpy(force=True)}
    parts |= {} if estimate.depth is None else {"depth": estimate.depth[0, 0].numpy(force=True)}
    return Reconstruction.of(estimate, application_of(taken.camera).metrics(parts, scene, taken.camera))


def _truth(source: str, taken: Any, reading: dict[str, Any]) -> Any:
    """The scene of a snapshot, read as it was for it."""
    from tmca.experiments.light_field.truth import true_light_field
    from tmca.experiments.spectral.imaging import true_scene
    from tmca.experiments.spectral_depth.truth import true_spectral_depth

    if taken.camera.kind == "light-field":
        return true_light_field(source, taken, told=warned, **reading)
    if taken.camera.kind == "spectral-depth":
        return true_spectral_depth(source, taken)
    return true_scene(source, taken, **reading)


def _files(kind: str, target: Path, figures: bool) -> list[Path]:
    """What an estimate and its pictures will be called."""
    pictures = [target.with_suffix(".png")]
    if kind == "light-field":
        pictures += [target.with_name(f"{target.stem}_refocus.png"), target.with_suffix(".gif")]
    return [target, *(pictures if figures else [])]


def _pictures(result: Any, taken: Any, target: Path, scene: Any, overwrite: bool) -> list[Path]:
    from tmca.experiments.light_field.imaging import light_field_pictures
    from tmca.experiments.spectral.imaging import reconstruction_pictures
    from tmca.experiments.spectral_depth.imaging import spectral_depth_pictures

    if taken.camera.kind == "light-field":
        return light_field_pictures(result, target, snapshot=taken, truth=scene, overwrite=overwrite)
    if taken.camera.kind == "spectral-depth":
        return spectral_depth_pictures(result, target, snapshot=taken, truth=scene, overwrite=overwrite)
    return reconstruction_pictures(result, target, truth=scene, overwrite=overwrite)


def _say(result: Any, target: Path, written: list[Path], output: OutputOptions) -> None:
    report: dict[str, Any] = {
        "estimate": str(target),
        "decoder": result.decoder,
        "seconds": round(result.seconds, 2),
        "metrics": result.metrics,
        "files": [str(file) for file in written],
    }
    if output.json:
        print(json.dumps(report, indent=1))
        return
    print(f"{target}: {result.decoder}, {result.seconds:.1f} s")
    for name, value in result.metrics.items():
        print(f"  {name:8s} {value:.4g}")
