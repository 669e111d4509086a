"""From a snapshot to its scene: `decode`, and one face for every decoder, a class whose fields are its settings.

CONTRIBUTING shows the smallest one. Packages of others name theirs in the entry-point group ``tmca.decoders``.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from math import prod
from pathlib import Path
from typing import Any, ClassVar
from warnings import warn

import torch
from torch import Tensor

from tmca.arguments import WithSettings, described, path_of
from tmca.cameras import Camera, Snapshot
from tmca.codes.files import differing
from tmca.decoders.certainty import calibrate
from tmca.decoders.estimate import PRIOR, Estimate
from tmca.decoders.own import class_of_file, is_file
from tmca.decoders.registry import check_decodes, decoders_for, make_decoder, register, usual_decoder, usual_for
from tmca.devices import enough_memory, usual_device
from tmca.errors import DataError, SettingError, ShapeError, check_shape
from tmca.plugins import failures_of, file_of, take
from tmca.priors import Prior, find_prior, has_rendered
from tmca.progress import Asked, reporting

_WITHOUT_PRIOR = "admm-tv"
"""The decoder where there is no prior for the usual one."""
Progress = Callable[..., None]
"""Takes the share that is done and, while a prior is learned, what is done next."""


class NoRenderedPrior(UserWarning):
    """A camera for whose scenes no prior comes with the package."""


@dataclass
class Raw:
    """What `Decoder.reconstruct` returns where there is more than the values; shapes as in `Estimate`, or flat.

    ``calibration`` names the entry of `tmca.decoders.certainty` for the deviation: None for the decoder's own, ``""``
    for none.
    """

    values: Tensor
    deviation: Tensor | None = None
    depth: Tensor | None = None
    confidence: Tensor | None = None
    planes: Tensor | None = None
    depth_deviation: Tensor | None = None
    notes: dict[str, Any] = field(default_factory=dict)
    calibration: str | None = None


@dataclass
class Decoder(WithSettings, ABC):
    """From a snapshot to the scene; a subclass's fields are its settings, its docstring's ``Args`` their help.

    ``name`` is what commands call it, ``label`` what tables show, ``cameras`` the kinds that it decodes, ``prior_kind``
    the prior that it needs (``"gaussian"``, ``"mixture"``, ``"dictionary"`` or a kind of another package),
    ``deviation`` whether it always can predict its deviation (then it has a setting ``uncertainty``), ``clips`` whether
    negative values are set to zero, ``moving`` whether it estimates a scene for every slot, and ``needs_taps`` whether
    it asks for ``camera.taps()``: cameras without have not got it.
    """

    name: ClassVar[str]
    label: ClassVar[str]
    cameras: ClassVar[frozenset[str]]
    prior_kind: ClassVar[str | None] = None
    deviation: ClassVar[bool] = False
    clips: ClassVar[bool] = True
    moving: ClassVar[bool] = False
    needs_taps: ClassVar[bool] = False

    def __init_subclass__(cls, **how: Any) -> None:
        super().__init_subclass__(**how)
        if "name" in vars(cls):
            take(cls, register, "decoder")

    @abstractmethod
    def reconstruct(self, prepared: Any, values: Tensor, progress: Progress | None) -> Tensor | Raw:
        """The scenes (B, *scene_shape), or the same entries in another shape; no gradient flows.

        Args:
            prepared: what ``setup`` returned, the camera unless it is overridden.
            values: (B, *snapshot_shape) of the snapshots, checked.
            progress: called with the share that is done.
        """

    def setup(self, camera: Any, prior: Any) -> Any:
        """What depends on camera, noise and prior alone, computed once for all snapshots; the camera itself."""
        return camera

    def precompute(self, prepared: Any, bank: Path | None = None) -> Any:
        """What ``setup`` returned, with what pays only where several snapshots follow; unchanged by default.

        Raises:
            SettingError: a file for a bank, of a decoder that has none.
        """
        if bank is not None:
            raise SettingError("bank", str(bank), f"none: {self.name} has nothing to store", "leave it out")
        return prepared

    def find_prior(self, camera: Camera, given: Any, progress: Progress | None = None) -> Any:
        """The prior of ``setup``: given, a file's, or the rendered scenes'."""
        if self.prior_kind is not None:
            return find_prior(camera, given, self.prior_kind, progress)
        if given is not None:
            raise SettingError("prior", f"one for {self.name}", "none: it uses no prior", "leave it out")
        return None

    @classmethod
    def usual_settings(cls, camera: Any) -> dict[str, Any] | None:
        """Settings under which it is the usual decoder of a camera that it was made for; None of any other."""
        return None

    def scene_shape(self, camera: Any) -> tuple[int, ...]:
        """Of an estimate, without the batch."""
        return tuple(camera.scene_shape)

    def prepare(
        self,
        camera: Any,
        prior: str | Path | Prior | None = None,
        progress: Progress | None = None,
        *,
        bank: str | Path | None = None,
    ) -> Prepared:
        """The decoder made ready for many snapshots of a camera.

        Args:
            camera: with its codes and sensor.
            prior: a prior, its file, or None for that of the rendered scenes.
            progress: called with what is done where a prior has to be learned.
            bank: file that stores what was computed (lmmse): read where it is there, written where it is not.

        Raises:
            SettingError, ShapeError, DataError: a camera that it does not decode, a setting of another type, a prior
                that does not fit, or a bank of something else.
            OutputError: a bank that cannot be written.

        Warns:
            DamagedBank: one that was made anew.

        >>> import torch, tmca.cameras
        >>> camera = tmca.cameras.SpectralCamera(3, (8, 8), slots=2)
        >>> from tmca.decoders import make_decoder
        >>> prepared = make_decoder("dagger", "spectral").prepare(camera)
        >>> [tuple(estimate.values.shape) for estimate in prepared.stream(torch.rand(2, 1, 8, 10))]
        [(1, 3, 8, 8), (1, 3, 8, 8)]
        """
        return self._prepare(camera, prior, progress, many=True, bank=None if bank is None else path_of("bank", bank))

    def _prepare(
        self, camera: Any, prior: Any, progress: Progress | None, *, many: bool, bank: Path | None = None
    ) -> Prepared:
        check_decodes(type(self), camera.kind)
        decoder = self._checked()
        chosen = decoder.find_prior(camera, prior, progress)
        start = time.perf_counter()
        device = next((tensor.device for tensor in camera.buffers()), torch.device("cpu"))
        with torch.no_grad(), decoder._failures(), enough_memory(device):
            state = decoder.setup(camera, chosen)
            if many:
                state = decoder.precompute(state, bank)
        seconds, unchanged = time.perf_counter() - start, _Unchanged.since(camera) if many else None
        return Prepared(decoder, camera, state, seconds, _in_a_line(chosen, prior), unchanged)

    def _failures(self) -> AbstractContextManager[None]:
        """Within it, what a decoder of a file of one's own raises is one line that says where."""
        return failures_of(type(self), "decoder", self.name, "an estimate")

    def __call__(
        self, snapshot: Snapshot[Any], prior: str | Path | Prior | None = None, progress: Progress | None = None
    ) -> Estimate:
        """Decode a snapshot; arguments as in `prepare`. ``seconds`` of the estimate are those of both steps."""
        prepared = self._prepare(snapshot.camera, prior, progress, many=False)
        estimate = prepared(snapshot, progress)
        estimate.seconds += prepared.seconds
        return estimate


