"""The page: HTML, styles and one script, put together from the files beside this one."""

from __future__ import annotations

import re
from importlib.resources import files
from typing import Literal

_IMPORT = re.compile(r'^import\b[^;]*"\./(\w+)\.js";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export (?=(async |const |let |function |class ))", re.MULTILINE)


def script(first: Literal["start", "widget"] = "start") -> str:
    """The script of a page of its own, or of a notebook, as one module that imports nothing."""
    return "\n".join(_EXPORT.sub("", _IMPORT.sub("", part)) for part in _parts(first, {}).values())


def style() -> str:
    """CSS of the page."""
    return _text("style.css")


def body() -> str:
    """HTML of the page, where its script puts what is shown."""
    return _text("body.html")


def _parts(name: str, known: dict[str, str]) -> dict[str, str]:
    """Files of the script by their names, each after those that it imports."""
    text = _text(f"{name}.js")
    for needed in _IMPORT.findall(text):
        if needed not in known:
            _parts(needed, known)
    known[name] = text
    return known


def whole_page(nonce: str = "", embedded: str = "null") -> str:
    """HTML with everything in it.

    Args:
        nonce: of the policy that lets this script run and no other.
        embedded: JSON of what is shown, for a page without a server.
    """
    parts = {"style": style(), "body": body(), "script": script(), "nonce": nonce, "embedded": _in_html(embedded)}
    return re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], _text("page.html"))


def policy(nonce: str) -> str:
    """The page's content security policy: its own script, its own data, nothing from elsewhere."""
    return (
        f"default-src 'none'; script-src 'nonce-{nonce}'; style-src 'unsafe-inline'; connect-src 'self'; "
        "img-src 'self' data: blob:; base-uri 'none'; form-action 'none'"
    )


def _in_html(text: str) -> str:
    """JSON that cannot end the element that it stands in."""
    return text.replace("<", "\\u003c")


def _text(name: str) -> str:
    return files(__name__).joinpath(name).read_text(encoding="utf-8")
