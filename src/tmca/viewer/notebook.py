"""The page in a cell of a notebook: its questions come through the kernel, so that it works where no port is open."""

from __future__ import annotations

from typing import Any

import anywidget
import traitlets

from tmca.viewer.gallery import Gallery
from tmca.viewer.page import body, script, style
from tmca.viewer.questions import answer


class NotebookPage(anywidget.AnyWidget):  # type: ignore[misc]
    """The page of a gallery as a widget.

    Args:
        gallery: what is shown; it stays open as long as the widget is to answer.
    """

    _esm = script("widget")
    _style = traitlets.Unicode(style()).tag(sync=True)
    _body = traitlets.Unicode(body()).tag(sync=True)

    def __init__(self, gallery: Gallery) -> None:
        super().__init__()
        self._gallery = gallery
        self.on_msg(self._hear)

    def _hear(self, widget: Any, question: Any, buffers: Any) -> None:
        said, sent = answer(self._gallery, question)
        self.send({"id": question.get("id") if isinstance(question, dict) else None, **said}, sent)
