"""``tmca decoders``: a table of what there is."""

from __future__ import annotations

import json as jsons
from dataclasses import asdict
from typing import Any


def table(plugins: bool = True) -> list[dict[str, Any]]:
    """A row for every decoder: name, label, cameras, prior, uncertainty, settings; those of this package alone, and its
    cameras, without ``plugins``."""
    from tmca.cameras import CAMERAS, load_cameras
    from tmca.decoders import decoders, settings_of
    from tmca.decoders.registry import decodes

    if plugins:
        load_cameras()
    known = decoders()
    cameras = {
        name: {*cls.cameras, *(kind for kind in CAMERAS if plugins and decodes(cls, kind))}
        for name, cls in known.items()
    }
    return [
        {
            "name": name, "label": cls.label, "cameras": sorted(cameras[name]), "prior": cls.prior_kind,
            "uncertainty": cls.deviation, "moving": cls.moving,
            "settings": [asdict(one) for one in settings_of(cls)],
        }
        for name, cls in sorted(known.items())
        if plugins or cls.__module__.startswith("tmca.")
    ]  # fmt: skip


def markdown(plugins: bool = True, name: str | None = None) -> str:
    """The table as a page: every decoder, or the one of a name, then what its settings mean."""
    rows = [row for row in table(plugins) if name in (None, row["name"])]
    lines = ["| decoder | as tables show it | cameras | prior | uncertainty | settings |", "|---|---|---|---|---|---|"]
    for row in rows:
        names = ", ".join(f"`{setting['name']}`" for setting in row["settings"])
        cells = [f"`{row['name']}`", row["label"], ", ".join(row["cameras"]), row["prior"] or "–"]
        lines.append(f"| {' | '.join([*cells, 'yes' if row['uncertainty'] else 'no', names or '–'])} |")
    for row in rows:
        if row["settings"]:
            lines += ["", f"**`{row['name']}`**", ""]
            lines += [f"- `{one['name']}` ({one['type']}, {one['default']}): {one['help']}" for one in row["settings"]]
    return "\n".join(lines) + "\n"


def decoders(decoder: str | None = None, /, *, json: bool = False) -> None:
    """List every decoder: its name, the cameras it decodes, the prior it needs, and its settings.

    `tmca reconstruct`, `compare` and `sweep` take these names; settings go to `reconstruct --set NAME=VALUE`.

    Args:
        decoder: one alone: its name, its FILE.py:Class, which runs the file, or its FILE.pt2.
        json: print the table as JSON.
    """
    name = None
    if decoder is not None:
        from tmca.decoders import decoders as known
        from tmca.errors import check_choice
        from tmca.lab.decoder_files import decoder_named

        name = decoder_named(decoder, "DECODER")
        check_choice("DECODER", name, known())
    if json:
        print(jsons.dumps([row for row in table() if name in (None, row["name"])], indent=1, default=str))
    else:
        print(markdown(name=name), end="")
