"""What the explicit matrix of a camera says, on a corner small enough to have one."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from tmca.cameras import Camera, SpectralCamera
from tmca.errors import SettingError
from tmca.operators import conditioning, dual_disperser, single_disperser, sparse_matrix


def corner_conditioning(camera: Camera, rows: int = 2, columns: int = 40) -> dict[str, Any]:
    """Rank, condition number and coherence of the matrix of the camera's first rows and columns (no relay blur).

    Rows do not mix in a disperser, so that few of them tell what there is to tell.

    Raises:
        SettingError: a camera without a disperser.
    """
    if not isinstance(camera, SpectralCamera):
        raise SettingError("conditioning", f"a {camera.kind} camera", "a spectral camera", "its matrix has a corner")
    height, width = min(rows, camera.size[0]), min(columns, camera.size[1])
    build, wide = single_disperser, camera.dispersion.extent
    aperture_width, shutter_width = width, width + wide
    if camera.disperser == "dual":
        build, aperture_width, shutter_width = dual_disperser, width + wide, width
    aperture, shutter = (plane.detach().double() for plane in camera.codes())
    operator = build(
        aperture[:, :height, :aperture_width],
        shutter[:, :height, :shutter_width],
        camera.dispersion,
        camera.response.detach().double(),
        camera.exposure,
    )
    return {"rows": height, "columns": width, **asdict(conditioning(sparse_matrix(operator)))}
