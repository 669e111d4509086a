"""Calibrate the deviations that decoders predict: ``python -m studies.uncertainty.fit DATA``.

Estimates of scenes that nothing was learned from, behind several cameras of each kind, give errors beside what an
estimate shows (`tmca.decoders.certainty.Features`). Coefficients make their weighted sum the deviation of Laplace's
distribution under which the errors are likeliest, which hears little of the rare large ones; one factor then brings
the shares within one and two deviations to 68 and 95 %. Written: ``src/tmca/weights/certainty.json``.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from studies.bench import FILE, Features
from studies.uncertainty.cases import KINDS, Case, cases
from tmca.data import write_text

LIGHT = ("predicted", "activity", "edges", "slope")
NAMES = {"spectral": LIGHT, "light-field": LIGHT, "spectral-depth": ("predicted",)}
"""Features by kind of camera."""
VALUES, LEAST, FACTORS = 5_000, 0.02, 200
"""Values that are taken of a case; the least coefficient of the predicted deviation; factors that are tried."""
_TINY = 1e-9


def sampled(case: Case, names: Sequence[str]) -> tuple[Tensor, Tensor]:
    """(N, F) features and (N,) absolute errors of a case, evenly from where the truth is known."""
    features, known = Features(case.values, case.deviation), case.known.flatten().nonzero()[:, 0]
    some = known[:: max(1, len(known) // VALUES)]
    columns = [getattr(features, name).expand_as(case.values).flatten()[some] for name in names]
    return torch.stack(columns, 1).double(), case.errors.flatten()[some].double()


def fitted(samples: Sequence[tuple[Tensor, Tensor]], names: Sequence[str]) -> dict[str, float]:
    """Coefficients by name; every sample counts alike."""
    shares = torch.cat([torch.full_like(errors, 1 / len(errors)) for _, errors in samples])
    features, errors = (torch.cat(parts) for parts in zip(*samples, strict=True))
    typical = features.mean(0).clamp_min(_TINY)
    logs = torch.full((len(names),), -2.0, dtype=torch.double, requires_grad=True)
    search = torch.optim.LBFGS([logs], max_iter=60, line_search_fn="strong_wolfe")
    least = torch.tensor([LEAST if name == "predicted" else 0.0 for name in names], dtype=torch.double)

    def coefficients() -> Tensor:
        return logs.exp() / typical * typical.mean() + least

    def loss() -> Tensor:
        search.zero_grad()
        sigma = features @ coefficients() + _TINY
        value = (shares * (sigma.log() + 2**0.5 * errors / sigma)).sum() / len(samples)
        value.backward()
        return value

    search.step(loss)
    found = coefficients().detach()
    found = found * factor((errors / (features @ found + _TINY)), shares / len(samples))
    return {name: round(value, 4) for name, value in zip(names, found.tolist(), strict=True)}


def factor(ratios: Tensor, shares: Tensor) -> float:
    """By which deviations are multiplied so that the shares of errors within one and two of them are farthest within 68
    ± 4 and 95 ± 2 %.

    Args:
        ratios: (N,) errors over deviations.
        shares: (N,) weights, of sum one.
    """
    tried = torch.logspace(-1, 1, FACTORS, dtype=torch.double)
    within = torch.stack([(shares * (ratios <= n * tried[:, None])).sum(1) for n in (1, 2)])
    off = (within - torch.tensor([[0.68], [0.95]])).abs() / torch.tensor([[0.04], [0.02]])
    return float(tried[off.amax(0).argmin()])


def calibration(kind: str, decoder: str, some: Iterable[Case]) -> dict[str, Any]:
    """An entry of the file; prints the shares of the errors within one and two deviations, case by case."""
    samples, labels = list[tuple[Tensor, Tensor]](), list[tuple[str, ...]]()
    scenes, cameras = dict[str, None](), dict[str, None]()
    for case in some:
        samples.append(sampled(case, NAMES[kind]))
        scenes[case.scene] = cameras[case.camera] = None
        labels.append((kind, decoder, case.camera, case.prior, case.scene))
        print(*labels[-1], flush=True)
    coefficients = fitted(samples, NAMES[kind])
    for label, (features, errors) in zip(labels, samples, strict=True):
        ratio = errors / (features @ torch.tensor([*coefficients.values()], dtype=torch.double) + _TINY)
        print(*label, *(f"{float((ratio <= n).double().mean()):.1%}" for n in (1, 2)), flush=True)
    about = {"decoder": decoder, "camera": kind, "coefficients": coefficients}
    return {**about, "scenes": [*scenes], "cameras": [*cameras]}


def main() -> None:
    """Write all, or those of one kind anew."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--only", choices=KINDS, help="leave the other kinds of camera as they are")
    parser.add_argument("--decoder", default="", help="leave the other decoders as they are")
    how = parser.parse_args()
    torch.set_num_threads(1)
    known = json.loads(FILE.read_text()) if FILE.exists() else []
    for kind in [how.only] if how.only else KINDS:
        for decoder in [one for one in KINDS[kind].decoders if how.decoder in ("", one)]:
            made = calibration(kind, decoder, cases(kind, how.data, decoders=[decoder]))
            others = [one for one in known if (one["camera"], one["decoder"]) != (kind, decoder)]
            known = [*others, made]
            text = json.dumps(known, ensure_ascii=False, indent=1)
            write_text(text + "\n", FILE, overwrite=True)


if __name__ == "__main__":
    main()
