"""What the explicit matrix of a camera says, on a corner small enough to have one."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from tmca.cameras import SpectralCamera
from tmca.operators import coloured_code, conditioning, sparse_matrix
from tmca.optics import Dispersion


def corner_conditioning(camera: SpectralCamera, rows: int = 2, columns: int = 40) -> dict[str, Any]:
    """Rank, condition number and coherence of the matrix of the camera's first rows and columns (no relay blur).

    Rows do not mix in a disperser, so that few of them tell what there is to tell.
    """
    height, width = min(rows, camera.size[0]), min(columns, camera.size[1])
    code = camera.code_cube().detach()[:, :height, :width].double()
    dispersion = camera.dispersion if camera.disperser == "single" else Dispersion((0.0,) * camera.bands)
    report = conditioning(sparse_matrix(coloured_code(code, dispersion, camera.response.double())))
    return {"rows": height, "columns": width, **asdict(report)}
