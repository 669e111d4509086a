"""A page in the browser to look at data: cubes, snapshots, codes, light fields, depth; local, and read-only."""

from tmca.viewer.live import LivePage
from tmca.viewer.viewing import Viewer, missing, view, write_static

__all__ = ["LivePage", "Viewer", "missing", "view", "write_static"]


def __dir__() -> list[str]:
    return sorted(__all__)
