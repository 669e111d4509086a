"""Which decoders there are, of this package and of plug-ins, each under a name of its own, and one of them made."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import MISSING, replace
from inspect import isabstract
from typing import TYPE_CHECKING, Any
from warnings import warn

from tmca.arguments import checked_settings, setting_names, settings_of
from tmca.cameras import CAMERAS, load_cameras
from tmca.errors import SettingError, check_choice, did_you_mean
from tmca.plugins import BrokenPlugin, load_plugins
from tmca.priors import Prior, prior_kinds

if TYPE_CHECKING:
    from tmca.decoders.decoder import Decoder

DECODERS: dict[str, Any] = {}
"""Every decoder class by its name; `tmca.decoders.decoders` also has those of plug-ins."""
_USUAL = ("lmmse", "likelihood", "admm-tv")


def decoders() -> Mapping[str, type[Decoder]]:
    """All decoders by name, those of plug-ins included.

    Warns:
        BrokenPlugin: one that names a kind of camera or of prior that there is not.
    """
    load_plugins("tmca.decoders", DECODERS.values, "a subclass of Decoder with name, label and cameras")
    kinds = [(name, "cameras", kind) for name, cls in DECODERS.items() for kind in cls.cameras if kind not in CAMERAS]
    if kinds:
        load_cameras()
    known = (None, *Prior.kinds)
    kinds += [(name, "prior_kind", cls.prior_kind) for name, cls in DECODERS.items() if cls.prior_kind not in known]
    for name, part, kind in kinds:
        try:
            check_choice(f"decoder {name}: {part}", kind, CAMERAS if part == "cameras" else prior_kinds())
        except SettingError as error:
            warn(str(error), BrokenPlugin, stacklevel=1)  # from one line, so that it is told once
    return DECODERS


def usual_for(camera: Any, given: Iterable[str] = ()) -> tuple[str, dict[str, Any]]:
    """Name and settings of the decoder that a camera has where none is named: one that was made for it, such as the
    network that comes with its codes; else that of its kind.

    Args:
        camera: of the snapshot.
        given: names of settings that it has to know.
    """
    for name, cls in decoders_for(camera.kind).items():
        own = cls.usual_settings(camera)
        if own is not None and {*given} <= setting_names(cls):
            return name, own
    return usual_decoder(camera.kind), {}


def predicts_deviation(decoder: type[Decoder]) -> bool:
    """Whether a decoder has a standard deviation, for all its settings or for some."""
    return "uncertainty" in setting_names(decoder)


def usual_decoder(kind: str) -> str:
    """Name of the decoder that a kind of camera has where none is asked for."""
    choices = decoders_for(kind)
    return next((name for name in (*_USUAL, *choices) if name in choices), _USUAL[0])


def decoders_for(kind: str, moving: bool | None = False) -> dict[str, type[Decoder]]:
    """Decoders of a kind of camera by name: of still scenes, of ``moving`` ones, or with None of both."""
    return {name: cls for name, cls in decoders().items() if decodes(cls, kind) and moving in (None, cls.moving)}


def decodes(decoder: type[Decoder], kind: str) -> bool:
    """Whether a decoder names a kind of camera, or such a camera the decoder, and the camera has what it needs."""
    named = kind in decoder.cameras or (kind in CAMERAS and decoder.name in CAMERAS[kind].decoders)
    return named and not _lacks_taps(decoder, kind)


def _lacks_taps(decoder: type[Decoder], kind: str) -> bool:
    """Whether a decoder needs the taps of a camera which has none."""
    return decoder.needs_taps and kind in CAMERAS and not hasattr(CAMERAS[kind], "taps")


def check_decodes(decoder: type[Decoder], kind: str) -> None:
    """Raises SettingError, with the decoders that a kind of camera has, unless this is one of them."""
    if decodes(decoder, kind):
        return
    choices = ", ".join(decoders_for(kind, moving=None))
    expected, remedy = f"one of {choices}" if choices else "a decoder that names this camera", ""
    found = f"{decoder.name!r}, which is for {', '.join(sorted(decoder.cameras))} cameras, for a {kind} camera"
    if _lacks_taps(decoder, kind):
        found = f"{decoder.name!r}, which needs camera.taps(), for a {kind} camera, which has none"
        remedy = (
            "dagger and the admm-tv and pnp decoders of cubes need camera.operator() alone: name them in its decoders"
        )
    raise SettingError("decoder", found, expected, remedy)


def make_decoder(
    decoder: str | type[Decoder] | Decoder, kind: str, settings: Mapping[str, Any] | None = None
) -> Decoder:
    """A decoder of snapshots of a kind of camera, with some settings; unknown ones are named in a SettingError."""
    if isinstance(decoder, str):
        choices = decoders_for(kind, moving=None)
        if decoder not in choices and decoder in decoders():
            check_decodes(decoders()[decoder], kind)
        if decoder not in choices:
            raise unknown_decoder("decoder", decoder, choices)
        decoder = choices[decoder]
    cls = decoder if isinstance(decoder, type) else type(decoder)
    if not (hasattr(cls, "prepare") and hasattr(cls, "reconstruct")) or isabstract(cls):
        raise SettingError("decoder", repr(decoder), "a name, a subclass of Decoder, or one of its objects")
    checked = checked_settings(cls, settings) if settings else {}
    complete(cls)
    check_parts(cls)
    if not isinstance(decoder, type):
        return replace(decoder, **checked)
    for setting in settings_of(cls):
        if setting.default is MISSING and setting.name not in checked:
            raise SettingError(setting.name, "nothing", f"a {setting.type}: {cls.name} has no default of it")
    return decoder(**checked)


def unknown_decoder(where: str, name: str, known: Iterable[str]) -> SettingError:
    """The error for a name that no decoder has; a file lacks the name of its class."""
    choices = list(known)
    remedy = f"name its class too, {name}:Class" if name.endswith(".py") else did_you_mean(name, choices)
    return SettingError(where, repr(name), f"one of {', '.join(choices)}, or FILE.py:Class", remedy)


def register(decoder: Any) -> None:
    """Take a decoder class into the registry.

    Raises:
        SettingError: a part of it is missing, or another module has a decoder of that name.
    """
    check_parts(decoder)
    before = DECODERS.get(decoder.name)
    if before is not None and before.__module__ != decoder.__module__:
        found = f"{decoder.name!r}, which {before.__module__} has"
        raise SettingError(f"{_place(decoder)}.name", found, "a name of its own")
    decoder.cameras = frozenset(decoder.cameras)
    DECODERS[decoder.name] = decoder


def complete(decoder: Any) -> None:
    """Give a class what it does not say: its own name as name and label, and all cameras."""
    if not hasattr(decoder, "name"):
        decoder.name = decoder.__name__
    if not hasattr(decoder, "label"):
        decoder.label = decoder.name
    if not hasattr(decoder, "cameras"):
        decoder.cameras = all_cameras()


def all_cameras() -> frozenset[str]:
    """All kinds of cameras, those of plug-ins included."""
    load_cameras()
    return frozenset(CAMERAS)


def check_parts(decoder: Any) -> None:
    """Raises SettingError unless a class has a name, a label, kinds of cameras and a way to reconstruct."""
    where = _place(decoder)
    for part in ("name", "label"):
        value = getattr(decoder, part, None)
        if not (isinstance(value, str) and value):
            raise SettingError(f"{where}.{part}", repr(value), "a short text", "give the class one")
    cameras = getattr(decoder, "cameras", None)
    if not isinstance(cameras, Iterable) or isinstance(cameras, str) or not all(isinstance(k, str) for k in cameras):
        raise SettingError(f"{where}.cameras", repr(cameras), "a set of kinds of cameras", 'such as {"spectral"}')
    if getattr(decoder.reconstruct, "__isabstractmethod__", False):
        raise SettingError(f"{where}.reconstruct", "no such method", "one", "define it in the class")


def _place(decoder: Any) -> str:
    """Where a class is."""
    return f"{decoder.__module__}.{decoder.__qualname__}"
