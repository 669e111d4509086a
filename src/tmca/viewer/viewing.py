"""`view`: serve the viewer's page from this process, and the object that stands for it."""

from __future__ import annotations

import secrets
import time
import webbrowser
from html import escape
from importlib.util import find_spec
from pathlib import Path
from socket import SO_REUSEADDR, SOL_SOCKET, socket
from threading import Thread
from typing import Any, Self

from tmca.errors import SettingError, check_range
from tmca.viewer.gallery import Gallery

HOST = "127.0.0.1"
_STARTED = 20.0
"""Seconds in which the server is to answer."""
_LAST = 2
"""Seconds in which answers that are on their way come to their end."""
_PORTS = 65535


class Viewer:
    """A page that is served to this machine alone until `close`.

    Args:
        gallery: what is shown; closed with the viewer.
        port: 0 for any that is free.

    Raises:
        SettingError: a port that is in use, or a package that is missing.
    """

    def __init__(self, gallery: Gallery, port: int = 0) -> None:
        check_installed()
        from tmca.viewer.server import application

        self._gallery, self._socket = gallery, _bound(port)
        self._widget: Any = None
        self._port, token = self._socket.getsockname()[1], secrets.token_urlsafe(16)
        self.address = f"http://{HOST}:{self._port}/?token={token}"
        app = application(gallery, token, {f"{name}:{self._port}" for name in (HOST, "localhost")})
        self._server = _silent_server(app)
        self._thread = Thread(target=self._server.run, args=([self._socket],), name="tmca view", daemon=True)
        self._thread.start()
        end = time.monotonic() + _STARTED
        while not self._server.started and self._thread.is_alive() and time.monotonic() < end:
            time.sleep(0.005)

    def close(self) -> None:
        """Stop to serve, and close the files."""
        self._server.should_exit = True
        self._thread.join(_STARTED)
        self._socket.close()
        self._gallery.close()

    def wait(self) -> None:
        """Serve until Ctrl-C."""
        while self._thread.is_alive():
            self._thread.join(0.5)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<Viewer of {', '.join(item.title for item in self._gallery.items)} at {self.address}>"

    def _repr_mimebundle_(self, **asked: Any) -> Any:
        """The page in the cell, through the kernel where anywidget is installed; else, or where a notebook shows no
        widgets, that of this machine's port."""
        plain = {"text/plain": repr(self), "text/html": self._repr_html_()}
        if find_spec("anywidget") is None:
            return plain
        if self._widget is None:
            from tmca.viewer.notebook import notebook_page

            self._widget = notebook_page(self._gallery)
        shown = self._widget._repr_mimebundle_(**asked)
        data, about = shown if isinstance(shown, tuple) else (shown, {})
        return {**(data or {}), **plain}, about

    def _repr_html_(self) -> str:
        """The page itself, where a notebook runs on this machine."""
        address = escape(self.address)
        frame = f'<iframe src="{address}" width="100%" height="720" style="border:0"></iframe>'
        return f'{frame}<br><a href="{address}" target="_blank">in a window of its own</a>'


def _silent_server(app: Any) -> Any:
    """A server that prints nothing, and does not wait for long when it is to end."""
    import uvicorn

    config = uvicorn.Config(
        app, log_level="critical", access_log=False, lifespan="off", ws="none", http="h11",
        timeout_graceful_shutdown=_LAST,
    )  # fmt: skip
    return uvicorn.Server(config)


def view(*things: Any, truth: Any = None, variable: str | None = None, port: int = 0, browser: bool = False) -> Viewer:
    """Look at files, labelled data, estimates and snapshots in a browser.

    Args:
        things: paths, names of rendered scenes, labelled data (xarray), arrays, `tmca.Estimate` or `tmca.Snapshot`;
            several of one kind are linked side by side.
        truth: the scene that estimates are of, its file or its name: shown beside them, with errors.
        variable: which array, where a file has several.
        port: of the page on this machine; 0 for any that is free.
        browser: open the page in the browser.

    Returns:
        The viewer, which serves until its ``close()``, or the end of Python; a notebook shows it as its page.

    Raises:
        DataError: a file that cannot be shown.
        SettingError: nothing to show, a port in use, or a package that is missing.
    """
    gallery = opened(things, truth, variable)
    try:
        viewer = Viewer(gallery, port)
    except BaseException:
        gallery.close()
        raise
    if browser:
        webbrowser.open(viewer.address)
    return viewer


def write_static(
    path: Any, *things: Any, truth: Any = None, variable: str | None = None, overwrite: bool = False
) -> Path:
    """Write the page of `view` as one HTML file of at most 10 MB, which needs no Python; arguments as of `view`.

    Raises:
        DataError: a file that cannot be shown.
        OutputError: the file exists, or cannot be written.
        SettingError: nothing to show, or more than fits into a file.
    """
    from tmca.viewer.static import write_page

    gallery = opened(things, truth, variable)
    try:
        return write_page(gallery, path, overwrite=overwrite)
    finally:
        gallery.close()


def opened(things: Any, truth: Any = None, variable: str | None = None) -> Gallery:
    """The gallery of `view`; errors as of it."""
    if not things:
        raise SettingError("view", "nothing", "files, labelled data, estimates or snapshots", "name one")
    return Gallery(things, truth, variable)


def missing() -> list[str]:
    """Packages of the extra ``view`` that are not there."""
    return [name for name in ("fastapi", "uvicorn") if find_spec(name) is None]


def check_installed() -> None:
    """Raises SettingError unless the packages of the extra ``view`` are there."""
    if absent := missing():
        found, remedy = f"no {' and no '.join(absent)}", "pip install 'tmca[view]'"
        raise SettingError("view", found, "the packages of the viewer", remedy)


def _bound(port: int) -> socket:
    """A socket of this machine that nobody else listens at."""
    check_range("port", port, 0, _PORTS, whole=True)
    bound = socket()
    bound.setsockopt(SOL_SOCKET, SO_REUSEADDR, 1)
    try:
        bound.bind((HOST, port))
        bound.listen()
    except OSError as error:
        bound.close()
        reason = error.strerror or str(error)
        raise SettingError(
            "port", str(port), "a free port of this machine", f"{reason}; leave it out for any"
        ) from None
    return bound
