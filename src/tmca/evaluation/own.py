"""A study of one's own scenes, sensor, codes and decoders, described by names and files: what a YAML would say."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any
from warnings import warn

from pydantic import ValidationError

from tmca.applications import application_of
from tmca.cameras import CAMERAS
from tmca.data.fitting import VISIBLE, usual_bands
from tmca.data.headers import view_size_of, wavelengths_of
from tmca.data.in_memory import SceneWarning
from tmca.data.light_field_scenes import Reading
from tmca.data.scene_names import named_scenes, short_names
from tmca.data.scenes import scene_kind
from tmca.decoders import Weights
from tmca.decoders import decoders as registered_decoders
from tmca.decoders.nets.bands import same_bands
from tmca.decoders.nets.shipped import DEFAULT, UNIVERSAL
from tmca.errors import SettingError, check_choice
from tmca.evaluation.camera import Settings, evaluation_of
from tmca.evaluation.own_codes import DESIGNED, codes_of_names
from tmca.evaluation.own_sensors import noises_of, one_bucket_alone
from tmca.evaluation.study import Study, checked_study, usual_settings
from tmca.evaluation.trained import NETWORK, check_weights, learned_from, shown_name
from tmca.lab.decoder_files import names_of
from tmca.sensor import Sensor, SensorWarning
from tmca.specs import first_error

_SEARCH: dict[str, Settings] = {
    "spectral-depth": {"effort": {"starts": 1, "steps": 20, "rate": 0.003}},
    "": {"period": [16, 16], "effort": {"descents": 3, "steps": 20, "flips": 200}, "gains": False, "static": 1},
}
"""A short search, of phase masks and of other codes."""
_WITHOUT_PRIOR = "admm-tv"
"""The decoder of bands for which the rendered scenes give no prior."""
_VIEWS = (270, 480)
"""Most rows and columns of a light field that are measured where no crop is asked for."""


def own_study(
    scenes: str | Path | Sequence[str | Path],
    *,
    camera: str | None = None,
    sensor: Sensor | Mapping[str, Any] | str | Path | None = None,
    codes: str | Sequence[str] = (),
    decoders: Any = (),
    weights: str | Path | None = None,
    crop: tuple[int, int] | None = None,
    bands: int | None = None,
    range: tuple[float, float] | None = None,
    seeds: int = 1,
    reading: Mapping[str, Any] | None = None,
) -> Study:
    """The study of some scenes, with a figure for a paper and a page.

    Priors are those of the rendered scenes, or learn from the others of these where one of them is measured.

    Args:
        scenes: that are measured: files, names of rendered ones, or split files; one or several.
        camera: its kind; what the scenes are for if None.
        sensor: a `Sensor` or its arguments, several by their names, or a YAML file of either; an ideal one if None.
        codes: names of presets, ``designed``, ``default`` (of the camera that comes with the package), files of codes
            or snapshots, weights or runs of `tmca train`, the last four with a name of yours as ``NAME=FILE``. Without
            any those of the network's weights, or some usual ones.
        decoders: by their names, ``FILE.py:Class``, ``FILE.pt2``, or classes of this package; the usual one without.
            The code of files runs: pass what you named, not what was read.
        weights: of the decoder ``network``, which then takes part: a file or run of `tmca train`, ``universal`` or
            ``default``; those that come with the package without.
        crop: (H, W) middle of every scene.
        bands: of a spectral camera, nearest to even spacing over the range; 12, or all of a scene with fewer.
        range: (first, last) wavelength that bands are taken from, metres; 400 to 700 nm where all scenes cover them,
            else what all cover, which is said.
        seeds: how many draws of codes and noise.
        reading: further entries of the camera's reading.

    Raises:
        SettingError: no scenes, scenes of several cameras, codes or a sensor that there are not.
        DataError: a file that cannot be read, or scenes that have no range in common.

    Warns:
        SceneWarning: scenes that weights of the study learned from.
        SensorWarning: codes that need two buckets, of a sensor whose file says one.
    """
    sources, codes = list(named_scenes(map(str, _several(scenes)))), [*map(str, _several(codes))]
    if not sources:
        raise SettingError("scenes", "none", "files or names of rendered scenes")
    kind = camera or _kind_of(sources)
    application_of(kind)
    noises = noises_of(sensor)
    names = short_names(sources)
    more = _checked_reading(kind, reading or {})
    read = {**_reading(kind, sources, crop, bands, range, more), **more}
    used, usual = _used(kind, decoders, codes, read, weights), usual_settings(kind)
    network = _network(kind, used, weights)
    if network and not codes and not Weights.find(network, kind=kind).any_bands:
        codes = [network]
    described: Settings = {
        **usual, "settings": {}, "name": names[sources[0]].replace("/", "-"), "camera": kind,
        "scenes": {"train": _learned_from(kind, sources, used, codes), "test": sources},
        "reading": read, "codes": codes_of_names(kind, codes), "noises": noises, "decoders": used, "seeds": seeds,
        "patches": 0, **_network_settings(usual, network),
        "figure": True, "shown": None, "shown_noise": next(iter(noises)),
    }  # fmt: skip
    described["search"] = {**described.get("search", {}), **_SEARCH.get(kind, _SEARCH[""])}
    if kind == "spectral-depth":
        described["reading"]["preset"] = _seen_alike(described["codes"])
    return _with_doubts(checked_study(described, "study"), sensor)


def _with_doubts(study: Study, sensor: Any) -> Study:
    """The study, whose page says which codes need two buckets of a sensor with one, and which scenes its weights
    learned from; so do warnings."""
    two = [name for name, code in study.codes.items() if code.buckets > 1 and not code.burst]
    doubts, learned = one_bucket_alone(sensor, two), learned_from(study)
    for kind, lines in ((SensorWarning, doubts), (SceneWarning, learned)):
        for text in lines:
            warn(text, kind, stacklevel=3)
    return study.with_(about=[*doubts, *learned]) if doubts or learned else study


def _several(given: Any) -> Sequence[Any]:
    """One or several, as several."""
    return list(given) if isinstance(given, Iterable) and not isinstance(given, str | Path) else [given]


def _text(decoder: Any) -> str:
    """What names a decoder.

    Raises:
        SettingError: a class that other processes would not know.
    """
    if isinstance(decoder, str):
        return decoder
    cls = decoder if isinstance(decoder, type) else type(decoder)
    if (
        decoder is cls
        and cls.__module__.startswith("tmca.")
        and registered_decoders().get(getattr(cls, "name", "")) is cls
    ):
        return str(cls.name)
    file = getattr(sys.modules.get(cls.__module__), "__file__", None) or "FILE.py"
    expected = f'"{file}:{cls.__name__}", as every process loads it anew'
    raise SettingError("decoders", f"the class {cls.__name__}", expected, "keep the file free of what runs the study")


def _kind_of(sources: Sequence[str]) -> str:
    """Of the camera that all scenes are for."""
    kinds = {source: scene_kind(source) for source in sources}
    if len({*kinds.values()}) > 1:
        said = ", ".join(f"{Path(source).name} ({kind})" for source, kind in kinds.items())
        raise SettingError("camera", f"scenes for several: {said}", "one of them", "name it with --camera")
    return next(iter(kinds.values()))


def _learned_from(kind: str, sources: Sequence[str], used: Sequence[str], codes: Sequence[str]) -> list[str]:
    """Rendered scenes to learn from, none of them measured; none where the cached prior of all of them will do.

    Raises:
        SettingError: a prior or a search needs scenes to learn from, and all of them are measured.
    """
    rendered = sorted(evaluation_of(kind).rendered().get("train", ()))
    stems = {source.partition(":")[0] for source in sources}
    if kind != "spectral-depth" and not stems & {*rendered}:
        return []
    left, known = [name for name in rendered if name not in stems], registered_decoders()
    learns = DESIGNED in codes or any(name in known and known[name].prior_kind for name in used)
    if rendered and not left and learns:
        raise SettingError("scenes", "all rendered scenes that priors learn from", "one of them left out")
    return left


def _checked_reading(kind: str, reading: Mapping[str, Any]) -> Settings:
    """Entries of a camera's reading that are given.

    Raises:
        SettingError: one that it has not, or an impossible value.
    """
    model = evaluation_of(kind).Reading
    try:
        given = model.model_validate(dict(reading))
    except ValidationError as error:
        raise first_error(error, tuple(model.model_fields)) from None
    return given.model_dump(mode="json", exclude_unset=True)


def _reading(
    kind: str,
    sources: Sequence[str],
    crop: tuple[int, int] | None,
    bands: int | None,
    span: tuple[float, float] | None,
    more: Mapping[str, Any],
) -> Settings:
    """How scenes of a camera are read."""
    for name, value in (("bands", bands), ("range", span)):
        if value is not None and kind != "spectral":
            raise SettingError(name, str(value), f"none of a {kind} camera", "leave it out")
    if kind == "spectral":
        waves = {source: wavelengths_of(source) for source in sources}
        given = {"bands": bands, "size": crop}
        usual = usual_bands(waves, span or more.get("range"))
        return usual | {name: value for name, value in given.items() if value is not None}
    if kind == "light-field":
        frame = crop or _least_frame(sources, more)
        return {"frame": frame, "rendered": crop or (128, 160), "crop": tuple(min(96, side) for side in frame)}
    if kind == "spectral-depth":
        return {"side": max(256, min(crop)) if crop else 256, **({} if crop is None else {"crop": crop})}
    return {} if crop is None else {"size": crop}


def _used(
    kind: str, decoders: Any, codes: Sequence[str], reading: Mapping[str, Any], weights: str | Path | None
) -> list[str]:
    """Names of decoders; the usual one without any. Weights that are named have their network in the study."""
    used = [*names_of(map(_text, _several(decoders))).values()] or [_default(kind, reading)]
    if weights is not None and NETWORK not in used:
        used.append(NETWORK)
    if kind == "spectral" and _invisible(reading):
        _check_without_rendered(used, codes)
    return used


def _network(kind: str, used: Sequence[str], weights: str | Path | None) -> str | None:
    """Name of the weights of the network; None where it is none of the decoders.

    Raises:
        SettingError: weights that cannot be read, or another camera's.
    """
    if NETWORK not in used:
        return None
    named = (UNIVERSAL if kind == "spectral" else DEFAULT) if weights is None else weights
    check_weights(NETWORK, {"weights": named}, kind, "weights")
    return str(named)


def _network_settings(usual: Settings, network: str | None) -> Settings:
    """Settings and labels of decoders, those of the network among them."""
    settings, labels = dict(usual.get("options", {})), dict(usual.get("labels", {}))
    if network is not None:
        settings[NETWORK], labels[NETWORK] = {"weights": network}, f"network ({shown_name(network)})"
    return {"options": settings, "labels": labels}


def _default(kind: str, reading: Mapping[str, Any]) -> str:
    """The usual decoder; where it would need a prior that the rendered scenes do not give, one without."""
    return _WITHOUT_PRIOR if kind == "spectral" and _invisible(reading) else application_of(kind).default_decoder


def _invisible(reading: Mapping[str, Any]) -> bool:
    """Whether bands lie beyond 400 to 700 nm, where the rendered scenes have none."""
    low, high = reading.get("range") or VISIBLE
    return low < VISIBLE[0] - 1e-12 or high > VISIBLE[1] + 1e-12


def _check_without_rendered(used: Sequence[str], codes: Sequence[str]) -> None:
    """Raises SettingError for what would learn from the rendered scenes, of bands that these do not have."""
    known = registered_decoders()
    learning = [name for name in used if name in known and known[name].prior_kind is not None]
    wanted = "none that learn from the rendered scenes, which have 400 to 700 nm"
    if learning:
        remedy = f"take {_WITHOUT_PRIOR}, another range, or a YAML study with scenes to learn from"
        raise SettingError("decoders", ", ".join(learning), wanted, remedy)
    if DESIGNED in codes:
        remedy = "take another range, or the codes.nc of `tmca design spectral --range`"
        raise SettingError("codes", DESIGNED, wanted, remedy)


def _least_frame(sources: Sequence[str], reading: Mapping[str, Any]) -> tuple[int, int]:
    """Rows and columns that all light fields have."""
    asked = Reading(reading.get("test_scale"), reading.get("pattern"), reading.get("lens"))
    sizes = [view_size_of(source, **asked.of(source)) for source in sources]
    return min(_VIEWS[0], *(rows for rows, _ in sizes)), min(_VIEWS[1], *(columns for _, columns in sizes))


def _seen_alike(codes: Mapping[str, Settings]) -> str:
    """The preset whose bands and depths all codes are for."""
    presets = CAMERAS["spectral-depth"].presets
    named = [one["camera"]["preset"] for one in codes.values() if "preset" in one.get("camera", {})]
    named += [_preset_of(one["weights"]) for one in codes.values() if "weights" in one]
    first = (named or ["quick"])[0]
    for name in named[1:]:
        if presets[name]["bands"] != presets[first]["bands"]:
            raise SettingError("codes", f"{first} beside {name}", "cameras of the same bands", "leave one out")
    check_choice("codes", first, presets)
    return str(first)


def _preset_of(weights: str) -> str:
    """The preset of a spectral-depth camera with the bands of weights."""
    bands = Weights.find(weights, kind="spectral-depth").wavelengths
    presets = CAMERAS["spectral-depth"].presets
    alike = [name for name, preset in presets.items() if same_bands(preset["bands"], bands)]
    if not alike:
        found = f"{weights}, weights of {len(bands)} bands"
        raise SettingError("codes", found, f"bands of a preset: {', '.join(presets)}", "describe the study in YAML")
    return alike[0]