@dataclass
class _Unchanged:
    """Whether a camera is still what it was: ``unchanged(camera)``; codes, response, noise and exposure."""

    noise: Any
    versions: tuple[Any, ...]
    tensors: list[Tensor]

    @classmethod
    def since(cls, camera: Any) -> _Unchanged:
        parts = (*camera.buffers(), *camera.parameters())
        return cls(camera.noise, camera.tensor_versions, [part.detach().clone() for part in parts])

    def __call__(self, camera: Any) -> bool:
        versions = camera.tensor_versions
        if (camera.noise, versions[0]) != (self.noise, self.versions[0]):
            return False
        if versions != self.versions:  # a copy of the camera has other tensors of the same values
            parts = (*camera.buffers(), *camera.parameters())
            pairs = zip(self.tensors, parts, strict=True)
            if not all(one.shape == other.shape and torch.equal(one, other.to(one)) for one, other in pairs):
                return False
            self.versions = versions
        return True


@dataclass(frozen=True)
class Prepared:
    """A decoder with what it computed for a camera: ``prepared(snapshot) -> Estimate``, frame after frame."""

    decoder: Decoder
    camera: Any
    state: Any
    seconds: float = 0.0
    prior: str = ""
    unchanged: Callable[[Any], bool] | None = None

    def __call__(self, snapshot: Snapshot[Any] | Tensor, progress: Progress | None = None) -> Estimate:
        """Decode a snapshot of the camera, or values (B, *snapshot_shape).

        Raises:
            ShapeError: values of another shape.
            DataError: values that are not finite.
            SettingError: a snapshot of another camera than the decoder was prepared for, a camera whose codes,
                response, noise or exposure were changed since, or a device without room.
        """
        values, notes = (snapshot, {}) if isinstance(snapshot, Tensor) else (snapshot.values, snapshot.notes)
        if not isinstance(snapshot, Tensor):
            self._check_camera(snapshot.camera)
        self._check_unchanged()
        self._check_values(values)
        start = time.perf_counter()
        with torch.no_grad(), self.decoder._failures(), enough_memory(values.device):
            raw = self.decoder.reconstruct(self.state, values, progress)
            raw = raw if isinstance(raw, Raw) else Raw(raw)
            shape = (len(values), *self.decoder.scene_shape(self.camera))
            scenes = _checked(self.decoder, raw.values, shape).reshape(shape).to(values.dtype)
            deviation = None if raw.deviation is None else raw.deviation.reshape(shape).to(values.dtype)
        if self.decoder.clips:
            scenes = scenes.clamp_min(0)
        more = (deviation, raw.depth, raw.confidence, raw.planes)
        notes = {**notes, **({PRIOR: self.prior} if self.prior else {}), **raw.notes}
        estimate = Estimate(
            scenes, self.camera, self.decoder.name, *more, notes=notes, depth_deviation=raw.depth_deviation
        )
        if getattr(self.decoder, "calibrated", False):
            with torch.no_grad(), enough_memory(values.device):
                calibrate(estimate, raw.calibration)
        return replace(estimate, seconds=time.perf_counter() - start)

    def stream(self, frames: Iterable[Snapshot[Any] | Tensor]) -> Iterator[Estimate]:
        """Decode frames one after the other, as they come: snapshots of the camera, or values (R, H, W') or (1, R, H,
        W'); errors as of a call."""
        for frame in frames:
            yield self(frame[None] if isinstance(frame, Tensor) and frame.ndim == 3 else frame)

    def _check_unchanged(self) -> None:
        """Raises SettingError if the camera is not what it was when this was prepared."""
        if self.unchanged is not None and not self.unchanged(self.camera):
            found = f"a {self.camera.kind} camera whose codes or sensor changed after prepare"
            raise SettingError("camera", found, "the one prepared for", "call prepare again")

    def _check_values(self, values: Tensor) -> None:
        """Raises ShapeError or DataError for values that are no snapshot of the camera, or not finite."""
        check_shape("snapshot", values, ("B", *self.camera.snapshot_shape))
        if not bool(torch.isfinite(values).all()):
            remedy = "mask or replace the bad pixels first"
            raise DataError("snapshot", "NaN or infinite values", "finite values", remedy)

    def _check_camera(self, camera: Any) -> None:
        """Raises SettingError unless a camera has the codes and the optics of the one that is prepared for."""
        if camera is self.camera:
            return
        parts = differing(self.camera.variables(), camera.variables())
        if parts:
            found = f"one of a {camera.kind} camera with other {', '.join(parts)}"
            raise SettingError("snapshot", found, "one of the camera prepared for", "call prepare(snapshot.camera)")


