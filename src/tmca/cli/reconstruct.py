"""``tmca reconstruct``: snapshot files go in, scenes come out, of several snapshots or decoders side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import App, Parameter

from tmca.cli.cameras import READING
from tmca.cli.decoder_settings import check_dictionary, given_settings, settings_of_texts
from tmca.cli.options.numbers import MaybeOn, MaybeWhole
from tmca.cli.options.output import OutputOptions, check_targets, meaning, say, warned
from tmca.errors import OutputError, SettingError, TmcaError, check_choice
from tmca.progress import progress_bar
from tmca.specs import CAMERA_SPECS, TruthReading

if TYPE_CHECKING:
    from tmca.decoders import Decoder, Estimate
    from tmca.registration import Registered

app = App(name="reconstruct", help="Recover the scene from a snapshot file, which says itself which camera took it.")
_OUTPUT, _READING = OutputOptions(), TruthReading()


@app.default
def reconstruct(
    snapshot: Path,
    /,
    *others: Path,
    decoder: Annotated[str | None, Parameter(alias="-d")] = None,
    truth: str | None = None,
    weights: str | None = None,
    prior: Path | None = None,
    set_: Annotated[list[str] | None, Parameter(name="--set")] = None,
    calibration: Path | None = None,
    dictionary: Path | None = None,
    tv_weight: float | None = None,
    uncertainty: MaybeOn = None,
    window: MaybeWhole = None,
    device: str | None = None,
    bank: Path | None = None,
    register: str | None = None,
    reading: Annotated[TruthReading, READING] = _READING,
    output: OutputOptions = _OUTPUT,
) -> None:
    """Recover the scene from SNAPSHOT, a file written by `tmca simulate`.

    With several snapshots, or several decoders separated by commas, every estimate is written to a file of its own, and
    comparison.png shows them side by side.

    Args:
        snapshot: snapshot file; it carries codes, optics, exposure and noise, and says which camera took it.
        others: more of them.
        decoder: one that `tmca decoders` lists for the camera: lmmse (default; behind codes that come with tmca the
            network that comes with them), admm-tv, pnp-subspace, tikhonov, dagger, network, …;
            space-time-mixture for scenes that move; of a spectral snapshot also lmmse-adapted (its prior refitted to
            the snapshot itself); of a light-field snapshot also dictionary, dictionary-omp. Of a spectral-depth
            snapshot likelihood: depth and spectrum by the likelihood of every plane under a patch prior; or network.
            Your own is FILE.py:Class, or FILE.pt2 of `tmca decoder export`. Several are separated by commas.
        truth: the scene, for errors and metrics: a file or the name of a rendered scene; a light field is read as it
            was for the snapshot.
        weights: of a network: a file or run of `tmca train`; or one that comes with tmca: universal (spectral, any
            bands from 400 to 700 nm, any codes, one bucket or two) or default (with the codes of --weights default);
            the decoder is then network.
        prior: file made by `tmca prior learn` or `learn-views`; the rendered scenes' prior without it (learned once,
            then cached).
        set_: NAME=VALUE, any setting of the decoder; `tmca decoders` lists them. May be given several times.
        calibration: of the camera, by `tmca calibrate`: a file, or its name without the date for the newest. Snapshots
            in digital numbers need one.
        dictionary: file made by `tmca prior learn-views --dictionary`; the decoder is then dictionary.
        tv_weight: weight of the total variation; chosen from the noise level without it.
        uncertainty: also estimate every pixel's standard deviation (lmmse, lmmse-adapted, mixture: they do without it);
            the universal network always does, networks that come with codes have none of light.
        window: side of the windows of likelihood, pixels; 12 without it, or the tile of the codes if that is larger.
        device: where it is decoded: cpu, cuda or cuda:1.
        bank: file that stores what lmmse computes for camera, noise and prior, some hundred MB: written where there is
            none, read by the next command.
        register: auto finds where the mask lies from the snapshot alone (shift up to 2.4 pixels, rotation, scale,
            shear, dispersion), and decodes by the camera so placed.
    """
    from tmca.lab.decoder_files import decoders_named

    names: list[str | None] = [*decoders_named(decoder, "decoder")] if decoder else [None]
    how = {"tv_weight": tv_weight, "weights": weights, "uncertainty": uncertainty, "window": window}
    if register is not None:
        check_choice("--register", register, ("auto",))
    asked = _Asked(how, set_ or [], truth, prior, calibration, dictionary, device, bank, register, reading, output)
    several = len(names) > 1
    jobs = [_Job.of(file, name, asked, several) for file in (snapshot, *others) for name in names]
    if several:
        _check_taken(jobs, asked)
    if len(jobs) == 1:
        done = jobs[0].run(output.out or jobs[0].target)
        say(done.report, output.json, *done.lines())
        return
    _run_all(jobs, asked)


@dataclass(frozen=True)
class _Asked:
    """What is asked of all reconstructions."""

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
class _Done:
    """An estimate as it is labelled, its truth, and what is told of it."""

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
class _Job:
    """A snapshot and a decoder of it, checked before any work is done.

    Args:
        file: the snapshot's.
        taken: what is in it.
        decoder: name.
        cls: class of the decoder; None of an unknown one.
        settings: of the decoder.
        asked: of all.
        several: whether there are several decoders.
        own: whether the decoder was taken because it comes with the codes.
        placed: where the mask of ``taken`` lies, after `register`.
    """

    file: Path
    taken: Any
    decoder: str
    cls: type[Decoder] | None
    settings: dict[str, Any]
    asked: _Asked
    several: bool
    own: bool = False
    placed: Registered | None = None

    @classmethod
    def of(cls, file: Path, name: str | None, asked: _Asked, several: bool) -> _Job:
        """One whose decoder may be the usual one of the snapshot's camera; where there are several decoders, each
        takes of the settings those that it has."""
        from tmca.arguments import setting_names
        from tmca.decoders import decoders_for
        from tmca.lab.calibration.apply import load_snapshot

        taken = load_snapshot(file, asked.calibration)
        kind, (usual, made) = taken.camera.kind, _usual(taken.camera, asked)
        decoder, made = (name, {}) if name else (usual, made)
        available = decoders_for(kind, moving=None)
        chosen = available.get(decoder)
        if asked.dictionary is not None:
            check_dictionary(asked.dictionary, decoder, kind, available)
        how, texts = given_settings(chosen, asked.how) | made, asked.texts
        if several and chosen is not None:
            how = {name: value for name, value in how.items() if name in setting_names(chosen)}
            texts = [text for text in texts if text.partition("=")[0].strip() in setting_names(chosen)]
        settings = how | settings_of_texts(chosen, texts)
        return cls(file, taken, decoder, chosen, settings, asked, several, own=bool(made))

    @property
    def target(self) -> Path:
        """File of the estimate where none is asked for."""
        return Path(f"{self.file.stem.removesuffix('_snapshot')}_{self.decoder}.nc")

    def files(self, target: Path) -> list[Path]:
        """All that is written."""
        from tmca.applications.pictures import estimate_files

        moving = self.cls is not None and self.cls.moving
        return estimate_files(target, self.taken.camera.kind, self.asked.output.figures, moving)

    def run(self, target: Path) -> _Done:
        """Decode, measure, write."""
        from tmca.applications import application_of
        from tmca.applications.evaluating import metric_notes
        from tmca.applications.pictures import estimate_pictures
        from tmca.data.in_memory import warn_of_estimate
        from tmca.decoders import decode
        from tmca.metrics import beside_constant

        asked, output = self.asked, self.asked.output
        check_targets(self.files(target), output.overwrite, self.file)
        if asked.register and self.placed is None:
            return self._in_register().run(target)
        scene, prior = self._scene(), asked.dictionary or asked.prior
        if self.several and self.cls is not None and self.cls.prior_kind is None and self.decoder != "network":
            prior = None
        with progress_bar(f"{self.decoder}: {self.file.name}") as progress:
            how: dict[str, Any] = {"prior": prior, "progress": progress, "device": asked.device, "bank": asked.bank}
            estimate = decode(self.taken, self.decoder, **how, **self.settings)
        metrics = {} if scene is None else _metrics(estimate, scene)
        if scene is None:
            warn_of_estimate(estimate.values.numpy(force=True), "estimate", stacklevel=5)
        estimate.notes |= metric_notes(metrics) | ({"registration": str(self.placed)} if self.placed else {})
        written = [estimate.save(target, overwrite=output.overwrite)]
        if output.figures:
            written += estimate_pictures(estimate, target, truth=scene, snapshot=self.taken, overwrite=output.overwrite)
        report = {"estimate": str(target), "decoder": estimate.decoder, "seconds": round(estimate.seconds, 2),
                  "metrics": metrics, "files": [str(file) for file in written]}  # fmt: skip
        shown = estimate.to_xarray()
        remarks = [*self._own(), *self._left(estimate, report), *application_of(self.taken.camera).remarks(shown)]
        if self.placed is not None:
            report["registered"] = str(self.placed)
            remarks = [str(self.placed), *remarks] if self.placed.converged else remarks
        return _Done(shown, scene, report, [*remarks, *beside_constant(metrics)])

    def _in_register(self) -> _Job:
        """With the mask where the snapshot says that it lies, the same for all decoders; as it is, with a warning,
        where no place stands out."""
        from tmca.registration import register

        known = self.asked.registered
        if self.file not in known:
            with progress_bar(f"register: {self.file.name}") as progress:
                known[self.file] = register(self.taken, self._gaussian_prior(), progress=progress)
        return replace(self, taken=known[self.file].snapshot, placed=known[self.file])

    def _gaussian_prior(self) -> Path | None:
        """The prior that was given, if it is a Gaussian one."""
        from tmca.priors import find_prior

        prior = self.asked.prior
        try:
            find_prior(self.taken.camera, prior, "gaussian")
        except SettingError:
            return None
        return prior

    def _own(self) -> list[str]:
        """That the decoder was chosen by the codes, where it was."""
        said = f"{self.decoder}: it comes with tmca for these codes; --decoder lmmse has a standard deviation beside it"
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

        truth, taken = self.asked.truth, self.taken
        application = application_of(taken.camera)
        how = self.asked.reading.of(application.kind)
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


def _run_all(jobs: Sequence[_Job], asked: _Asked) -> None:
    """Reconstructions one after the other, and all of them in one picture; what fails is told, and the others go on."""
    output, folder = asked.output, _folder(asked.output.out)
    targets = [folder / job.target for job in jobs]
    for target in targets:
        if targets.count(target) > 1:
            raise SettingError("snapshot", f"several for {target}", "snapshots of different names", "rename one")
    picture = folder / "comparison.png"
    written = [file for job, target in zip(jobs, targets, strict=True) for file in job.files(target)]
    check_targets([*written, *([picture] if output.figures else [])], output.overwrite)
    done, failed = dict[tuple[str, str], _Done](), list[str]()
    for job, target in zip(jobs, targets, strict=True):
        try:
            done[job.file.stem.removesuffix("_snapshot"), job.decoder] = job.run(target)
        except TmcaError as error:
            failed.append(f"{job.file.name} by {job.decoder}")
            warned(f"{failed[-1]}: {error}")
    reports, lines = [one.report for one in done.values()], [line for one in done.values() for line in one.lines()]
    if output.figures and len(done) > 1:
        lines += _compared(done, picture, output.overwrite)
    say(reports, output.json, *lines)
    if failed:
        found = f"{len(failed)} of {len(jobs)} that failed ({', '.join(failed)})"
        raise SettingError("reconstruct", found, "estimates of all", "the others are written")


def _folder(out: Path | None) -> Path:
    """Where several estimates go: a folder, made if it is not there."""
    from tmca.data import make_folder

    if out is None:
        return Path()
    if out.suffix and not out.is_dir():
        raise OutputError(out, "one file for several estimates", "a folder")
    make_folder(out)
    return out


def _compared(done: dict[tuple[str, str], _Done], picture: Path, overwrite: bool) -> list[str]:
    """Draw all estimates side by side where they and their truths fit together; what is said of it."""
    from tmca.plots.side_by_side import side_by_side, what_differs
    from tmca.plots.style import save_figure

    differing = what_differs([one.estimate for one in done.values()], [one.scene for one in done.values()])
    if differing:
        return [f"no comparison.png: the estimates differ in {differing}"]
    snapshots = dict.fromkeys(name for name, _ in done)
    decoders = dict.fromkeys(name for _, name in done)
    names = {
        (snapshot, decoder): (decoder, "") if len(snapshots) == 1 else (snapshot, decoder if len(decoders) > 1 else "")
        for snapshot, decoder in done
    }
    scene = next(iter(done.values())).scene
    figure = side_by_side({names[key]: one.estimate for key, one in done.items()}, scene)
    return [f"{save_figure(figure, picture, overwrite=overwrite, dpi=200)}: all side by side"]


def _usual(camera: Any, asked: _Asked) -> tuple[str, dict[str, Any]]:
    """Decoder where none is named, and its settings: one that was made for the camera, if it knows what is asked."""
    from tmca.applications import application_of
    from tmca.decoders import usual_for

    if asked.how["weights"]:
        return "network", {}
    if asked.dictionary:
        return "dictionary", {}
    given = [option for option, value in asked.how.items() if value not in (None, False)]
    given += [text.partition("=")[0].strip() for text in asked.texts]
    alone = not (asked.prior or asked.bank or asked.register)
    name, settings = usual_for(camera, given) if alone else ("", dict[str, Any]())
    return (name, settings) if settings else (application_of(camera.kind).default_decoder, {})


def _check_taken(jobs: Sequence[_Job], asked: _Asked) -> None:
    """Raises SettingError for a setting that none of several decoders has."""
    from tmca.arguments import setting_names

    known = {name for job in jobs if job.cls is not None for name in setting_names(job.cls)}
    named = [text.partition("=")[0].strip() for text in asked.texts]
    named += [name for name, value in asked.how.items() if value is not None and name != "uncertainty"]
    for name in named:
        if name not in known:
            used = ", ".join(dict.fromkeys(job.decoder for job in jobs))
            raise SettingError(name, f"a setting of none of {used}", "one of theirs", "leave it out")


for _camera in CAMERA_SPECS:
    app.command(reconstruct, name=_camera, help=f"The same, for the {_camera} camera.")
