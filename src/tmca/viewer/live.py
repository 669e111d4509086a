"""The page of a bench that runs: the newest estimate and its spectra, the snapshot, how long every stage took."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from threading import Condition, Lock
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from tmca.cameras import Snapshot
from tmca.plots.views import brightest, shown
from tmca.viewer.cubes import IRRADIANCE, ONE, colour_layer, wavelength_axis
from tmca.viewer.gallery import Gallery
from tmca.viewer.items import Axis, Item, Layer
from tmca.viewer.snapshots import snapshot_items
from tmca.viewer.viewing import Viewer

if TYPE_CHECKING:
    from tmca.lab.live import Shown

_BINS = 96
_WAIT = 5.0
"""Seconds for which a page waits for an exposure before it hears that there is none."""
_LATELY, _MOMENT = 2.0, 0.5
"""Seconds since a browser asked in which it is still there, and for which it is waited for at the end."""
_COLOURS = 3


class LivePage(Viewer):
    """``with LivePage(port) as page: page.show(newest)``; ``page.address`` opens it in a browser.

    `show` keeps what it is given and returns: what the page needs of it is computed when a browser asks.

    Args:
        port: 0 for any that is free.

    Raises:
        SettingError: a port that is in use, or a package that is missing.
    """

    def __init__(self, port: int = 0) -> None:
        self._newest = Newest()
        super().__init__(self._newest, port)

    def show(self, newest: Shown) -> None:
        """Let browsers have a newer estimate."""
        self._newest.show(newest)

    def close(self) -> None:
        """Tell browsers that it has ended, and stop to serve."""
        self._newest.end()
        super().close()


class Newest(Gallery):
    """What a page shows of a loop: planes, curves and facts of its newest exposure."""

    def __init__(self) -> None:
        super().__init__(())
        self._changed, self._making = Condition(), Lock()
        self._shown: Shown | None = None
        self._ended, self._reported, self._asked = False, False, float("-inf")

    def show(self, newest: Shown) -> None:
        """Let browsers have a newer estimate."""
        with self._changed:
            self._shown = newest
            self._changed.notify_all()

    def end(self) -> None:
        """Let browsers know that there are no more: those that wait, and those that were here lately."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()
            watched = time.monotonic() - self._asked < _LATELY
            self._changed.wait_for(lambda: self._reported, _MOMENT if watched else 0)

    def about(self) -> dict[str, Any]:
        """What the page has to know first; no items before the first exposure."""
        self._make()
        return {**super().about(), "live": True}

    def newest(self, after: int) -> dict[str, Any]:
        """What there is to say of the newest exposure, waited for until it is another one than ``after``."""
        with self._changed:
            self._asked = time.monotonic()
            self._changed.wait_for(
                lambda: self._ended or (self._shown is not None and self._shown.number != after), _WAIT
            )
            self._asked = time.monotonic()
            newest, ended = self._shown, self._ended
            self._reported = ended
            self._changed.notify_all()
        return {"ended": ended, "exposure": -1} if newest is None else {"ended": ended, **status(newest)}

    def _layer(self, item: int, layer: str) -> tuple[Item, Layer]:
        self._make()
        return super()._layer(item, layer)

    def _make(self) -> None:
        with self._making:
            if not self.items and self._shown is not None:
                self.items = live_items(self._now)

    def _now(self) -> Shown:
        assert self._shown is not None
        return self._shown


def live_items(newest: Callable[[], Shown]) -> list[Item]:
    """The estimate and the snapshot of a loop, whose values are those of the newest exposure when they are read."""
    estimate = newest().estimate
    layers = _bands(newest) if estimate.camera.wavelengths else _views(newest)
    facts = {"decoder": estimate.decoder, "camera": f"{estimate.camera.kind}, K = {estimate.camera.slots}"}
    recorded, _ = snapshot_items(Snapshot(newest().values, estimate.camera), "snapshot")
    planes = _Planes(lambda: newest().values.reshape(-1, *newest().values.shape[-2:]))
    facts_of_all = {name: value for name, value in recorded.facts.items() if name != "at full scale"}
    values = replace(recorded.layers[0], read=planes.read, column=planes.column)
    return [Item("live", "estimate", tuple(layers), facts), replace(recorded, layers=(values,), facts=facts_of_all)]


