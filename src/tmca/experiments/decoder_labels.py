"""Decoders as tables show them: every one of the registry, and networks that are trained for each row."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from tmca.decoders import decoders_for


class DecoderLabels(Mapping[str, str]):
    """Name → label of the decoders of a kind of camera, those of plug-ins included.

    Args:
        kind: of the camera.
        shown: labels that differ from the decoder's own, and those of networks that are trained row by row; they come
            first.
    """

    def __init__(self, kind: str, shown: Mapping[str, str]) -> None:
        self.kind, self.shown = kind, dict(shown)

    def _labels(self) -> dict[str, str]:
        known = {name: cls.label for name, cls in decoders_for(self.kind).items() if name != "network"}
        return {**self.shown, **{name: label for name, label in known.items() if name not in self.shown}}

    def __getitem__(self, name: str) -> str:
        return self._labels()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._labels())

    def __len__(self) -> int:
        return len(self._labels())


def prior_kind(decoder: str) -> str | None:
    """Kind of the prior that a decoder needs."""
    from tmca.decoders import decoders

    return decoders()[decoder].prior_kind
