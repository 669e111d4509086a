"""Errors in the words of the command line: options instead of Python arguments."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import fields

from tmca.errors import TmcaError

_ALIASES = {
    "count": "--bands",
    "displacement": "--dispersion",
    "weight": "--tv-weight",
    "codes": "--aperture",
    "relay blur": "--relay-blur",
}
_EXTRA = (
    "crop",
    "frame",
    "variable",
    "wavelengths",
    "negative",
    "bands",
    "illuminant",
    "decoder",
    "prior",
    "dictionary",
    "tv_weight",
    "window",
    "seed",
    "motion",
    "size",
    "light",
    "throughput",
)


def options() -> dict[str, str]:
    """Python's name of an argument → the option that sets it."""
    from tmca.cli.options.bench import BenchOptions
    from tmca.cli.options.cameras import LightFieldOptions, SpectralOptions
    from tmca.cli.options.light_field import LightFieldSceneOptions, MeasuredLightFieldsOptions
    from tmca.cli.options.light_field_bench import LightFieldBenchOptions
    from tmca.cli.options.scenes import TruthOptions
    from tmca.cli.options.sensor import SensorOptions
    from tmca.cli.options.sheets import SheetOptions
    from tmca.cli.spectral_depth import DepthSceneOptions, SpectralDepthOptions

    kinds: tuple[type, ...] = (TruthOptions, LightFieldSceneOptions, DepthSceneOptions, SensorOptions, SheetOptions)
    kinds += (MeasuredLightFieldsOptions, SpectralOptions, LightFieldOptions, SpectralDepthOptions, BenchOptions)
    kinds += (LightFieldBenchOptions,)
    names = [field.name for kind in kinds for field in fields(kind)]
    return {name: f"--{name.replace('_', '-')}" for name in (*names, *_EXTRA)} | _ALIASES


def _only_a_fault(given: Sequence[str]) -> bool:
    """Whether a motion was asked for as one of the bench's faults."""
    return bool(given) and not any(word.startswith("--motion") for word in given)


def in_options(error: TmcaError, given: Sequence[str] = ()) -> str:
    """The error's line with ``name=value`` and bare names of arguments put as options.

    ``given`` are the words of the command line: a number of views that is not among them was not asked for.
    """
    known = options()
    text = str(error)
    if error.where in known and not (error.where == "motion" and _only_a_fault(given)):
        text = known[error.where] + text[len(error.where) :]
    if error.where == "views" and not any(word.startswith("--views") for word in given):
        text = re.sub(r"found (\d+)", r"found \1, the default,", text, count=1)

    def option(match: re.Match[str]) -> str:
        name, value = match[1], match[2] or match[3]
        if name not in known:
            return match[0]
        return known[name] + (f" {value}" if value else "")

    text = re.sub(r"(?<![\w.])([a-z_]+)=(?:\"([^\"]*)\"|(\d+)|True)?(?= |, |,$|;|\.|$)", option, text)
    return re.sub(r"(--[a-z-]+) \(\1( in nm)?\)", r"\1\2", text)
