"""Reconstructions of snapshot files, each checked before any work is done, and what comes of them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tmca.cli.decoder_settings import check_dictionary, given_settings, settings_of_texts
from tmca.cli.options.output import OutputOptions, check_targets, meaning, warned
from tmca.errors import SettingError, TmcaError
from tmca.progress import progress_bar
from tmca.specs import TruthReading

if TYPE_CHECKING:
    from tmca.decoders import Decoder, Estimate
    from tmca.registration import Registered


@dataclass(frozen=True)
class Request:
    """What is requested of all reconstructions."""

    how: dict[str, Any]
    texts: list[str]
    truth: str | None
    prior: Path | None
    calibration: Path | None
    dictionary: Path | None
    device: str | None
    bank: Path | None
    register: str | None
    reading: TruthReading
    output: OutputOptions
    registered: dict[Path, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Reconstructed:
    """An estimate as it is labelled, its truth, and what is reported of it."""

    estimate: Any
    scene: Any
    report: dict[str, Any]
    remarks: list[str]

    def lines(self) -> list[str]:
        """For people."""
        report = self.report
        wide = max(map(len, report["metrics"]), default=0)
        figures = (
            f"  {name:{wide}s} {value:.4g} {meaning(name)}".rstrip() for name, value in report["metrics"].items()
        )
        head = f"{report['estimate']}: {report['decoder']}, {self.estimate.attrs['seconds']:.1f} s"
        return [head, *figures, *(f"  {line}" for line in self.remarks)]


@dataclass(frozen=True)
class Reconstruction:
    """A snapshot and a decoder of it, checked before any work is done.

    Args:
        file: the snapshot's.
        taken: what is in it.
        decoder: name.
        cls: class of the decoder; None of an unknown one.
        settings: of the decoder.
        request: of all reconstructions.
        several: whether there are several decoders.
        own: whether the decoder was taken because it comes with the codes.
        placed: where the mask of ``taken`` lies, after `register`.
    """

    file: Path
    taken: Any
    decoder: str
    cls: type[Decoder] | None
    settings: dict[str, Any]
    request: Request
    several: bool
    own: bool = False
    placed: Registered | None = None

    @classmethod
    def of(cls, file: Path, name: str | None, request: Request, several: bool) -> Reconstruction:
        """One whose decoder may be the usual one of the snapshot's camera; where there are several decoders, each
        takes of the settings those that it has."""
        from tmca.arguments import setting_names
        from tmca.decoders import decoders_for
        from tmca.lab.calibration.apply import load_snapshot

        taken = load_snapshot(file, request.calibration)
        kind = taken.camera.kind
        decoder, made = (name, dict[str, Any]()) if name else _usual(taken.camera, request)
        available = decoders_for(kind, moving=None)
        chosen = available.get(decoder)
        if request.dictionary is not None:
            check_dictionary(request.dictionary, decoder, kind, available)
        how, texts = given_settings(chosen, request.how) | made, request.texts
        if several and chosen is not None:
            how = {name: value for name, value in how.items() if name in setting_names(chosen)}
            texts = [text for text in texts if text.partition("=")[0].strip() in setting_names(chosen)]
        settings = how | settings_of_texts(chosen, texts)
        return cls(file, taken, decoder, chosen, settings, request, several, own=bool(made))

    @property
    def target(self) -> Path:
        """File of the estimate where none is asked for."""
        return Path(f"{self.file.stem.removesuffix('_snapshot')}_{self.decoder}.nc")

    def files(self, target: Path) -> list[Path]:
        """All that is written."""
        from tmca.applications.pictures import estimate_files

        moving = self.cls is not None and self.cls.moving
        return estimate_files(target, self.taken.camera.kind, self.request.output.figures, moving)

    def run(self, target: Path) -> Reconstructed:
        """Decode, measure, write."""
        from tmca.applications import application_of
        from tmca.applications.evaluating import metric_notes
        from tmca.data.in_memory import warn_of_estimate
        from tmca.metrics import beside_constant

        check_targets(self.files(target), self.request.output.overwrite, self.file)
        if self.request.register and self.placed is None:
            return self._in_register().run(target)
        scene, estimate = self._scene(), self._estimate()
        metrics = {} if scene is None else _metrics(estimate, scene)
        if scene is None:
            warn_of_estimate(estimate.values.numpy(force=True), "estimate", stacklevel=5)
        estimate.notes |= metric_notes(metrics) | ({"registration": str(self.placed)} if self.placed else {})
        report = {"estimate": str(target), "decoder": estimate.decoder, "seconds": round(estimate.seconds, 2),
                  "metrics": metrics, "files": self._written(estimate, scene, target)}  # fmt: skip
        shown = estimate.to_xarray()
        remarks = [*self._own(), *self._left(estimate, report), *application_of(self.taken.camera).remarks(shown)]
        if self.placed is not None:
            report["registered"] = self.placed.described()
            remarks = [*self.placed.lines(), *remarks] if self.placed.converged else remarks
        return Reconstructed(shown, scene, report, [*remarks, *beside_constant(metrics)])

    def _estimate(self) -> Estimate:
        """What the decoder makes of the snapshot; priors go to those of several decoders that have one."""
        from tmca.decoders import decode

        request = self.request
        prior = request.dictionary or request.prior
        if self.several and self.cls is not None and self.cls.prior_kind is None and self.decoder != "network":
            prior = None
        with progress_bar(f"{self.decoder}: {self.file.name}") as progress:
            how: dict[str, Any] = {"prior": prior, "progress": progress, "device": request.device, "bank": request.bank}
            return decode(self.taken, self.decoder, **how, **self.settings)

    def _written(self, estimate: Estimate, scene: Any, target: Path) -> list[str]:
        """The files of an estimate and its pictures, written."""
        from tmca.applications.pictures import estimate_pictures

        overwrite = self.request.output.overwrite
        written = [estimate.save(target, overwrite=overwrite)]
        if self.request.output.figures:
            written += estimate_pictures(estimate, target, truth=scene, snapshot=self.taken, overwrite=overwrite)
        return [str(file) for file in written]

    def _in_register(self) -> Reconstruction:
        """With the mask where the snapshot says that it lies, the same for all decoders; as it is, with a warning,
        where no place stands out."""
        from tmca.registration import register

        known = self.request.registered
        if self.file not in known:
            with progress_bar(f"register: {self.file.name}") as progress:
                known[self.file] = register(self.taken, self._gaussian_prior(), progress=progress)
        return replace(self, taken=known[self.file].snapshot, placed=known[self.file])

    def _gaussian_prior(self) -> Path | None:
        """The prior that was given, if it is a Gaussian one."""
        from tmca.priors import find_prior

        prior = self.request.prior
        try:
            find_prior(self.taken.camera, prior, "gaussian")
        except SettingError:
            return None
        return prior

    def _own(self) -> list[str]:
        """That the decoder was chosen by the codes, where it was."""
        said = f"{self.decoder}: it comes with tmca for these codes; --decoder lmmse decodes without it"
        return [said] if self.own else []

    def _left(self, estimate: Estimate, report: dict[str, Any]) -> list[str]:
        """What the estimate leaves of the snapshot, in words and in the report; nothing where it cannot be imaged."""
        from tmca.decoders import misfit_of

        try:
            unexplained = misfit_of(estimate, self.taken.values)
        except TmcaError:
            return []
        if unexplained.doubtful:
            warned(f"{self.file.name}: {unexplained.in_words()}: {unexplained.causes}")
        report |= {"left_of_snapshot": unexplained.left, "noise_of_snapshot": unexplained.noise}
        return [unexplained.in_words()]

    def _scene(self) -> Any:
        """The truth, brought to the camera; None where none is given."""
        from tmca.applications import application_of
        from tmca.data.scene_names import compare_scene

        truth, taken = self.request.truth, self.taken
        application = application_of(taken.camera)
        how = self.request.reading.of(application.kind)
        if truth is None:
            return None
        scene = application.truth(truth, taken.camera, taken.notes, len(taken.values) > 1, **how)
        compare_scene(taken.notes, truth)
        return scene


def _metrics(estimate: Any, scene: Any) -> dict[str, float]:
    """Of the scene, and of the geometry that it shows."""
    from tmca.applications.evaluating import evaluation_of

    one = evaluation_of(estimate, scene)
    return one.metrics | one.application.geometry(one.estimate, one.truth)


def _usual(camera: Any, request: Request) -> tuple[str, dict[str, Any]]:
    """Decoder where none is named, and its settings: one made for the camera, if it knows what is requested."""
    from tmca.applications import application_of
    from tmca.decoders import usual_for
    from tmca.decoders.decoder import possible_decoder

    if request.how["weights"]:
        return "network", {}
    if request.dictionary:
        return "dictionary", {}
    given = [option for option, value in request.how.items() if value not in (None, False)]
    given += [text.partition("=")[0].strip() for text in request.texts]
    alone = not (request.prior or request.bank or request.register)
    name, settings = usual_for(camera, given) if alone else ("", dict[str, Any]())
    if settings:
        return name, settings
    default = application_of(camera.kind).default_decoder
    return possible_decoder(default, camera) if alone else default, {}
