"""Help pages: what is used most on a screen, all of it with ``--help-all``."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from typing import TYPE_CHECKING, Any

from cyclopts.help import DefaultFormatter, HelpEntry, HelpPanel, InlineText, PanelSpec
from rich.box import Box
from rich.text import Text

if TYPE_CHECKING:
    from cyclopts import App
    from rich.console import Console, ConsoleOptions

FLAGS = ("--help", "-h", "--help-all")
_SCREEN = 40
"""Lines."""
_RULE = Box("──  \n    \n    \n    \n    \n    \n    \n    \n")
"""A title in a line, and nothing around what follows."""
_MAIN = ("Commands", "Arguments", "Parameters", "Camera", "Search")
"""Groups whose options are explained longest."""
_LEVELS = ((99, False), (8, False), (99, True), (16, True), (12, True), (8, True), (5, True), (3, True), (1, True))
"""Options that are explained in every group, and whether those of the other groups are only named; most first."""


class Page:
    """A help page that is printed shorter or longer: what cyclopts hands to a formatter of it."""

    def __init__(self) -> None:
        self.panels: list[HelpPanel] = []
        self.usage: Any = None
        self.description: Any = None
        self.formatter = DefaultFormatter(panel_spec=PanelSpec(box=_RULE))

    def __call__(self, console: Console, options: ConsoleOptions, panel: HelpPanel) -> None:
        """Take a group of options or commands."""
        if panel.entries:
            self.panels.append(panel)

    def render_usage(self, console: Console, options: ConsoleOptions, usage: Any) -> None:
        """Take how the command is called."""
        self.usage = usage

    def render_description(self, console: Console, options: ConsoleOptions, description: Any) -> None:
        """Take what the command does."""
        self.description = description

    def text(self, console: Console, first: int, main: bool) -> str:
        """The page with the first entries of every group explained, the others named in a line; with ``main``, all of
        groups that are not ``_MAIN`` are only named."""
        with console.capture() as captured:
            self.formatter.render_usage(console, console.options, self.usage)
            self.formatter.render_description(console, console.options, self.description)
            named = False
            for panel in self.panels:
                count = 0 if main and str(panel.title) not in _MAIN else first
                if named and count:
                    console.print()
                self._print(console, panel, count)
                named = not count
        return "\n".join(line.rstrip() for line in captured.get().splitlines())

    def _print(self, console: Console, panel: HelpPanel, first: int) -> None:
        count = len(panel.entries) if panel.format == "command" else first
        shown, others = panel.entries[:count], panel.entries[count:]
        names = Text(", ".join(entry.positive_names[0] for entry in others if entry.positive_names))
        if not shown:
            console.print(Text(f"{panel.title}: ").append(names))
            return
        more = [HelpEntry(positive_names=("also",), description=InlineText(names))] if others else []
        self.formatter(console, console.options, deepcopy(panel.copy(entries=[*shown, *more])))


def print_help(app: App, tokens: Sequence[str]) -> None:
    """The help page of the command that some words call, on a screen unless all of it is asked for."""
    from rich.console import Console

    console, words = Console(), [token for token in tokens if token not in FLAGS]
    if "--help-all" in tokens:
        app.help_print(words, console=console)
        return
    page = Page()
    app.help_formatter = page
    with console.capture() as captured:
        app.help_print(words, console=console)
    app.help_formatter = None
    end = captured.get().strip()
    shortened = any(panel.format != "command" for panel in page.panels)  # commands are always told
    texts = (page.text(console, *level) for level in (_LEVELS if shortened else _LEVELS[:1]))
    for text in texts:
        if text.count("\n") + end.count("\n") + 3 <= _SCREEN:
            break
    print(f"{text.rstrip()}\n\n{end}")
