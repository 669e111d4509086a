"""``tmca render``: rendered scenes or light fields as files, of photographs by name, by path, or by the folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from tmca.cli.options.numbers import MaybeWhole, Whole, pair
from tmca.cli.options.numbers import size as parsed_size
from tmca.cli.options.output import Figure, Overwrite, check_figure
from tmca.errors import SettingError

if TYPE_CHECKING:
    import xarray as xr


def render(
    scene: str | None = None,
    /,
    *,
    folder: Annotated[Path | None, Parameter(name="--from")] = None,
    number: MaybeWhole = None,
    out: Path | None = None,
    size: str | None = None,
    illuminant: str | None = None,
    light: Literal["flat", "drawn"] | None = None,
    seed: Whole = 0,
    views: MaybeWhole = None,
    disparity: str | None = None,
    figure: Figure = None,
    overwrite: Overwrite = False,
) -> None:
    """Write a rendered SCENE: radiance and reflectance in 31 bands of 400–700 nm, illuminant, depth.

    With --views a light field in grey with its true disparity instead. With --from a scene of every photograph of a
    folder, and scenes.txt, which --train and --split of other commands take; what was stopped goes on.

    Args:
        scene: astronaut, chelsea, coffee, motorcycle, retina, rocket, tissue; or a photograph of your own: PNG, JPEG,
            BMP, TIFF.
        folder: of photographs, those of folders in it too.
        number: of photographs of the folder, drawn by the seed; all without it.
        out: NetCDF file to write, the scene's name with .nc without it; with --from a folder, its name with _scenes.
        size: HEIGHTxWIDTH, by averaging over areas; the photograph's own without it.
        illuminant: of colour-science (D65, A, LED-B2, …); the scene's own without it.
        light: flat, as photographed; or drawn, from one side with shading, shadows, highlights, dark backgrounds and
            exposures as of laboratory scenes. [default: flat; with --from drawn]
        seed: of the metamers; of a light field's arrangement; of what is drawn of photographs.
        views: n for a light field of n×n views, n odd.
        disparity: LOWEST,HIGHEST of a light field, px per view. [default: -2,2]
    """
    how = _how(parsed_size(size), illuminant, light, views, disparity)
    if folder is not None:
        _folder(folder, scene, figure, out, number=number, seed=seed, overwrite=overwrite, **how)
        return
    if scene is None:
        raise SettingError("SCENE", "none", "a rendered scene's name, a photograph, or --from FOLDER", "coffee is one")
    if number is not None:
        raise SettingError("--number", str(number), "--from FOLDER beside it, of whose photographs it is")
    _one(scene, out, figure, overwrite, seed=seed, **how)


def _one(scene: str, out: Path | None, figure: Path | None, overwrite: bool, **how: Any) -> None:
    from tmca.data import check_target, write_dataset

    check_figure(figure, overwrite)
    target = out or Path(f"{Path(scene).stem}.nc")
    check_target(target, overwrite)
    data = _rendered(scene, how)
    write_dataset(data, target, overwrite=overwrite)
    if figure is not None:
        from tmca.applications.file_pictures import picture_of

        picture_of(target, figure, overwrite=overwrite)
    views = how.get("views")
    about = f"{views}×{views} views" if views is not None else f"illuminant {data.attrs['illuminant']}"
    print(f"{target}: {data.sizes['y']}×{data.sizes['x']} pixels, {about}")


def _folder(folder: Path, scene: str | None, figure: Path | None, out: Path | None, **how: Any) -> None:
    from tmca.data.rendered_folders import SPLIT, render_folder
    from tmca.progress import progress_bar

    for name, given in (("SCENE", scene), ("--figure", figure)):
        if given is not None:
            raise SettingError(name, str(given), f"none beside --from {folder}", "leave one out")
    target = out or Path(f"{folder.resolve().name}_scenes")
    with progress_bar(f"render {target.name}") as progress:
        files = render_folder(folder, target, progress=progress, **how)
    print(f"{target}: {len(files)} scenes, listed in {target / SPLIT}")


def _how(
    size: tuple[int, int] | None, illuminant: str | None, light: str | None, views: int | None, disparity: str | None
) -> dict[str, Any]:
    """What is asked of the scenes, or of the light fields where views are asked for."""
    if views is None:
        if disparity is not None:
            raise SettingError("--disparity", disparity, "--views beside it: only a light field has disparity")
        asked = {"size": size, "illuminant": illuminant, "light": light}
        return {name: value for name, value in asked.items() if value is not None}
    for name, given in (("--illuminant", illuminant), ("--light", light)):
        if given is not None:
            raise SettingError(name, given, "none beside --views: a light field is grey, with surfaces of its own")
    ends = (-2.0, 2.0) if disparity is None else pair(disparity, "--disparity")
    return {"views": views, "size": size, "disparity": ends}


def _rendered(scene: str, how: dict[str, Any]) -> xr.Dataset:
    """The spectral scene, or the light field where views are asked for."""
    from tmca.data import rendered_light_field, rendered_scene

    return rendered_scene(scene, **how) if "views" not in how else rendered_light_field(scene, **how)
