"""What ``tmca train --from`` says: a trained decoder fine-tuned on calibrated captures."""

from __future__ import annotations

import json as json_module
import os
from pathlib import Path
from typing import Any


def run_tuning(prepared: Any, out: Path, accelerator: str, json: bool) -> None:
    """Fine-tune, draw how it went, and say what came out."""
    from tmca.cli.progress import progress_bar
    from tmca.tuning.pictures import tuning_pictures

    local, rank = int(os.environ.get("LOCAL_WORLD_SIZE", "1")), int(os.environ.get("RANK", "0"))
    with progress_bar(f"tune {out.name}") as bar:

        def read(name: str) -> Any:
            pair = prepared.read(name)
            if not rank:
                bar(None, f"{name} read")
            return pair

        def told(done: int, steps: int, said: str) -> None:
            bar(done / steps, "fine-tuning", f"step {done}/{steps}, {said}")

        found = prepared.run(
            out, read, accelerator=accelerator, processes=local,
            nodes=int(os.environ.get("WORLD_SIZE", "1")) // local, progress=told,
        )  # fmt: skip
        bar(None, "pictures")
        pictures = [] if rank else tuning_pictures(prepared, out)
    if not rank:
        _say(_report(prepared, out, found, pictures), json)


def _report(prepared: Any, out: Path, found: Any, pictures: list[Path]) -> dict[str, Any]:
    from tmca.training.log import TrainingLog

    before = {name: float(value) for name, value in TrainingLog(out / "log.csv").rows()[0].items() if value}
    data, used = prepared.settings.data, prepared.calibration
    return {
        "weights": str(found.weights),
        "calibration": None if used is None else used.where,
        "learned_from": list(data.train),
        "held_out": list(data.validation),
        "before": {name: before[name] for name in found.best if name in before and name != "step"},
        "best": found.best,
        "steps": found.steps,
        "files": [str(picture) for picture in pictures],
    }


def _say(report: dict[str, Any], json: bool) -> None:
    if json:
        print(json_module.dumps(report, indent=1))
        return
    best, held = report["best"], len(report["held_out"])
    count = f"{len(report['learned_from'])} captures learned from, {held} held out"
    print(f"{report['weights']}: {count}, {report['steps']} steps")
    operator = f"calibrated by {report['calibration']}" if report["calibration"] else "the run's own, not calibrated"
    print(f"  operator: {operator}")
    for name, value in report["before"].items():
        unit = {"psnr": " dB", "depth_mae": " m"}.get(name, "")
        if name != "score":
            print(f"  {name} held out: {value:.4g}{unit} before, {best[name]:.4g}{unit} after (step {best['step']})")
    if not best["step"]:
        print("  no step was better than the decoder as it was, which is what is kept")
    print(f"  {', '.join(Path(file).name for file in report['files'])} beside it")
