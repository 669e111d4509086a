"""Pictures of arrays: cubes, light fields, depth maps, codes, priors, trainings, measurements; they know no camera."""

from tmca.plots.cube import linear_srgb, reconstruction_figure, shown_level, srgb_picture
from tmca.plots.lab import frames_figure
from tmca.plots.style import (
    BLUE,
    COLOURS,
    RED,
    add_bar,
    bare,
    blank_figure,
    grid,
    image,
    panels,
    plain_axes,
    save_figure,
)

__all__ = [
    "BLUE",
    "COLOURS",
    "RED",
    "add_bar",
    "bare",
    "blank_figure",
    "frames_figure",
    "grid",
    "image",
    "linear_srgb",
    "panels",
    "plain_axes",
    "reconstruction_figure",
    "save_figure",
    "shown_level",
    "srgb_picture",
]


def __dir__() -> list[str]:
    return sorted(__all__)
