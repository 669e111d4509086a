"""Pictures of a dictionary."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from tmca.errors import SettingError
from tmca.priors.dictionary import PatchDictionary

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_TITLE, _SMALL = 9, 8


def atom_mosaic(atom: Tensor, views: tuple[int, int]) -> Tensor:
    """(V·h + V - 1, U·w + U - 1) views of an atom (L, h, w) side by side, a line of NaN between them."""
    (v, u), (_, h, w) = views, atom.shape
    framed = torch.nn.functional.pad(atom.reshape(v, u, h, w), (0, 1, 0, 1), value=float("nan"))
    return framed.transpose(1, 2).reshape(v * (h + 1), u * (w + 1))[:-1, :-1]


def dictionary_figure(dictionary: PatchDictionary, atoms: int = 48, columns: int = 8) -> Figure:
    """The most used atoms, the views of each side by side and on its own scale, and how the use falls off.

    Raises:
        SettingError: no atom or no column asked for.
    """
    from matplotlib.figure import Figure

    if atoms < 1 or columns < 1:
        raise SettingError("atoms", f"{atoms} in {columns} columns", "at least 1 of each")
    shown = min(atoms, len(dictionary.atoms))
    rows = -(-shown // columns)
    order = dictionary.scales.argsort(descending=True, stable=True)[:shown].tolist()
    figure = Figure(figsize=(1.35 * columns, 1.4 * rows + 2.4), layout="constrained")
    (v, u), (_, h, w) = dictionary.views, dictionary.block
    figure.suptitle(
        f"{len(dictionary.atoms)} atoms of {v}×{u} views of {h}×{w} pixels; the {shown} most used, "
        "each on its own scale (blue above 0, red below)",
        fontsize=_TITLE,
    )
    grid = figure.add_gridspec(rows + 1, columns, height_ratios=[1] * rows + [1.4])
    for place, number in enumerate(order):
        axis = figure.add_subplot(grid[divmod(place, columns)])
        _draw_atom(axis, dictionary, number)
    _draw_use(figure.add_subplot(grid[rows, :]), dictionary)
    return figure


def _draw_atom(axis: Axes, dictionary: PatchDictionary, number: int) -> None:
    picture = atom_mosaic(dictionary.atoms[number], dictionary.views).numpy()
    limit = float(np.nanmax(np.abs(picture))) or 1.0
    axis.imshow(picture, cmap="RdBu", vmin=-limit, vmax=limit, interpolation="nearest")
    axis.set_title(f"{float(dictionary.scales[number]):.2g}", fontsize=_SMALL, pad=2)
    axis.set_axis_off()


def _draw_use(axis: Axes, dictionary: PatchDictionary) -> None:
    """Mean absolute coefficient of every atom, by rank."""
    scales = dictionary.scales.sort(descending=True).values.numpy()
    axis.semilogy(np.arange(1, len(scales) + 1), np.maximum(scales, 1e-6), color="#00798c")
    axis.set_title("use of the atoms (the number over each picture)", fontsize=_TITLE)
    axis.set_xlabel("atom, by falling use", fontsize=_SMALL)
    axis.set_ylabel("mean absolute coefficient\n(relative irradiance)", fontsize=_SMALL)
    axis.tick_params(labelsize=_SMALL)
