"""A campaign of seeded damage over all kinds: journalled, so that killed work goes on; every failure is saved."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
import time
import zipfile
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from tests.fuzz.damage import copy, damage
from tests.fuzz.kinds import KINDS, Kind
from tests.fuzz.server import READ, Verdict, judge, verdicts


def make_seeds(folder: Path, kinds: Sequence[str]) -> None:
    """A good file of every kind, made in children; it has to be read."""
    folder.mkdir(parents=True, exist_ok=True)
    problems = []
    for name in kinds:
        if not (folder / name).exists():
            (verdict,) = verdicts([partial(_made, KINDS[name], folder / name)], 120)
            if verdict.end != READ:
                problems.append(f"{name}: {verdict}")
    assert not problems, "good files are not read: " + "\n".join(problems)


def _made(kind: Kind, path: Path) -> Verdict:
    with tempfile.TemporaryDirectory(dir=path.parent) as scratch:
        made = Path(scratch) / path.name
        kind.make(made)
        verdict = judge(kind, made)
        if verdict.end == READ:
            for file in Path(scratch).iterdir():  # what lies beside it belongs to it
                file.rename(path.parent / file.name)
    return verdict


def damaged(seeds: Path, name: str, number: int, folder: Path) -> tuple[Path, str]:
    """The good file of a kind with the damage of one number, written into an empty folder, and the damage in words."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for file in seeds.glob(f"{Path(name).stem}.*") if not (seeds / name).is_dir() else [seeds / name]:
        copy(file, folder / file.name)
    rng = np.random.default_rng([crc32(name.encode()), number])
    words: list[str] = []
    for _ in range(int(rng.choice([1, 1, 1, 2, 4]))):
        words.append(damage(folder / name, rng, not any(": bytes " in word for word in words)))
    return folder / name, "; ".join(words)


def _tried(seeds: Path, name: str, number: int, folder: Path) -> Verdict:
    """Damage and read, in a child; the folder holds the damaged file and, beside it, the damage in words."""
    path, how = damaged(seeds, name, number, folder)
    folder.with_suffix(".how").write_text(how)
    return judge(KINDS[name], path)


def numbers_of(kinds: Sequence[str], count: int, first: int = 0) -> Iterator[tuple[str, int]]:
    """The kinds in turn, as many damages as asked; the first of each kind has the number ``first``."""
    for place in range(count):
        yield kinds[place % len(kinds)], first + place // len(kinds)


def run(
    folder: Path,
    kinds: Sequence[str],
    count: int,
    part: int = 0,
    parts: int = 1,
    seconds: float = 1e9,
    first: int = 0,
) -> Counter[str]:
    """Every ``parts``-th damage of a campaign that its journal does not hold yet; gives how often each end came.

    Args:
        folder: of the campaign: good files, journals, and under ``failures`` the files that failed.
        kinds: names of `KINDS`.
        count: damages in all.
        part, parts: which share this process does.
        seconds: stop after these.
        first: number of the first damage of each kind; other numbers are other damages.
    """
    lines_of = folder / f"journal-{part}-of-{parts}.jsonl"
    ends = {(said["kind"], said["number"]): said["end"] for said in journal(lines_of)}
    mine = [at for place, at in enumerate(numbers_of(kinds, count, first)) if place % parts == part and at not in ends]
    start = time.monotonic()
    with _scratch() as scratch, lines_of.open("a") as lines:
        places = [scratch / f"{place}" for place in range(len(mine))]
        works = [partial(_tried, folder / "seeds", *at, place) for at, place in zip(mine, places, strict=True)]
        for (name, number), place, verdict in zip(mine, places, verdicts(works), strict=True):
            ends[name, number] = verdict.end
            how = place.with_suffix(".how")
            said = {"kind": name, "number": number, "end": verdict.end, "text": verdict.text[:300]}
            lines.write(json.dumps(said | {"how": how.read_text() if how.exists() else "?"}) + "\n")
            lines.flush()
            if not verdict.good:
                save(place, folder / "failures" / name / f"{number}.zip")
            shutil.rmtree(place, ignore_errors=True)
            how.unlink(missing_ok=True)
            if time.monotonic() - start > seconds:
                break
    return Counter(ends.values())


@contextmanager
def _scratch() -> Iterator[Path]:
    """A folder in memory where there is one."""
    memory = Path("/dev/shm")
    usable = memory.is_dir() and os.access(memory, os.W_OK)
    with tempfile.TemporaryDirectory(prefix="fuzz-", dir=memory if usable else None) as folder:
        yield Path(folder)


def journal(path: Path) -> list[dict[str, Any]]:
    """What a journal holds; a line that was being written when it was killed is left out."""
    lines = path.read_text().splitlines() if path.exists() else []
    return [json.loads(line) for line in lines if line.endswith("}")]


def save(folder: Path, target: Path) -> None:
    """A damaged file with what lies beside it, as a ZIP file."""
    target.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as packed:
        for file in sorted(folder.rglob("*")):
            if file.is_file():
                packed.write(file, file.relative_to(folder))


def replay(packed: Path, name: str, folder: Path) -> Verdict:
    """Read a saved failure again."""
    with zipfile.ZipFile(packed) as archive:
        archive.extractall(folder)
    (verdict,) = verdicts([partial(judge, KINDS[name], folder / name)])
    return verdict
