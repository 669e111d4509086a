"""``tmca render``: a rendered scene as a file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from tmca.cli.numbers import Whole


def render(
    scene: str,
    /,
    *,
    out: Path | None = None,
    size: str | None = None,
    illuminant: str | None = None,
    seed: Whole = 0,
    figure: Path | None = None,
    overwrite: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Write a rendered SCENE: radiance and reflectance in 31 bands of 400–700 nm, illuminant, depth.

    Args:
        scene: astronaut, chelsea, coffee, motorcycle, retina, rocket, tissue.
        out: NetCDF file to write; the scene's name with .nc without it.
        size: HEIGHTxWIDTH, by averaging over areas; the photograph's own without it.
        illuminant: of colour-science (D65, A, LED-B2, …); the scene's own without it.
        seed: of the metamers.
        figure: write a picture of it (PNG).
        overwrite: replace files that exist.
    """
    from tmca.cli.options import check_figure
    from tmca.cli.options import size as parsed_size
    from tmca.data import rendered_scene, write_dataset

    check_figure(figure, overwrite)
    target = out or Path(f"{scene}.nc")
    data = rendered_scene(scene, size=parsed_size(size), illuminant=illuminant, seed=seed)
    write_dataset(data, target, overwrite=overwrite)
    if figure is not None:
        from tmca.experiments.pictures import picture_of

        picture_of(target, figure, overwrite=overwrite)
    print(f"{target}: {data.sizes['y']}×{data.sizes['x']} pixels, illuminant {data.attrs['illuminant']}")
