"""``tmca decoders``: a table of what there is."""

from __future__ import annotations

import json as jsons
from dataclasses import asdict
from typing import Any

from tmca.errors import check_choice


def table(plugins: bool = True, camera: str | None = None) -> list[dict[str, Any]]:
    """A row for every decoder: name, label, cameras, prior, uncertainty, settings; those of this package alone, and its
    cameras, without ``plugins``; those of one kind of ``camera``.

    Raises:
        SettingError: no such camera.
    """
    from tmca.cameras import CAMERAS, load_cameras
    from tmca.decoders import decoders, settings_of
    from tmca.decoders.registry import decodes

    if plugins:
        load_cameras()
    if camera is not None:
        check_choice("camera", camera, CAMERAS)
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
        if (plugins or cls.__module__.startswith("tmca.")) and camera in (None, *cameras[name])
    ]  # fmt: skip


def markdown(plugins: bool = True, camera: str | None = None) -> str:
    """The table as a page: every decoder, then what its settings mean."""
    rows = table(plugins, camera)
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


def decoders(camera: str | None = None, /, *, json: bool = False) -> None:
    """List every decoder: its name, the cameras it decodes, the prior it needs, and its settings.

    `tmca reconstruct`, `compare` and `sweep` take these names; settings go to `reconstruct --set NAME=VALUE`.

    Args:
        camera: of which decoders are listed: spectral, light-field or spectral-depth; all without it.
        json: print the table as JSON.
    """
    print(
        jsons.dumps(table(camera=camera), indent=1, default=str) if json else markdown(camera=camera),
        end="\n" if json else "",
    )
