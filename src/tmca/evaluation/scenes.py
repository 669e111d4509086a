"""Scenes that the cells of one process share: each is read once, and again when its files change."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import Any

from tmca.data.scene_names import identity_of

SHARED = 8
"""Scenes that are held at a time; of those that were read before, the one used longest ago goes."""
_scenes: OrderedDict[str, Any] = OrderedDict()


def read_once(read: Callable[..., Any], source: str, /, *more: Any, **how: Any) -> Any:
    """What ``read(source, *more, **how)`` gives, read at its first use; its values are not to be written to."""
    key = repr((read.__module__, read.__qualname__, source, identity_of(source), more, sorted(how.items())))
    if key not in _scenes:
        _scenes[key] = read(source, *more, **how)
    _scenes.move_to_end(key)
    while len(_scenes) > SHARED:
        _scenes.popitem(last=False)
    return _scenes[key].copy(deep=False)