def _bands(newest: Callable[[], Shown]) -> list[Layer]:
    """Bands, colours, and the predicted deviation where there is one."""
    estimate = newest().estimate
    camera, metres = estimate.camera, np.asarray(estimate.camera.wavelengths, np.float64)
    axis, size = wavelength_axis(metres), (camera.scene_shape[-2], camera.scene_shape[-1])
    bands = _Planes(lambda: _still(newest().estimate.values, camera)[0])
    values = Layer("values", IRRADIANCE, size, axis, bands.read, column=bands.column)

    def colours(index: int, rows: slice, columns: slice) -> NDArray[Any]:
        return colour_layer(values, metres).read(index, rows, columns)  # of a white level of this exposure

    layers = [values, replace(colour_layer(values, metres), read=colours)]
    if estimate.deviation is not None:
        spread = _Planes(lambda: _still(newest().estimate.deviation, camera)[0])
        label = "predicted standard deviation"
        layers.append(Layer("deviation", label, size, axis, spread.read, "", "deviation", column=spread.column))
    return layers


def _views(newest: Callable[[], Shown]) -> list[Layer]:
    """The views of a light field, their colours taken together, and the one in the middle in its colours."""
    camera = newest().estimate.camera
    rows, columns, *size = camera.scene_shape
    views = _Planes(lambda: _still(newest().estimate.values, camera).mean(0).reshape(-1, *size))
    axis = Axis.counted("view", rows * columns)
    layers = [Layer("values", IRRADIANCE, (size[0], size[1]), axis, views.read, column=views.column)]
    if len(newest().estimate.values) == _COLOURS:
        layers.append(
            Layer("colour", "view in the middle", (size[0], size[1]), ONE, _middle(newest), colours="picture")
        )
    return layers


def _middle(newest: Callable[[], Shown]) -> Callable[[int, slice, slice], NDArray[Any]]:
    def read(index: int, rows: slice, columns: slice) -> NDArray[Any]:
        camera = newest().estimate.camera
        values = _still(newest().estimate.values, camera)
        middle = np.nan_to_num(values[:, values.shape[1] // 2, values.shape[2] // 2].numpy(force=True))
        picture = shown(np.moveaxis(middle, 0, -1), brightest(middle[:, None, None]))
        return np.round(255 * picture[rows, columns]).astype(np.uint8)

    return read


class _Planes:
    """Planes of a tensor that is another one at every exposure, (planes, rows, columns)."""

    def __init__(self, newest: Callable[[], Tensor]) -> None:
        self._newest = newest

    def read(self, index: int, rows: slice, columns: slice) -> NDArray[Any]:
        """A part of a plane."""
        return np.asarray(self._newest()[index, rows, columns].numpy(force=True))

    def column(self, rows: slice, columns: slice) -> NDArray[Any]:
        """A part of all planes."""
        return np.asarray(self._newest()[:, rows, columns].numpy(force=True))


def status(newest: Shown) -> dict[str, Any]:
    """What the page says beside the pictures; latencies in milliseconds."""
    values = newest.values[0].numpy(force=True)
    counts, edges = np.histogram(values[np.isfinite(values)], _BINS)
    return {
        "exposure": newest.number, "rate": newest.rate, "dropped": newest.dropped, "saturated": newest.saturated,
        "residual": newest.residual, "ms": {name: 1e3 * value for name, value in newest.seconds.items()},
        "histogram": counts, "range": (float(edges[0]), float(edges[-1])), "time": time.time(),
    }  # fmt: skip


def _still(values: Tensor | None, camera: Any) -> Tensor:
    """(B, *scene_shape) of scenes; of those that move, (B, K, *scene_shape), the frame in the middle."""
    assert values is not None
    moves = values.ndim > 1 + len(camera.scene_shape)
    return values[:, values.shape[1] // 2] if moves else values