def decode(
    snapshot: Snapshot[Any] | str | Path,
    decoder: str | Path | type[Decoder] | Decoder | None = None,
    *,
    prior: str | Path | Prior | None = None,
    progress: Asked = None,
    device: str | torch.device | None = None,
    bank: str | Path | None = None,
    **settings: Any,
) -> Estimate:
    """Recover the scene of a snapshot of any camera.

    Args:
        snapshot: values and camera, or the file that holds them.
        decoder: a name of `decoders_for` the camera, a class or an instance, ``FILE.py:Class``, which runs the file, or
            ``FILE.pt2`` of `torch.export`, which makes (1, L, H, W) of (1, 1, H, W'); None for the camera's usual one
            (`usual_for`: behind codes that come with tmca their network, without a prior or bank of your own), or one
            without a prior where none is given and the rendered scenes have none for the camera.
        prior: a prior, its file, or None for that of the rendered scenes, learned on first use; the estimate notes it.
        progress: called with the share that is done; True for a bar, False for none; None for one that is shown after
            a second in a terminal or a notebook.
        device: where it is decoded, and where the estimate lies: ``"cuda"``, ``"cpu"``; None where the snapshot
            is, or as `tmca.devices.computing_on` says.
        bank: file that stores what depends on camera, noise and prior alone, for the next snapshot (lmmse); see
            `Decoder.prepare`.
        settings: of the decoder.

    Raises:
        SettingError: an unknown decoder or setting, a camera or prior that does not fit, or a device that is not there.
        DataError: a file that holds no snapshot, or a bank of something else.

    Warns:
        NoRenderedPrior: a camera for which no prior comes with the package: another decoder than the usual one.

    >>> import torch, tmca.cameras
    >>> camera = tmca.cameras.SpectralCamera(3, (8, 8), slots=2)
    >>> decode(Snapshot(camera(torch.rand(1, 3, 8, 8)), camera), "dagger").values.shape
    torch.Size([1, 3, 8, 8])
    """
    if decoder is None and "method" in settings:
        decoder = settings.pop("method")  # its name in version 0.1
    if isinstance(snapshot, str | Path):
        snapshot = Snapshot.load(snapshot)
    if not isinstance(snapshot, Snapshot):
        raise SettingError("snapshot", described(snapshot), "a Snapshot", "take one with tmca.simulate")
    where = usual_device() if device is None else device
    snapshot = snapshot if where is None else snapshot.to(where)
    kind = snapshot.camera.kind
    if decoder is None:
        alone = prior is None and bank is None
        usual, own = usual_for(snapshot.camera, settings) if alone else (usual_decoder(kind), {})
        decoder, settings = usual if prior is not None else possible_decoder(usual, snapshot.camera), own | settings
    if isinstance(decoder, str | Path):
        decoder = class_of_file(str(decoder), Decoder) if is_file(str(decoder)) else str(decoder)
    made = make_decoder(decoder, kind, settings)
    with reporting(progress, made.name) as report:
        if bank is None:
            return made(snapshot, prior, report)
        prepared = made.prepare(snapshot.camera, prior, report, bank=bank)
        estimate = prepared(snapshot, report)
    return replace(estimate, seconds=estimate.seconds + prepared.seconds)


