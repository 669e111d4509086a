"""Benches with hidden numbers, rendered by rays, instants and sums of waves: they share no code with the estimators."""

from tmca.lab.calibration.rendered.bench import write_bench
from tmca.lab.calibration.rendered.known import true_calibration
from tmca.lab.calibration.rendered.truth import REFERENCE, BenchTruth

__all__ = ["REFERENCE", "BenchTruth", "true_calibration", "write_bench"]
