"""What files say of cameras beside their variables."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, Json

from tmca.attributes import Attributes
from tmca.codes.files import Frame


class CameraAttributes(Attributes):
    """What a file says of any camera; ``Sensor`` checks its own arguments, and ``size`` is where codes repeat."""

    exposure: str
    full_scale: float = Field(gt=0)
    sensor: Json[dict[str, Any]]
    buckets: Annotated[int, Field(ge=1, le=256)] = 1
    size: Json[Frame] | None = None


class CodedAttributes(CameraAttributes):
    """Of a camera with an aperture and a shutter."""

    period: Json[Frame | None] = None
