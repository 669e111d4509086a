"""``tmca reconstruct``: a snapshot file goes in, the scene comes out."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter

from tmca.cli import spectral_depth
from tmca.cli.options.numbers import MaybeWhole
from tmca.cli.options.output import OutputOptions, check_targets, warned
from tmca.cli.options.scenes import TruthOptions
from tmca.cli.progress import progress_bar
from tmca.cli.way_back import WayBack
from tmca.errors import SettingError

app = App(name="reconstruct", help="Recover the scene from a snapshot file, which says itself which camera took it.")
_OUTPUT, _SCENE = OutputOptions(), TruthOptions()


@app.default
def reconstruct(
    snapshot: Path,
    /,
    *,
    decoder: Annotated[str | None, Parameter(alias="-d")] = None,
    weights: str | None = None,
    prior: Path | None = None,
    dictionary: Path | None = None,
    truth: str | None = None,
    tv_weight: float | None = None,
    uncertainty: bool = True,
    window: MaybeWhole = None,
    set_: Annotated[list[str] | None, Parameter(name="--set")] = None,
    calibration: Path | None = None,
    reading: TruthOptions = _SCENE,
    output: OutputOptions = _OUTPUT,
) -> None:
    """Recover the scene from SNAPSHOT, a file written by `tmca simulate`.

    Args:
        snapshot: snapshot file; it carries codes, optics, exposure and noise, and says which camera took it.
        decoder: one that `tmca decoders` lists for the camera: lmmse (default), admm-tv, pnp-subspace, tikhonov,
            dagger, network, …; of a spectral snapshot also lmmse-adapted (its prior refitted to the snapshot itself);
            of a light-field snapshot also dictionary, dictionary-omp. Of a spectral-depth snapshot likelihood: depth
            and spectrum by the likelihood of every plane under a patch prior; or network.
        weights: of a network: a file or run of `tmca train`, or default, which comes with tmca (spectral, 12 bands);
            the decoder is then network.
        prior: file made by `tmca prior learn` or `learn-views`; the rendered scenes' prior without it (learned once,
            then kept).
        dictionary: file made by `tmca prior learn-views --dictionary`; the decoder is then dictionary.
        truth: the scene, for errors and metrics: a file or the name of a rendered scene; a light field is read as it
            was for the snapshot.
        tv_weight: weight of the total variation; chosen from the noise level without it.
        uncertainty: also estimate every pixel's standard deviation (lmmse, lmmse-adapted, mixture).
        window: side of the windows of likelihood, pixels; 12 without it, or the tile of the codes if that is larger.
        set_: NAME=VALUE, any setting of the decoder; `tmca decoders` lists them. May be given several times.
        calibration: of the camera, by `tmca calibrate`: a file, or its name without the date for the newest. Snapshots
            in digital numbers need one.
    """
    from tmca.decoders import usual_decoder
    from tmca.lab.calibration.apply import load_snapshot

    taken = load_snapshot(snapshot, calibration)
    kind = taken.camera.kind
    decoder = decoder or ("network" if weights else "dictionary" if dictionary else usual_decoder(kind))
    target = output.out or Path(f"{snapshot.stem.removesuffix('_snapshot')}_{decoder}.nc")
    how = {"prior": prior, "tv_weight": tv_weight, "weights": weights, "uncertainty": uncertainty, "window": window}
    how |= _settings(decoder, kind, set_ or [])
    if dictionary is not None and kind != "light-field":
        wanted = "none: only light fields are decoded by one"
        raise SettingError("--dictionary", str(dictionary), wanted, "leave it out")
    if kind == "light-field":
        way = _light_field(taken, reading, how | {"dictionary": dictionary})
    elif kind == "spectral-depth":
        spectral_depth.refuse_reading(reading)
        way = spectral_depth.way_back(taken, how)
    else:
        way = _spectral(taken, reading, how)
    check_targets(way.files(target, output.figures), output.overwrite, snapshot)
    scene = None if truth is None else way.truth(truth)
    with progress_bar(f"{decoder}: {snapshot.name}") as progress:
        result = way.decode(decoder, truth=scene, progress=progress)
    written = [result.save(target, overwrite=output.overwrite)]
    if output.figures:
        written += way.pictures(result, target, truth=scene, overwrite=output.overwrite)
    _say(result, target, written, output)


def _settings(decoder: str, kind: str, texts: list[str]) -> dict[str, Any]:
    """Settings of a decoder from ``NAME=VALUE``."""
    from tmca.decoders import decoders_for
    from tmca.decoders.settings import checked_settings

    pairs = [text.partition("=") for text in texts]
    for name, equals, _ in pairs:
        if not (name and equals):
            raise SettingError("--set", repr(name), "NAME=VALUE, such as iterations=50")
    named = {name.strip(): value.strip() for name, _, value in pairs}
    known = decoders_for(kind, moving=None)
    return checked_settings(known[decoder], named, texts=True) if decoder in known else dict(named)


def _spectral(taken: Any, reading: TruthOptions, how: dict[str, Any]) -> WayBack:
    from tmca.experiments.spectral.imaging import (
        reconstruct_snapshot,
        reconstruction_files,
        reconstruction_pictures,
        true_scene,
    )

    truth = partial(true_scene, snapshot=taken, **reading.reading())
    return WayBack(reconstruction_files, truth, partial(reconstruct_snapshot, taken, **how), reconstruction_pictures)


def _light_field(taken: Any, reading: TruthOptions, how: dict[str, Any]) -> WayBack:
    from tmca.experiments.light_field.imaging import light_field_files, light_field_pictures, reconstruct_light_field
    from tmca.experiments.light_field.truth import true_light_field

    truth = partial(true_light_field, snapshot=taken, told=warned, **reading.views_reading())
    pictures = partial(light_field_pictures, snapshot=taken)
    return WayBack(light_field_files, truth, partial(reconstruct_light_field, taken, **how), pictures)


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


for _camera in ("spectral", "light-field", "spectral-depth"):
    app.command(reconstruct, name=_camera, help=f"The same, for the {_camera} camera.")
