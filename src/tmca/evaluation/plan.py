"""The cells that a study is made of: what it learns, searches, trains and measures, in the order of their needs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from tmca.data.scene_names import identity_of
from tmca.decoders import Weights, decoders
from tmca.decoders.nets.weights import weights_file
from tmca.evaluation.camera import EXAMPLES, Lists, Place
from tmca.evaluation.cells import LearnedPrior, Measurement, Search, Training
from tmca.evaluation.grid import Measured, Settings
from tmca.evaluation.study import Study, training_of
from tmca.evaluation.study_parts import Code

Files = Mapping[tuple[str, str, int], str]
"""Files of searched codes by code, noise and seed of the row."""
Need = tuple[str, str, int]
_EXAMPLE = 256
"""Pixels of a side of rendered scenes that codes are searched for, at most."""


class Plan:
    """The cells of a study.

    Args:
        study: what is compared.
        train: scenes that are learned from, by name.
        places: where is measured.
        validation: scenes that choose a network's best step.
        work: folder of the cells.
    """

    def __init__(
        self, study: Study, train: Sequence[str], places: Sequence[Place], validation: Sequence[str], work: Path
    ) -> None:
        self.study, self.train, self.places, self.work = study, list(train), list(places), work
        self.evaluation, self.reading = study.evaluation, study.reading
        measured = list(dict.fromkeys(place.source for place in places))
        self.scenes = self.evaluation.training_scenes(self.reading, self.train, list(validation), measured, study.train)
        self.identities = tuple(identity_of(name) or name for name in (*self.train, *validation))

    def priors(self) -> list[LearnedPrior]:
        """One of every kind that is needed, and the examples of the searches; none without scenes to learn from, where
        decoders have that of the rendered scenes."""
        study = self.study
        kinds = {study.prior_kind(name) for name in study.decoders} | set(self.evaluation.always_learned)
        kinds |= {EXAMPLES} if any(code.search and code.search.kind for code in study.codes.values()) else set()
        return [
            self._learned(kind, self.train or self.examples)
            for kind in sorted(kind for kind in kinds if kind is not None)
            if self.train or kind == EXAMPLES
        ]

    @property
    def examples(self) -> list[str]:
        """Rendered scenes that codes are searched for where a study has none to learn from; none that is measured."""
        return sorted({*self.evaluation.rendered().get("train", ())} - {place.source for place in self.places})

    def _learned(self, kind: str, scenes: Sequence[str]) -> LearnedPrior:
        return LearnedPrior(
            name=kind if kind == EXAMPLES else f"{kind} prior", camera=self.study.camera, prior_kind=kind,
            scenes=tuple(scenes), identities=tuple(identity_of(name) or name for name in scenes), reading=self.reading,
            settings=({} if self.train else {"most": _EXAMPLE}) if kind == EXAMPLES else self._prior_settings(kind),
        )  # fmt: skip

    def _prior_settings(self, kind: str) -> Settings:
        study = self.study
        reading = {**self.reading, "window": study.options.get("likelihood", {}).get("window")}
        return {**self.evaluation.prior_settings(kind, study.settings, reading), **study.priors.get(kind, {})}

    def searches(self, lists: Lists) -> dict[Need, Search]:
        """Every search that rows of some noise and seed need, once; those of codes that are searched for each noise
        first."""
        study, searches = self.study, dict[Need, Search]()
        codes = [(name, code.search) for name, code in study.codes.items() if code.search]
        for seed in study.all_seeds:
            for name, search in sorted(codes, key=lambda code: code[1].noise is not None):
                for noise in study.noises if search.noise is None else [search.noise]:
                    settings = self.evaluation.search_settings(study, study.codes[name], lists)
                    cell = Search(
                        name=f"search · {name} · {noise} · seed {seed}", camera=study.camera, code=name, noise=noise,
                        sensor=study.noises[noise], seed=seed, settings=settings,
                    )  # fmt: skip
                    searches.setdefault(self._need(name, noise, seed), cell)
        return searches

    def _need(self, name: str, noise: str, seed: int) -> Need:
        """What identifies a search: patterns by kind and slots, masks by their name."""
        search = self.study.codes[name].search
        assert search is not None
        what = name if search.kind is None else f"{search.kind} {search.slots}"
        return what, search.noise or noise, seed

    def files(self, searches: Mapping[Need, Search], made: Sequence[Measured]) -> Files:
        """Files of searched codes of every row whose search did not fail."""
        files = {cell["name"]: cell["codes"] for cell in made}
        of_rows: dict[tuple[str, str, int], str] = {}
        for name, code in self.study.codes.items():
            for noise in self.study.noises if code.search else ():
                for seed in self.study.all_seeds:
                    cell = searches[self._need(name, noise, seed)]
                    of_rows |= {(name, noise, seed): files[cell.name]} if cell.name in files else {}
        return of_rows

    def untrained(self, priors: Mapping[str, str], codes: Files) -> list[Measurement]:
        """Decoders without training behind codes that do not learn."""
        study = self.study
        rows = [
            (name, code, noise, decoder, seed)
            for decoder in study.decoders if decoder not in study.networks
            for noise in study.noises
            for name, code in study.codes.items()
            for seed in study.seeds_of(decoder)
        ]  # fmt: skip
        return [
            cell
            for name, code, noise, decoder, seed in rows
            if code.learn is None and not self._twin(code, noise)
            and (code.search is None or (name, noise, seed) in codes)
            for cell in self._row(
                name, noise, decoder, seed, priors, codes=code.file or codes.get((name, noise, seed)),
                camera_of=code.shown(study.camera),
            )
        ]  # fmt: skip

    def _twin(self, code: Code, noise: str) -> bool:
        """Whether a code that is searched for every noise is the same as one that is searched for this one."""
        if code.search is None or code.search.noise is not None:
            return False
        twin = code.search.model_copy(update={"noise": noise})
        others = self.study.codes.values()
        return any((other.search, other.dead_time) == (twin, code.dead_time) for other in others)

    def _row(
        self, code: str, noise: str, decoder: str, seed: int, priors: Mapping[str, str], *, codes: str | None = None,
        camera_of: str | None = None, weights: str | None = None,
    ) -> Iterator[Measurement]:  # fmt: skip
        """Measurements of one row and seed in every place."""
        study, chosen = self.study, self.study.codes[code]
        kind = study.prior_kind(decoder)
        shown = (study.shown is None or (code, decoder) in study.shown) and noise == study.shown_noise
        options = {} if weights else study.options.get(decoder, {})
        settings = study.settings if codes else {**study.settings, **chosen.camera}
        for place in self.places:
            if not place.takes(kind):
                continue
            yield Measurement(
                name=f"{place.name} · {code} · {noise} · {study.decoder_labels[decoder]} · seed {seed}",
                camera=study.camera, code=code, noise=noise, decoder=decoder, seed=seed, scene=place.scene,
                source=place.source,
                identity=_identity(place.identity, decoder, self._files(options, chosen)),
                reading=place.reading,
                settings=self.evaluation.camera_settings({**settings, "seed": seed}, self.reading),
                sensor=study.noises[noise], codes=codes, part=place.part,
                motion={} if study.motion is None else study.motion.model_dump(),
                dead_time=chosen.dead_time, camera_of=camera_of, weights=weights, options=options,
                prior=None if weights or kind is None else priors.get(kind), about=place.about,
                save=shown and place.shown and seed == study.seed,
            )  # fmt: skip

    def _files(self, options: Settings, code: Code) -> list[str]:
        """Files of the weights of a decoder, and of codes."""
        weights, slots = options.get("weights"), int(code.camera.get("slots", 8))
        named = None if weights is None else weights_file(Weights.file(weights, slots, self.study.camera))
        return [str(file) for file in (named, code.file or code.shown(self.study.camera)) if file is not None]

    def trainings(self, codes: Files) -> list[list[Training]]:
        """Trainings of all rows and seeds, in rounds: those that others start from first."""
        study = self.study
        cells: dict[tuple[str, str, int], Training] = {}
        rounds: list[list[Training]] = [[], [], []]
        for seed in study.all_seeds:
            rounds[0] += self._behind_fixed(seed, codes)
            for name, code in study.codes.items():
                for network in (n for n in (code.learn.networks if code.learn else ()) if n in study.decoders):
                    start, after = self._start(code, network, seed, codes, cells)
                    if after is not None:
                        cells[name, network, seed] = cell = self._training(name, network, seed, start)
                        rounds[after].append(cell)
        rounds[2] += self._behind_learned(cells)
        return rounds

    def _behind_fixed(self, seed: int, codes: Files) -> Iterator[Training]:
        """Networks behind codes that do not learn."""
        for network in (name for name in self.study.decoders if name in self.study.networks):
            for name, code in self.study.codes.items():
                if code.learn is None and code.train:
                    start = code.shown(self.study.camera) or _searched(name, seed, codes)
                    if code.search is None or start is not None:
                        yield self._training(name, network, seed, start)

    def _behind_learned(self, cells: Mapping[tuple[str, str, int], Training]) -> Iterator[Training]:
        """Other networks behind the codes that were learned with one."""
        for (name, network, seed), cell in cells.items():
            learn = self.study.codes[name].learn
            for other in learn.networks[network] if learn else ():
                if other in self.study.networks and other in self.study.decoders:
                    weights = str(cell.folder(self.work) / "weights.safetensors")
                    yield self._training(name, other, seed, weights, learns=False)

    def _start(
        self, code: Code, network: str, seed: int, codes: Files, cells: Mapping[tuple[str, str, int], Training]
    ) -> tuple[str | None, int | None]:
        """What learned codes start from, and the round of their training; None where that failed."""
        name = code.learn.start if code.learn else None
        if name is None:
            return None, 0
        if (name, network, seed) in cells:
            return str(cells[name, network, seed].folder(self.work)), 1
        if (shown := self.study.codes[name].shown(self.study.camera)) is not None:
            return shown, 0
        start = _searched(name, seed, codes)
        return start, 0 if start is not None else None

    def _training(self, code: str, network: str, seed: int, start: str | None, learns: bool = True) -> Training:
        label, shown = self.study.decoder_labels[network], self.study.codes[code].shown(self.study.camera)
        return Training(
            name=f"training · {code} · {label} · seed {seed}", camera=self.study.camera, code=code, decoder=network,
            seed=seed, training=training_of(self.study, code, network, seed, self.scenes, start, learns=learns),
            reading=self.reading,
            identities=self.identities if shown is None else (*self.identities, identity_of(shown)),
        )  # fmt: skip

    def behind_networks(
        self, trained: Sequence[Measured], priors: Mapping[str, str], codes: Files
    ) -> list[Measurement]:
        """Networks behind their codes, and other decoders behind codes that were learned with one."""
        study, cells = self.study, list[Measurement]()
        for cell in trained:
            name, network, seed, weights = cell["code"], cell["decoder"], cell["seed"], cell["weights"]
            learn = study.codes[name].learn
            others = learn.networks.get(network, ()) if learn else ()
            behind = [(network, weights)]
            behind += [(other, None) for other in others if other in study.decoders and other not in study.networks]
            for decoder, used in behind:
                for noise in study.noises:
                    shown = weights if learn else study.codes[name].shown(study.camera)
                    file = None if shown else codes.get((name, noise, seed))
                    cells += self._row(name, noise, decoder, seed, priors, codes=file, camera_of=shown, weights=used)
        return cells


def _searched(name: str, seed: int, codes: Files) -> str | None:
    """The file of codes that were searched for the first of the noises; None where that failed."""
    return next((file for (code, _, drawn), file in codes.items() if (code, drawn) == (name, seed)), None)


def _identity(scene: Any, decoder: str, files: Sequence[str]) -> Any:
    """What tells that a scene, or a file of codes, of a decoder or of its weights has changed."""
    program = getattr(decoders().get(decoder), "file", None)
    named = [*([str(program)] if program is not None else []), *files]
    return [scene, *map(identity_of, named)] if named else scene
