"""``tmca dbd`` from the first file to a study, and what it refuses."""

import json

import numpy as np
import pytest

from tests.cli.refusals import refused
from tmca.cli import main

SMALL = ("-M", "9", "-P", "5", "-J", "2", "--targets", "2", "--paths", "1")


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_simulated_samples_are_solved_and_drawn(capsys, tmp_path):
    main(["dbd", "simulate", *SMALL])
    main(["dbd", "solve", "overlaid.nc"])
    said = capsys.readouterr().out
    assert "radar: 2 paths" in said
    assert "certificate: certified" in said
    assert "success" in said
    assert (tmp_path / "overlaid.recovery.nc").exists()
    assert (tmp_path / "overlaid.recovery.png").stat().st_size > 10_000


def test_json_has_the_same(capsys):
    main(["dbd", "simulate", *SMALL, "--messages", "block", "--snr", "25"])
    capsys.readouterr()
    main(["dbd", "solve", "overlaid.nc", "--json", "--unknown-noise"])
    told = json.loads(capsys.readouterr().out)
    assert len(told["sources"]["radar"]) == 2
    assert told["score"]["success"] is True
    assert 0 < told["sources"]["radar"][0]["delay_bound"] < 0.1
    assert any("relative" in note for note in told["notes"])


def test_a_study_keeps_what_is_finished(capsys, tmp_path):
    asked = ["dbd", "study", "--vary", "L=1,2", "--vary", "J=1,2", "--set", "M=7", "--set", "P=3", "--set", "Q=1"]
    asked += ["--set", "basis=gaussian", "--draws", "2", "--out", "s"]
    main(asked)
    kept = {file: file.stat().st_mtime_ns for file in (tmp_path / "runs" / "dbd-study").glob("*.json")}
    assert len(kept) == 8
    main([*asked, "--overwrite"])
    assert {file: file.stat().st_mtime_ns for file in kept} == kept
    rows = json.loads((tmp_path / "s.json").read_text())["rows"]
    assert [(row["L"], row["J"]) for row in rows] == [(1, 1), (1, 2), (2, 1), (2, 2)]
    assert all(row["draws"] == 2 for row in rows)
    assert rows[0]["success"] == 1.0
    assert (tmp_path / "s.png").exists()
    assert (tmp_path / "s.csv").read_text().count("\n") == 5


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("simulate", "--snr", "nan"), "a finite number of decibels"),
        (("simulate", "--targets", "x"), "--targets: found 'x'"),
        (("simulate", "--messages", "none"), "one of shared, block, dense"),
        (("simulate", "--symbol-ratio", "0"), "found 0"),
        (("simulate", "--separation", "0.9"), "points that fit on the torus"),
        (("simulate", "--scenario", "nowhere"), "found no such file"),
        (("solve", "nothere.nc"), "nothere.nc: found no such file"),
        (("study", "--vary", "size=3"), "found 'size'"),
        (("study", "--vary", "L"), "NAME=VALUE"),
    ],
)
def test_bad_input_gives_one_line_and_leaves_nothing(capsys, tmp_path, words, told):
    assert told in refused(capsys, "dbd", *words)
    assert [file.name for file in tmp_path.iterdir() if file.is_file()] == []


def test_sizes_beyond_the_memory_are_refused_with_numbers(capsys):
    rng = np.random.default_rng(0)
    y = rng.random((90, 90)) + 0j
    np.savez("big.npz", y=y, basis_radar=rng.random((90, 2)))
    assert "8100 samples" in refused(capsys, "dbd", "solve", "big.npz", "--method", "cvxpy", "--sigma", "0")
    assert "give sigma" in refused(capsys, "dbd", "solve", "big.npz", "--method", "sdp")


def test_results_that_exist_are_kept(capsys, tmp_path):
    main(["dbd", "simulate", *SMALL])
    before = (tmp_path / "overlaid.nc").read_bytes()
    assert "overlaid.nc" in refused(capsys, "dbd", "simulate", *SMALL)
    assert (tmp_path / "overlaid.nc").read_bytes() == before
