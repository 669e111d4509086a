"""``tmca study``: a comparison described in a YAML file."""

from __future__ import annotations

from pathlib import Path

from tmca.cli.options.grid import GridOptions
from tmca.cli.options.output import say
from tmca.cli.progress import cell_done

_GRID = GridOptions()


def study(file: Path, /, *, out: Path = Path("results"), work: Path | None = None, grid: GridOptions = _GRID) -> None:
    """Codes, noises, decoders and seeds of a YAML file over its test scenes: a comparison of your own.

    Writes NAME.json, NAME.csv and NAME.md for NAME.yaml. Finished cells stay in --work: a run that was stopped resumes.

    Args:
        file: the study; docs/studies.md shows one.
        out: folder of the results.
        work: folder of priors, codes, trainings and finished cells; runs/study-NAME without it.
    """
    from tmca.evaluation.run import run_study
    from tmca.evaluation.study import read_study

    asked = read_study(file)
    found = run_study(asked, out, work or Path("runs") / f"study-{asked.name}", progress=cell_done, **grid.how())
    say(found, grid.json, (out / f"{asked.name}.md").read_text().rstrip(), markdown=grid.markdown)
