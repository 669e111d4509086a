"""YAML as people write settings: a strict dialect without tags, whose size, depth and numbers are bounded."""

from __future__ import annotations

import re
from math import isnan
from typing import Any

import yaml
from yaml.composer import ComposerError
from yaml.constructor import ConstructorError
from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

DEEPEST, MOST = 32, 20_000
"""Levels, and values, those of aliases counted wherever they stand."""
_LARGEST = 2**63
_MERGE = "tag:yaml.org,2002:merge"
_INT, _FLOAT = "tag:yaml.org,2002:int", "tag:yaml.org,2002:float"
_STRING = "tag:yaml.org,2002:str"
_NUMBERS = {
    _INT: re.compile(r"[-+]?[0-9][0-9_]*\Z"),
    _FLOAT: re.compile(
        r"(?:[-+]?(?:[0-9][0-9_]*\.?[0-9_]*|\.[0-9][0-9_]*)(?:[eE][-+]?[0-9]+)?|[-+]?\.inf|\.nan)\Z", re.I
    ),
}


class SettingsLoader(yaml.SafeLoader):
    """Names are texts, given once; ``1e-3`` is a number, ``010`` is ten, ``1:30`` and dates are texts.

    Raises:
        yaml.MarkedYAMLError: what is refused, with its place.
    """

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._depth, self._values, self._sizes = 0, 0, dict[int, int]()

    def compose_node(self, parent: Node | None, index: Any) -> Node | None:
        """A node without a tag, not too deep, and its share of all values."""
        event: Any = self.peek_event()
        if getattr(event, "tag", None) not in (None, "!"):
            raise ComposerError(
                None, None, f"a tag {event.tag[:40]!r}, where plain values are expected", event.start_mark
            )
        self._depth += 1
        if self._depth > DEEPEST:
            raise ComposerError(None, None, f"more than {DEEPEST} levels", event.start_mark)
        try:
            node = super().compose_node(parent, index)
        finally:
            self._depth -= 1
        self._count(node, event)
        return node

    def _count(self, node: Node | None, event: Any) -> None:
        """Add up what a node holds, with copies for aliases."""
        mark: Any = event.start_mark
        if id(node) not in self._sizes:
            if isinstance(event, yaml.AliasEvent):
                raise ComposerError(None, None, "an alias of what it stands in", mark)
            parts = node.value if isinstance(node, SequenceNode | MappingNode) else ()
            inner = [one for part in parts for one in (part if isinstance(part, tuple) else (part,))]
            self._sizes[id(node)] = 1 + sum(self._sizes[id(one)] for one in inner)
        self._values += 1
        if max(self._sizes[id(node)], self._values) > MOST:
            raise ComposerError(None, None, f"more than {MOST} values", mark)

    def compose_mapping_node(self, anchor: Any) -> MappingNode:
        """Names with values; the names are texts, each there once."""
        node = super().compose_mapping_node(anchor)
        seen = set()
        keys: list[Any] = [key for key, _ in node.value]
        for key in keys:
            if not isinstance(key, ScalarNode):
                raise ComposerError(None, None, "a list or names in the place of a name", key.start_mark)
            if key.value in seen:
                raise ComposerError(None, None, f"the name {key.value[:40]!r} a second time", key.start_mark)
            seen.add(key.value)
            key.tag = _MERGE if key.tag == _MERGE else _STRING
        return node


def _whole(loader: SettingsLoader, node: ScalarNode) -> int:
    text = node.value.replace("_", "")
    if len(text) > 20 or abs(int(text)) >= _LARGEST:
        raise ConstructorError(None, None, f"a number of {len(text)} digits", node.start_mark)
    return int(text)


def _number(loader: SettingsLoader, node: ScalarNode) -> float:
    value = float(node.value.replace("_", "").lower().replace(".inf", "inf").replace(".nan", "nan"))
    if isnan(value) or (abs(value) == float("inf") and "inf" not in node.value.lower()):
        raise ConstructorError(None, None, f"{node.value[:40]}, where finite numbers are expected", node.start_mark)
    return value


SettingsLoader.yaml_implicit_resolvers = {
    first: [(tag, form) for tag, form in forms if tag.rpartition(":")[2] in ("bool", "null", "merge")]
    for first, forms in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
for _tag, _form in _NUMBERS.items():
    SettingsLoader.add_implicit_resolver(_tag, _form, list("-+.0123456789"))
SettingsLoader.add_constructor(_INT, _whole)
SettingsLoader.add_constructor(_FLOAT, _number)
