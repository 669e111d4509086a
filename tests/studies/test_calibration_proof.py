"""Calibration held against hidden truth: errors, and what a calibrated operator explains of a snapshot."""

import pytest

from studies.calibration_proof import Proof, prove, table_of


@pytest.mark.slow
def test_mirrors_are_found_to_a_fiftieth_of_a_wave_and_explain_the_snapshot():
    found = prove(1, (40, 41), cameras=("spectral-depth",)).stated()
    errors = {row["quantity"]: row for row in found["errors"]}
    assert errors["wavefront"]["error"] <= errors["wavefront"]["bound"] == 1 / 50
    assert len(errors["wavefront"]["all"]) == 2
    explained = {row["operator"]: row["explained"] for row in found["reconstruction"]}
    assert explained["calibrated"] > explained["nominal"] + 3
    assert explained["calibrated"] == pytest.approx(explained["true"], abs=0.5)


@pytest.mark.slow
def test_leaks_are_found_and_explain_the_snapshot():
    found = prove(1, (40, 41), cameras=("light-field",)).stated()
    errors = {row["quantity"]: row["error"] for row in found["errors"]}
    assert errors["leakage of the aperture"] < 1e-3
    assert errors["leakage of the shutter"] < 1e-3
    explained = {row["operator"]: row["explained"] for row in found["reconstruction"]}
    assert explained["calibrated"] == pytest.approx(explained["true"], abs=0.5)
    assert explained["calibrated"] > explained["without contrast and leakage"] + 1


def test_the_worst_bench_counts_and_a_missed_bound_is_said():
    proof = Proof(2, 40.0)
    proof.found = {"registration": [0.01, 0.07], "shear": [0.001]}
    proof.rows = [
        {"camera": "spectral", "seed": s, "operator": "true", "psnr": 20.0 + s, "explained": 30.0} for s in (0, 1)
    ]
    found = proof.stated()
    assert found["errors"][0]["error"] == 0.07
    assert found["reconstruction"] == [{"camera": "spectral", "operator": "true", "psnr": 20.5, "explained": 30.0}]
    lines = table_of(found).splitlines()
    assert [line.endswith("missed") for line in lines[1:3]] == [True, False]
    assert "20.50" in lines[-1]
