"""Faults of a bench on the command line."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Group, Parameter

from tmca.errors import DataError, SettingError

if TYPE_CHECKING:
    from tmca.cameras import Hardware

_HARDWARE = Group("Hardware", sort_key=41)


@Parameter(name="*")
@dataclass(frozen=True)
class HardwareOptions:
    """The bench's own faults."""

    hardware: Annotated[str | None, Parameter(group=_HARDWARE)] = None
    """Faults that the decoder is not told of, NAME=VALUE,… or a YAML file of them: contrast_ratio, leakage, switching,
    dead_time, delay, jitter, rolling, misregistration, magnification, rotation, dispersion_error, shear_error, blur,
    height_error, wavefront_error, hot_pixels, dead_pixels, motion (docs/hardware.md); ROWS:COLUMNS where there are
    two."""

    def faults(self) -> Hardware:
        """What is asked for.

        Raises:
            SettingError, DataError: unknown or impossible ones.
        """
        from tmca.cameras import Hardware

        if self.hardware is None:
            return Hardware()
        return Hardware.of(_stored(Path(self.hardware)) if "=" not in self.hardware else written(self.hardware))


def written(text: str) -> dict[str, Any]:
    """Faults of NAME=VALUE,… with ROWS:COLUMNS where there are two.

    Raises:
        SettingError: a text of another form, or a name twice.
    """
    found: dict[str, Any] = {}
    for part in text.split(","):
        name, sign, value = (word.strip() for word in part.partition("="))
        if not (sign and name and value) or name in found:
            raise SettingError("--hardware", repr(text), "NAME=VALUE,NAME=VALUE, such as contrast_ratio=50,delay=0.1")
        found[name] = value
    return found


def _stored(file: Path) -> dict[str, Any]:
    import yaml

    try:
        found = yaml.safe_load(file.read_text(encoding="utf-8"))
    except OSError:
        raise DataError(file, "no such file", "a YAML file of faults, or NAME=VALUE,…") from None
    except (yaml.YAMLError, UnicodeDecodeError):
        raise DataError(file, "no YAML", "lines NAME: VALUE", "see docs/hardware.md") from None
    if not isinstance(found, dict):
        raise DataError(file, "no names with values", "lines NAME: VALUE", "see docs/hardware.md")
    return found
