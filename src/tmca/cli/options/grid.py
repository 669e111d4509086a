"""Options of a grid of cells: how many side by side, and where."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Annotated, Any

from cyclopts import Group, Parameter

from tmca.cli.options.numbers import Whole, size, whole
from tmca.errors import SettingError

_GRID = Group("Computation", sort_key=4)


@Parameter(name="*")
@dataclass(frozen=True)
class GridOptions:
    """How a grid of cells is computed."""

    jobs: Annotated[int, Parameter(group=_GRID, converter=whole)] = 1
    "Processes side by side."
    slurm: Annotated[str | None, Parameter(group=_GRID)] = None
    "Parameters of submitit, NAME=VALUE,…, to send the cells to Slurm: timeout_min=60,slurm_partition=gpu."
    device: Annotated[str | None, Parameter(group=_GRID)] = None
    "Where snapshots are decoded and codes searched: cpu, cuda or cuda:1. Finished cells stay as they are."
    overwrite: Annotated[bool, Parameter(group=_GRID, negative="")] = False
    "Replace results of something else; without it, the same command resumes and computes only what is missing."
    json: Annotated[bool, Parameter(group=_GRID, negative="")] = False
    "Print the results as JSON."
    markdown: Annotated[bool, Parameter(group=_GRID, negative="")] = False
    "Print tables as Markdown in a terminal too, as they are printed into files and pipes."

    def how(self) -> dict[str, Any]:
        """Arguments of a comparison or a sweep."""
        cluster, command = cluster_parameters(self.slurm), ["tmca", *sys.argv[1:]]
        if self.device is not None and cluster is None:  # nodes of a cluster have other devices than this machine
            from tmca.devices import device_of

            device_of(self.device)
        same = {"jobs": self.jobs, "device": self.device, "overwrite": self.overwrite}
        return {**same, "cluster": cluster, "command": command}


@Parameter(name="*")
@dataclass(frozen=True)
class DepthScenes:
    """How scenes with depth are read for a grid of cells."""

    preset: str = "quick"
    "Of the camera: quick, quick-diffractive, thesis or diffractive."
    crop: str = "96x128"
    "HEIGHTxWIDTH, the middle of every scene that is measured."
    side: Whole = 256
    "Scenes from files are averaged down while their shorter side keeps at least this many pixels."
    from_rgb: bool = False
    "Make up spectra of measured reflectances for RGB-D scenes."
    placed: str | None = None
    "Put cubes without depth at drawn depths: plane, slanted, staged, smooth, pieces or random."

    def reading(self) -> dict[str, Any]:
        """The reading of a comparison or a sweep."""
        return {**vars(self), "crop": size(self.crop, "--crop")}


def cluster_parameters(text: str | None) -> dict[str, Any] | None:
    """``NAME=VALUE,…`` for submitit; None without."""
    if text is None:
        return None
    from tmca.yaml_files import parsed_yaml

    parts = [part.partition("=") for part in text.split(",") if part]
    if not parts or not all(sign for _, sign, _ in parts):
        raise SettingError("--slurm", repr(text), "NAME=VALUE,…, such as timeout_min=60,slurm_partition=gpu")
    return {name: parsed_yaml(value) for name, _, value in parts}
