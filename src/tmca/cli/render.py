"""``tmca render``: a rendered scene or light field as a file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from tmca.cli.options.numbers import MaybeWhole, Whole, pair
from tmca.cli.options.numbers import size as parsed_size
from tmca.cli.options.output import Figure, Overwrite, check_figure
from tmca.errors import SettingError

if TYPE_CHECKING:
    import xarray as xr


def render(
    scene: str,
    /,
    *,
    out: Path | None = None,
    size: str | None = None,
    illuminant: str | None = None,
    seed: Whole = 0,
    views: MaybeWhole = None,
    disparity: str | None = None,
    figure: Figure = None,
    overwrite: Overwrite = False,
) -> None:
    """Write a rendered SCENE: radiance and reflectance in 31 bands of 400–700 nm, illuminant, depth.

    With --views a light field in grey with its true disparity instead.

    Args:
        scene: astronaut, chelsea, coffee, motorcycle, retina, rocket, tissue.
        out: NetCDF file to write; the scene's name with .nc without it.
        size: HEIGHTxWIDTH, by averaging over areas; the photograph's own without it.
        illuminant: of colour-science (D65, A, LED-B2, …); the scene's own without it.
        seed: of the metamers; of a light field's arrangement.
        views: n for a light field of n×n views, n odd.
        disparity: LOWEST,HIGHEST of a light field, px per view. [default: -2,2]
    """
    from tmca.data import check_target, write_dataset

    check_figure(figure, overwrite)
    target = out or Path(f"{scene}.nc")
    check_target(target, overwrite)
    data = _rendered(scene, parsed_size(size), illuminant, seed, views, disparity)
    write_dataset(data, target, overwrite=overwrite)
    if figure is not None:
        from tmca.applications.file_pictures import picture_of

        picture_of(target, figure, overwrite=overwrite)
    about = f"{views}×{views} views" if views is not None else f"illuminant {data.attrs['illuminant']}"
    print(f"{target}: {data.sizes['y']}×{data.sizes['x']} pixels, {about}")


def _rendered(
    scene: str,
    size: tuple[int, int] | None,
    illuminant: str | None,
    seed: int,
    views: int | None,
    disparity: str | None,
) -> xr.Dataset:
    """The spectral scene, or the light field where views are asked for."""
    from tmca.data import rendered_light_field, rendered_scene

    if views is None:
        if disparity is not None:
            raise SettingError("--disparity", disparity, "--views beside it: only a light field has disparity")
        return rendered_scene(scene, size=size, illuminant=illuminant, seed=seed)
    if illuminant is not None:
        raise SettingError("--illuminant", illuminant, "none beside --views: a light field is grey")
    ends = (-2.0, 2.0) if disparity is None else pair(disparity, "--disparity")
    return rendered_light_field(scene, views=views, size=size, seed=seed, disparity=ends)
