"""``python -m tests.fuzz``: a campaign over all kinds, resumed where it was stopped; exit 1 where anything failed."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections import Counter, defaultdict
from pathlib import Path

from tests.fuzz import campaign
from tests.fuzz.kinds import KINDS, load_kinds
from tests.fuzz.server import HEAVY, Verdict, prepare

REGRESSIONS = Path(__file__).parent / "regressions"


def main() -> int:
    """Run what is asked and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--mutations", type=int, default=20_000, help="in all")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--folder", type=Path, default=Path("build/fuzz"))
    parser.add_argument("--kinds", default="", help="names that contain one of these words, separated by commas")
    parser.add_argument("--seconds", type=float, default=1e9, help="stop each job after these")
    parser.add_argument("--first", type=int, default=0, help="number of the first damage of every kind")
    parser.add_argument("--regressions", action="store_true", help="read the failures of the past again, nothing else")
    parser.add_argument("--list", action="store_true", help="the kinds")
    asked = parser.parse_args()
    load_kinds()
    words = asked.kinds.split(",")
    kinds = [name for name in KINDS if any(word in name for word in words)]
    if asked.list:
        print("\n".join(kinds))
        return 0
    prepare(() if asked.kinds or asked.regressions else HEAVY)
    if asked.regressions:
        return _replay(kinds)
    campaign.make_seeds(asked.folder / "seeds", kinds)
    _fork(asked, kinds)
    return _report(asked.folder, asked.jobs)


def _fork(asked: argparse.Namespace, kinds: list[str]) -> None:
    children = []
    for part in range(asked.jobs):
        child = os.fork()
        if not child:
            campaign.run(asked.folder, kinds, asked.mutations, part, asked.jobs, asked.seconds, asked.first)
            os._exit(0)
        children.append(child)
    for child in children:
        os.waitpid(child, 0)


def _replay(kinds: list[str]) -> int:
    """Failures of the past, which have to be read or refused now."""
    bad = []
    for packed in sorted(REGRESSIONS.glob("*/*.zip")):
        if packed.parent.name in kinds:
            with tempfile.TemporaryDirectory() as folder:
                verdict = campaign.replay(packed, packed.parent.name, Path(folder))
            bad += [] if verdict.good else [f"{packed.relative_to(REGRESSIONS)}: {verdict.end} {verdict.text}"]
    print("\n".join(bad) or "all of the past are mended")
    return 1 if bad else 0


def _report(folder: Path, jobs: int) -> int:
    """Ends by kind, and every failure once by its place."""
    table: dict[str, Counter[str]] = defaultdict(Counter)
    failures: dict[tuple[str, str, str], list[str]] = defaultdict(list)
    for part in range(jobs):
        for said in campaign.journal(folder / f"journal-{part}-of-{jobs}.jsonl"):
            table[said["kind"]][said["end"]] += 1
            if not Verdict(said["end"]).good:
                failures[said["kind"], said["end"], said["text"][:90]].append(f"{said['number']} ({said['how'][:60]})")
    for name, ends in table.items():
        print(f"{name:28}", " ".join(f"{end} {count}" for end, count in sorted(ends.items())))
    for (name, end, text), places in sorted(failures.items()):
        print(f"{end:10} {name:24} ×{len(places):<4} {text}   e.g. {places[0]}")
    total = sum(table.values(), Counter[str]())
    print(sum(total.values()), "mutations:", ", ".join(f"{end} {count}" for end, count in sorted(total.items())))
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
