"""A page of the loop on this machine alone: the newest estimate, its spectrum at a point, a histogram, latencies."""

from __future__ import annotations

import io
import json
import secrets
import sys
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from socket import socket
from threading import Condition, Thread
from typing import Any
from urllib.parse import parse_qsl, urlsplit

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from tmca.data import plain
from tmca.errors import SettingError
from tmca.lab.live.loop import Shown
from tmca.plots.cube import rgb_composite

_HOST, _BINS, _QUALITY = "127.0.0.1", 64, 85
_WAIT = 5.0
"""Seconds for which a browser waits for a frame before it hears that there is none."""
_DIGITS = 9
"""Of a row or column at most."""
_POLL = 0.1
"""Seconds after which the server looks whether it is to end."""
_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'self'; style-src 'unsafe-inline'; script-src 'unsafe-inline'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
}


class LivePage:
    """``with LivePage(port) as page: page.show(shown)``; ``page.address`` opens it in a browser.

    It is served to this machine alone, to who knows the token in its address, and takes no orders.

    Args:
        port: 0 for any that is free.

    Raises:
        SettingError: a port that is in use.
    """

    def __init__(self, port: int = 0) -> None:
        self.token = secrets.token_urlsafe(16)
        self._changed = Condition()
        self._shown: Shown | None = None
        self.ended = False
        page = self

        class Handler(_Handler):
            board = page

        try:
            self._server = _Server((_HOST, port), Handler)
        except (OSError, OverflowError) as error:
            raise SettingError("port", str(port), "a free port of this machine", str(error)) from None
        self._port = self._server.socket.getsockname()[1]

    @property
    def address(self) -> str:
        """Of the page, token included."""
        return f"http://{_HOST}:{self._port}/?token={self.token}"

    @property
    def hosts(self) -> set[str]:
        """Names by which a browser of this machine asks for it; others are those of somebody else's page."""
        return {f"{name}:{self._port}" for name in (_HOST, "localhost")}

    def __enter__(self) -> LivePage:
        Thread(target=self._server.serve_forever, args=(_POLL,), name="tmca page", daemon=True).start()
        return self

    def __exit__(self, *error: object) -> None:
        with self._changed:
            self.ended = True
            self._changed.notify_all()
        self._server.shutdown()
        self._server.server_close()

    def show(self, shown: Shown) -> None:
        """Let browsers have a newer estimate."""
        with self._changed:
            self._shown = shown
            self._changed.notify_all()

    def newest(self, after: int = -1) -> Shown | None:
        """The newest estimate, waited for until there is one of another exposure than ``after``; None at the end."""
        with self._changed:
            self._changed.wait_for(
                lambda: self.ended or (self._shown is not None and self._shown.number != after), _WAIT
            )
            return None if self.ended else self._shown


class _Server(ThreadingHTTPServer):
    """A thread for every browser, none of which is waited for."""

    daemon_threads = True

    def handle_error(self, request: socket | tuple[bytes, socket], client_address: Any) -> None:
        """Nothing where a browser went away or stopped to listen; the terminal shows the loop."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    """Answers of the page."""

    board: LivePage
    protocol_version = "HTTP/1.1"
    timeout = 60.0

    def do_GET(self) -> None:
        asked = urlsplit(self.path)
        query = dict(parse_qsl(asked.query))
        token = query.get("token", "").encode(errors="replace")
        known = secrets.compare_digest(token, self.board.token.encode())
        if self.headers.get("Host") not in self.board.hosts or not known:
            self._answer(403, "text/plain", b"the address that `tmca live` printed is needed, token included\n")
        elif asked.path == "/":
            html = files("tmca.lab.live").joinpath("page.html").read_text(encoding="utf-8")
            self._answer(200, "text/html; charset=utf-8", html.replace("{{token}}", self.board.token).encode())
        elif asked.path == "/stream":
            self._stream()
        elif asked.path in ("/status", "/spectrum"):
            self._say(asked.path, query)
        else:
            self._answer(404, "text/plain", b"there is no such page\n")

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing: the terminal shows the loop."""

    def _begin(self, code: int, **headers: str) -> None:
        self.send_response(code)
        for name, value in {**_HEADERS, **headers}.items():
            self.send_header(name.replace("_", "-"), value)
        self.end_headers()

    def _answer(self, code: int, kind: str, body: bytes) -> None:
        self._begin(code, Content_Type=kind, Content_Length=str(len(body)))
        self.wfile.write(body)

    def _stream(self) -> None:
        """Pictures one after the other (``multipart/x-mixed-replace``), as browsers show them in an image."""
        self._begin(200, Content_Type="multipart/x-mixed-replace; boundary=frame")
        self.close_connection, last = True, -1
        self.wfile.write(b"--frame\r\n")
        while (shown := self.board.newest(last)) is not None:
            if shown.number != last:
                body = jpeg(picture(shown))
                head = f"Content-Type: image/jpeg\r\nContent-Length: {len(body)}\r\n\r\n"
                self.wfile.write(head.encode() + body + b"\r\n--frame\r\n")  # the end of the part: it is shown at once
                last = shown.number

    def _say(self, path: str, query: dict[str, str]) -> None:
        shown = self.board.newest()
        if path == "/spectrum":
            said = {} if shown is None else spectrum(shown, query.get("y", ""), query.get("x", ""))
        else:
            said = {"ended": self.board.ended} if shown is None else status(shown)
        self._answer(200, "application/json", json.dumps(plain(said), allow_nan=False).encode())


