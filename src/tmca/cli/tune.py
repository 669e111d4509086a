"""What ``tmca train --from`` says: a trained decoder fine-tuned on calibrated captures."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tmca.cli.options.output import say


def rank() -> int:
    """Of this process among those of a run."""
    return int(os.environ.get("RANK", "0"))


def run_with_bar(title: str, doing: str, load: Callable[[str], Any], run: Callable[..., Any], accelerator: str) -> Any:
    """A run of any kind with a progress bar.

    Args:
        title: of the bar.
        doing: what it says of a step.
        load: reads a scene or capture by its name.
        run: called with what reads and says so, and with the engine's arguments of `tmca.training.train`.
        accelerator: auto, cpu or cuda.
    """
    from tmca.cli.progress import progress_bar

    processes = int(os.environ.get("LOCAL_WORLD_SIZE", "1"))
    nodes = int(os.environ.get("WORLD_SIZE", "1")) // processes
    with progress_bar(title) as bar:

        def read(name: str) -> Any:
            scene = load(name)
            if not rank():
                bar(None, f"{Path(name).name} read")
            return scene

        def show(done: int, steps: int, text: str) -> None:
            bar(done / steps, doing, f"step {done}/{steps}, {text}")

        return run(read, {"accelerator": accelerator, "processes": processes, "nodes": nodes, "progress": show})


def run_tuning(prepared: Any, out: Path, accelerator: str, json: bool) -> None:
    """Fine-tune, draw how it went, and say what came out."""
    from tmca.tuning.pictures import tuning_pictures

    pictures: list[Path] = []

    def run(read: Any, how: dict[str, Any]) -> Any:
        return prepared.run(out, read, finish=lambda: pictures.extend(tuning_pictures(prepared, out)), **how)

    tuned = run_with_bar(f"tune {out.name}", "fine-tuning", prepared.read, run, accelerator)
    if not rank():
        report = _report(prepared, out, tuned, pictures)
        say(report, json, *_lines(report))


def _report(prepared: Any, out: Path, tuned: Any, pictures: list[Path]) -> dict[str, Any]:
    from tmca.training.log import TrainingLog

    before = {name: float(value) for name, value in TrainingLog(out / "log.csv").rows()[0].items() if value}
    data, used = prepared.settings.data, prepared.calibration
    return {
        "weights": str(tuned.weights),
        "calibration": None if used is None else used.where,
        "learned_from": list(data.train),
        "held_out": list(data.validation),
        "before": {name: before[name] for name in tuned.best if name in before and name != "step"},
        "best": tuned.best,
        "steps": tuned.steps,
        "files": [str(picture) for picture in pictures],
    }


def _lines(report: dict[str, Any]) -> list[str]:
    """The report for people."""
    best, held = report["best"], len(report["held_out"])
    count = f"{len(report['learned_from'])} captures learned from, {held} held out"
    operator = f"calibrated by {report['calibration']}" if report["calibration"] else "the run's own, not calibrated"
    lines = [f"{report['weights']}: {count}, {report['steps']} steps", f"  operator: {operator}"]
    for name, value in report["before"].items():
        unit = {"psnr": " dB", "depth_mae": " m"}.get(name, "")
        if name != "score":
            after = f"{best[name]:.4g}{unit} after (step {best['step']})"
            lines.append(f"  {name} held out: {value:.4g}{unit} before, {after}")
    if not best["step"]:
        lines.append("  no step was better than the decoder as it was, which is what is saved")
    return [*lines, f"  {', '.join(Path(file).name for file in report['files'])} beside it"]
