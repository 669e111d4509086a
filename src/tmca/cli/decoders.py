"""``tmca decoders``: a table of what there is."""

from __future__ import annotations

import json as jsons
from dataclasses import asdict
from typing import Any

from tmca.errors import check_choice


def table(plugins: bool = True, which: str | None = None) -> list[dict[str, Any]]:
    """A row for every decoder: name, label, cameras, prior, uncertainty, settings; those of this package alone, and its
    cameras, without ``plugins``; those of one kind of camera, or the one of a name, with ``which``."""
    from tmca.cameras import CAMERAS, load_cameras
    from tmca.decoders import decoders, settings_of
    from tmca.decoders.registry import decodes, predicts_deviation

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
            "uncertainty": predicts_deviation(cls), "moving": cls.moving,
            "settings": [asdict(one) for one in settings_of(cls)],
        }
        for name, cls in sorted(known.items())
        if (plugins or cls.__module__.startswith("tmca.")) and which in (None, name, *cameras[name])
    ]  # fmt: skip


def markdown(rows: list[dict[str, Any]]) -> str:
    """The table as a page: the decoders, then what their settings mean."""
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


def decoders(which: str | None = None, /, *, json: bool = False) -> None:
    """List every decoder: its name, the cameras it decodes, the prior it needs, and its settings.

    `tmca reconstruct`, `compare` and `sweep` take these names; settings go to `reconstruct --set NAME=VALUE`.

    Args:
        which: those of one camera (spectral, light-field, spectral-depth), or one decoder alone: its name, its
            FILE.py:Class, which runs the file, or its FILE.pt2.
        json: print the table as JSON.
    """
    rows = table(which=None if which is None else _known(which))
    print(jsons.dumps(rows, indent=1, default=str) if json else markdown(rows), end="\n" if json else "")


def _known(which: str) -> str:
    """A camera, or a decoder, whose file is loaded if it has one.

    Raises:
        SettingError: neither.
    """
    from tmca.cameras import CAMERAS, load_cameras
    from tmca.decoders import decoders as known
    from tmca.lab.decoder_files import decoder_named

    load_cameras()
    name = which if which in CAMERAS else decoder_named(which, "WHICH")
    check_choice("WHICH", name, [*CAMERAS, *known()])
    return name
