"""``tmca reconstruct``: a snapshot file goes in, the scene comes out."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter

from tmca.cli.options import OutputOptions, SceneOptions, check_targets
from tmca.cli.progress import progress_bar

app = App(name="reconstruct", help="Recover the scene from a snapshot file, which says itself which camera took it.")
_OUTPUT, _SCENE = OutputOptions(), SceneOptions()


@app.default
def reconstruct(
    snapshot: Path,
    /,
    *,
    decoder: Annotated[str | None, Parameter(alias="-d")] = None,
    weights: str | None = None,
    prior: Path | None = None,
    truth: str | None = None,
    tv_weight: float | None = None,
    uncertainty: bool = True,
    reading: SceneOptions = _SCENE,
    output: OutputOptions = _OUTPUT,
) -> None:
    """Recover the scene from SNAPSHOT, a file written by `tmca simulate`.

    Args:
        snapshot: snapshot file; it carries codes, dispersion, wavelengths, exposure and noise.
        decoder: lmmse (default), lmmse-adapted (its prior refitted to the snapshot itself), mixture,
            admm-tv, admm-tv-joint, pnp-tv, pnp-nl-means, dagger, or network.
        weights: of a network: a file or run of `tmca train`, or default, which comes with tmca (12 bands); the decoder
            is then network.
        prior: file made by `tmca prior learn`; the rendered scenes' prior without it (learned once, then kept).
        truth: the scene, for errors and metrics: a file or the name of a rendered scene.
        tv_weight: weight of the total variation; chosen from the noise level without it.
        uncertainty: also estimate every pixel's standard deviation (lmmse, lmmse-adapted, mixture).
    """
    from tmca.cameras import Snapshot
    from tmca.experiments.spectral import (
        reconstruct_snapshot,
        reconstruction_files,
        reconstruction_pictures,
        true_scene,
    )

    decoder = decoder or ("network" if weights else "lmmse")
    target = output.out or Path(f"{snapshot.stem.removesuffix('_snapshot')}_{decoder}.nc")
    check_targets(reconstruction_files(target, output.figures), output.overwrite, snapshot)
    taken = Snapshot.load(snapshot)
    scene = None if truth is None else true_scene(truth, taken, **reading.reading())
    with progress_bar(f"{decoder}: {snapshot.name}") as progress:
        result = reconstruct_snapshot(
            taken,
            decoder,
            prior=prior,
            tv_weight=tv_weight,
            weights=weights,
            uncertainty=uncertainty,
            truth=scene,
            progress=progress,
        )
    written = [result.save(target, overwrite=output.overwrite)]
    if output.figures:
        written += reconstruction_pictures(result, target, truth=scene, overwrite=output.overwrite)
    report: dict[str, Any] = {
        "estimate": str(target),
        "decoder": decoder,
        "seconds": round(result.seconds, 2),
        "metrics": result.metrics,
        "files": [str(file) for file in written],
    }
    if output.json:
        print(json.dumps(report, indent=1))
        return
    print(f"{target}: {decoder}, {result.seconds:.1f} s")
    for name, value in result.metrics.items():
        print(f"  {name:6s} {value:.4g}")


app.command(reconstruct, name="spectral", help="The same, for the spectral camera.")
