"""A command that is asked to stop, by Ctrl-C or SIGTERM, ends with one line, wherever it is."""

from __future__ import annotations

import signal
import sys
from types import FrameType
from typing import NoReturn

_MOMENT = 0.02
"""Seconds until a command that was asked to stop in a destructor is asked again."""

_asked: list[int] = []
"""Signals that came, and that the command did not handle itself."""


def listen() -> None:
    """SIGTERM stops a command as Ctrl-C does; either comes again where it came in a destructor, which Python goes on
    from. A SIGINT that is ignored, as of commands in the background, or handled by a host stays so."""
    _asked.clear()
    by_python = signal.getsignal(signal.SIGINT) in (signal.default_int_handler, _ask)
    for number in (signal.SIGTERM, signal.SIGALRM, *((signal.SIGINT,) if by_python else ())):
        signal.signal(number, _ask)
    if sys.unraisablehook is sys.__unraisablehook__:
        sys.unraisablehook = _ask_again


def handled() -> None:
    """The command ends by itself: an error from here on is none of the stop's."""
    _asked.clear()


def stop_behind(error: BaseException) -> KeyboardInterrupt | None:
    """A stop, or one that came within a compiled function or while a class was made, which wrap it in another error or
    put their own in its place."""
    cause: BaseException | None = error
    while cause is not None and not isinstance(cause, KeyboardInterrupt):
        cause = cause.__cause__
    replaced = cause is None and bool(_asked) and not sys.flags.dev_mode
    return KeyboardInterrupt() if replaced else cause


def end(stop: KeyboardInterrupt) -> NoReturn:
    """Say that the command was stopped, and leave with exit code 130."""
    signal.setitimer(signal.ITIMER_REAL, 0)
    if sys.unraisablehook is _ask_again:
        sys.unraisablehook = lambda passed_over: None  # what was half made when the stop came has nothing to say
    print(f"tmca: {str(stop) or 'stopped; finished files are whole'}", file=sys.stderr)
    sys.exit(130)


def _ask(number: int, frame: FrameType | None) -> None:
    _asked.append(number)
    signal.default_int_handler(number, frame)


def _ask_again(passed_over: sys.UnraisableHookArgs) -> None:
    if issubclass(passed_over.exc_type, KeyboardInterrupt):
        signal.setitimer(signal.ITIMER_REAL, _MOMENT)  # not at once: this is still within the destructor
    else:
        sys.__unraisablehook__(passed_over)
