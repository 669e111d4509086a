"""The page in a cell of a notebook: its questions come through the kernel, so that it works where no port is open."""

from __future__ import annotations

from typing import Any

from tmca.viewer.gallery import Gallery
from tmca.viewer.page import body, script, style
from tmca.viewer.questions import answer


def notebook_page(gallery: Gallery) -> Any:
    """The page of a gallery as a widget, which needs anywidget; the gallery stays open as long as it is to answer."""
    import anywidget
    import traitlets

    class NotebookPage(anywidget.AnyWidget):  # type: ignore[misc, unused-ignore]
        """The page; its parts come with it."""

        _esm = script("widget")
        _style = traitlets.Unicode(style()).tag(sync=True)
        _body = traitlets.Unicode(body()).tag(sync=True)

    def hear(widget: Any, question: Any, buffers: Any) -> None:
        said, sent = answer(gallery, question)
        widget.send({"id": question.get("id") if isinstance(question, dict) else None, **said}, sent)

    page = NotebookPage()
    page.on_msg(hear)
    return page
