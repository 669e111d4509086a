"""Which pixel of a device shows which pixel of a code: macro-pixels, lattices, mounted turned or mirrored."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, radians
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tmca.errors import DataError, SettingError
from tmca.lab.display.devices import DeviceDescription

_SLACK = 1e-9
Size = tuple[int, int]
Side = Annotated[int, Field(ge=1, le=2**15)]
Affine = tuple[tuple[float, float, float], tuple[float, float, float]]


@dataclass(frozen=True)
class Placement:
    """How a code of (H, W) pixels lies on a device of (R, C) pixels, middle on middle.

    Args:
        code: (H, W).
        device: (R, C).
        macro_pixel: device pixels along the side of a code pixel.
        angle: by which the device is mounted turned, degrees.
        lattice: ``"square"`` or ``"diamond"``.
        flip: axes along which the device mirrors, of ``"rows"`` and ``"columns"``.
        offset: (rows, columns) by which the code is displaced from the middle, pitches: device pixels, of a diamond
            lattice two rows and a pixel of a row.
        affine: 2×3, from code pixel (row, column, 1) to device pixel, as a registration measures it; it takes the place
            of all that is above.
    """

    code: tuple[Side, Side]
    device: tuple[Side, Side]
    macro_pixel: Annotated[float, Field(gt=0, le=1024)] = 1.0
    angle: float = 0.0
    lattice: Literal["square", "diamond"] = "square"
    flip: tuple[Literal["rows", "columns"], ...] = ()
    offset: tuple[int, int] = (0, 0)
    affine: Affine | None = None

    @classmethod
    def of(cls, device: DeviceDescription, code: tuple[int, int], offset: tuple[int, int] = (0, 0)) -> Placement:
        """Of a code on a device as it is described; a sensor without a size has that of the code."""
        how = (device.macro_pixel, device.mounting_angle_deg, device.lattice, device.flip, offset)
        return cls(code, device.size or code, *how)

    @classmethod
    def by(cls, affine: Affine, device: Size, code: Size) -> Placement:
        """Of a code whose place on a device was measured."""
        scale = float(np.sqrt(abs(np.linalg.det(np.array(affine)[:, :2]))))
        return cls(code, device, scale, affine=affine)

    @property
    def share(self) -> float:
        """Of the device that the code covers."""
        dense = 2 if self.lattice == "diamond" and self.affine is None else 1
        (height, width), (rows, columns) = self.code, self.device
        return dense * height * width * self.macro_pixel**2 / (rows * columns)

    def index(self) -> NDArray[np.int64]:
        """(R, C) index ``W·row + column`` of the code pixel that each device pixel shows; -1 for none.

        Raises:
            SettingError: a code pixel that no device pixel shows.
        """
        margin = 2 * ceil(self.macro_pixel)
        rows, columns = self._places(margin)
        inside = (rows >= 0) & (rows < self.code[0]) & (columns >= 0) & (columns < self.code[1])
        wide = np.where(inside, rows * self.code[1] + columns, -1)
        inner = wide[margin:-margin, margin:-margin]
        every, shown = (np.bincount(i[i >= 0], minlength=self.code[0] * self.code[1]) for i in (wide, inner))
        missing = (shown == 0) | (shown < every)  # hidden, or cut off
        if missing.any():
            self._refuse(int(missing.argmax()))
        return inner

    def shown(self, patterns: NDArray[np.generic], outside: float = 0) -> NDArray[np.generic]:
        """(K, H, W) codes → (K, R, C) frames; pixels without a code show ``outside``."""
        index = self.index()
        flat = patterns.reshape(len(patterns), -1)
        return np.where(index >= 0, flat[:, index.clip(0)], np.asarray(outside, patterns.dtype))

    def read_back(self, frames: NDArray[np.generic], where: str) -> NDArray[np.generic]:
        """(K, R, C) frames → (K, H, W) codes, each the value of the device pixels that show it.

        Raises:
            DataError: frames of another size, or device pixels of one code pixel that differ.
        """
        if frames.shape[1:] != self.device:
            wanted = f"{self.device[0]}×{self.device[1]} pixels"
            raise DataError(where, f"frames of {frames.shape[1]}×{frames.shape[2]} pixels", wanted, "export it again")
        index = self.index()
        inside = index >= 0
        places, levels = index[inside], frames[:, inside]
        codes = np.zeros((len(frames), self.code[0] * self.code[1]), frames.dtype)
        codes[:, places] = levels
        if not np.array_equal(codes[:, places], levels):
            raise DataError(where, "device pixels of one code pixel that differ", "equal ones", "export it again")
        return codes.reshape(len(frames), *self.code)

    def _places(self, margin: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Row and column of the code under each pixel of the device and its margin; (R, 1) and (1, C) where rows and
        columns are independent."""
        sides = (np.arange(-margin, n + margin, dtype=np.float64) for n in self.device)
        y, x = np.meshgrid(*sides, indexing="ij", sparse=self.affine is None)
        if self.affine is not None:
            matrix = np.array(self.affine)
            y, x = np.einsum("ij,j...->i...", np.linalg.inv(matrix[:, :2]), np.stack((y, x)) - matrix[:, 2, None, None])
            return np.floor(y + 0.5 + _SLACK).astype(np.int64), np.floor(x + 0.5 + _SLACK).astype(np.int64)
        if self.lattice == "diamond":
            y, x = y / 2, x + 0.5 * (y % 2)
        y, x = (part - self._corner(axis) for axis, part in enumerate((y, x)))
        if self.angle != 0:
            turn = radians(self.angle)
            y, x = np.cos(turn) * y + np.sin(turn) * x, np.cos(turn) * x - np.sin(turn) * y
        y = -y if "rows" in self.flip else y
        x = -x if "columns" in self.flip else x
        rows, columns = (part / self.macro_pixel + n / 2 for part, n in zip((y, x), self.code, strict=True))
        return np.floor(rows + _SLACK).astype(np.int64), np.floor(columns + _SLACK).astype(np.int64)

    def _corner(self, axis: int) -> float:
        """The code's middle, pitches from the first pixel; whole macro-pixels lie on whole pixels where nothing is
        turned."""
        length, side = self.device[axis], self.code[axis] * self.macro_pixel
        if self.lattice == "diamond":  # rows 0 to (R - 1) / 2, columns 0 to C - 1/2
            middle = (length - 1) / 4 if axis == 0 else (length - 0.5) / 2
        else:
            middle = (np.floor((length - side) / 2) + side / 2 if self.angle == 0 else length / 2) - 0.5
        return float(middle + self.offset[axis])

    def _refuse(self, missing: int) -> None:
        row, column = divmod(missing, self.code[1])
        shown = f"{self.code[0]}×{self.code[1]} code pixels at {self.macro_pixel:.3g} device pixels each"
        found = f"{shown}, of which ({row}, {column}) is cut off or hidden"
        where = "--calibration" if self.affine is not None else "--offset" if any(self.offset) else "--macro-pixel"
        expected = f"all on its {self.device[0]}×{self.device[1]} pixels, at 1 of them or more each"
        remedy = "take a smaller code, --macro-pixel 2 or more where patterns are turned, and no --offset"
        upright = self.angle == 0 and self.lattice == "square" and self.affine is None
        if upright and any(n * self.macro_pixel > room for n, room in zip(self.code, self.device, strict=True)):
            remedy = self._smaller()
        raise SettingError(where, found, expected, remedy)

    def _smaller(self) -> str:
        """What would fit of an upright code that does not."""
        side = min(room // n for n, room in zip(self.code, self.device, strict=True))
        rows, columns = (int(room // self.macro_pixel) for room in self.device)
        smaller = f"a code of {rows}x{columns} or less (--code-size where it repeats)"
        return f"take --macro-pixel {side} or less, or {smaller}" if side else f"take {smaller}"