def picture(shown: Shown) -> NDArray[np.uint8]:
    """(H, W, 3) estimate as a browser shows it: bands as a composite, of a light field the view in the middle."""
    camera = shown.estimate.camera
    values = _still(shown.estimate.values, camera).numpy(force=True)
    if camera.wavelengths:
        composite = rgb_composite(values[0], camera.wavelengths)
    else:
        views = values[:, values.shape[1] // 2, values.shape[2] // 2]
        grey = views if len(views) == 3 else np.repeat(views[:1], 3, 0)
        composite = np.moveaxis(np.clip(grey / max(float(np.quantile(grey, 0.995)), 1e-6), 0, 1) ** (1 / 2.2), 0, -1)
    return (255 * composite).astype(np.uint8)


def jpeg(pixels: NDArray[np.uint8]) -> bytes:
    """The file of a picture (H, W, 3)."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "JPEG", quality=_QUALITY)
    return buffer.getvalue()


def status(shown: Shown) -> dict[str, Any]:
    """What the page says beside the picture; latencies in milliseconds."""
    values = shown.values[0].numpy(force=True)
    counts, edges = np.histogram(values, _BINS)
    return {
        "exposure": shown.number, "rate": shown.rate, "dropped": shown.dropped, "saturated": shown.saturated,
        "residual": shown.residual, "ms": {name: 1e3 * value for name, value in shown.seconds.items()},
        "histogram": counts.tolist(), "range": [float(edges[0]), float(edges[-1])],
        "size": list(shown.estimate.values.shape[-2:]), "decoder": shown.estimate.decoder, "time": time.time(),
    }  # fmt: skip


def spectrum(shown: Shown, row: str, column: str) -> dict[str, Any]:
    """Values of all bands, or views, at a pixel, with their deviation where there is one; nothing beside the frame.

    Of a scene that moves, those of the frame in the middle, which the picture shows too.
    """
    height, width = shown.estimate.values.shape[-2:]
    if not all(place.isdecimal() and len(place) <= _DIGITS for place in (row, column)):
        return {}
    if int(row) >= height or int(column) >= width:
        return {}
    place, camera, deviation = (..., int(row), int(column)), shown.estimate.camera, shown.estimate.deviation
    return {
        "heading": "Spectrum" if camera.wavelengths else "Views",
        "nm": [1e9 * length for length in camera.wavelengths],
        "values": _still(shown.estimate.values, camera)[0][place].flatten().tolist(),
        "deviation": None if deviation is None else _still(deviation, camera)[0][place].flatten().tolist(),
    }


def _still(values: Tensor, camera: Any) -> Tensor:
    """(B, *scene_shape) of scenes; of those that move, (B, K, *scene_shape), the frame in the middle."""
    moves = values.ndim > 1 + len(camera.scene_shape)
    return values[:, values.shape[1] // 2] if moves else values