def possible_decoder(usual: str, camera: Any) -> str:
    """Name of the usual decoder of a camera, of one without a prior where the rendered scenes have none for it."""
    available = decoders_for(camera.kind)
    cls = available.get(usual)
    if cls is None or cls.prior_kind is None or _WITHOUT_PRIOR not in available or has_rendered(camera):
        return usual
    text = f"no prior of this {camera.kind} camera's scenes comes with tmca: {_WITHOUT_PRIOR} instead of {usual}"
    warn(f"{text}; learn one with `tmca prior learn`, or tmca.priors.learn_prior", NoRenderedPrior, stacklevel=3)
    return _WITHOUT_PRIOR


def _in_a_line(prior: Any, given: Any) -> str:
    """The prior of an estimate in a few words; none of a decoder without one."""
    if not isinstance(prior, Prior):
        return ""
    source = "the rendered scenes" if given is None else f"{given}" if isinstance(given, str | Path) else "given"
    return f"{prior.in_a_line()} ({source})"


def _checked(decoder: Decoder, values: Any, shape: tuple[int, ...]) -> Tensor:
    """What a decoder returns; refused if it is no tensor, has other entries, or values that are not finite."""
    own = file_of(type(decoder))
    name = decoder.name if own is None else f"{decoder.name} of {own}"
    remedy = "change its settings" if type(decoder).__module__.startswith("tmca.") else "mend it"
    if not isinstance(values, Tensor) or values.numel() != prod(shape):
        found = f"shape {tuple(values.shape)}" if isinstance(values, Tensor) else f"a {type(values).__name__}"
        raise ShapeError("decoder", f"{found} from {name}", f"the entries of {shape}")
    if not bool(values.sum().isfinite()) and bool((bad := ~torch.isfinite(values.reshape(shape))).any()):
        first = tuple(bad.nonzero()[0].tolist())
        found = f"an estimate of {name} with NaN or infinite values: {int(bad.sum())} of {bad.numel()}"
        raise SettingError("decoder", f"{found}, the first at {first}", "finite ones", remedy)
    return values
