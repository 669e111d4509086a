"""``tmca dbd`` from the first file to a study, and what it refuses."""

import json

import numpy as np
import pandas as pd
import pytest

from tests.cli.calls import answer, said
from tests.cli.refusals import refused
from tmca.cli import main
from tmca.dbd import Channel, Chirp, load_problem

SMALL = ("-M", "9", "-P", "5", "-J", "2", "--targets", "2", "--paths", "1")


def test_simulated_samples_are_solved_and_drawn(capsys, tmp_path):
    main(["dbd", "simulate", *SMALL])
    printed = said(capsys, "dbd", "solve", "overlaid.nc")
    assert "radar: 2 paths" in printed
    assert "certificate: certified" in printed
    assert "success" in printed
    assert (tmp_path / "overlaid.recovery.nc").exists()
    assert (tmp_path / "overlaid.recovery.png").stat().st_size > 10_000
    assert "joint separation (Monsalve et al. 2022)" in printed


def test_a_known_chirp_takes_the_place_of_a_basis_and_targets_go_to_a_table(capsys, tmp_path):
    rows = Chirp(9e6, 5e-7).rows(4, 21, 3e-6)[:, 0]
    y = rows * np.exp(-2j * np.pi * (np.arange(21) - 10) * 0.3) * np.ones((4, 1))
    np.savez("y.npz", y=y, delay_s=3e-6, doppler_hz=2e5, sigma=0.0)
    asked = ("dbd", "solve", "y.npz", "--waveform", "radar=chirp:bandwidth=9e6,duration=5e-7", "--no-certify")
    assert "target 1" in said(capsys, *asked, "--csv", "t.csv", "--figure", "t.pdf", "--axes", "time")
    frame = pd.read_csv("t.csv")
    assert frame.name.tolist() == ["target 1"]
    assert frame.delay_s[0] == pytest.approx(0.9e-6)
    assert (tmp_path / "t.pdf").exists()


def test_a_scenario_sends_a_waveform_of_ones_own(capsys):
    chirp = ("--waveform", "radar=chirp:bandwidth=8e6,duration=6e-7")
    assert "found no --model-only" in refused(capsys, "dbd", "simulate", "--scenario", "road", *chirp)
    assert "found no --scenario" in refused(capsys, "dbd", "simulate", *chirp)
    main(["dbd", "simulate", "--scenario", "road", "--model-only", *chirp])
    problem = load_problem("overlaid.nc")
    radar = problem.sources[0]
    rows = Chirp(8e6, 6e-7).rows(17, 33, 3.3e-6)
    np.testing.assert_allclose(radar.rows, np.broadcast_to(rows, radar.rows.shape))
    channels = [Channel.true(*one, problem.shape) for one in zip(problem.sources, problem.truth, strict=True)]
    left = problem.y.reshape(-1) - sum(one.samples() for one in channels)
    assert np.sqrt(np.mean(np.abs(left) ** 2)) == pytest.approx(problem.sigma, rel=0.1)


@pytest.mark.slow
def test_json_has_the_same(capsys):
    main(["dbd", "simulate", *SMALL, "--messages", "block", "--snr", "25"])
    told = answer(capsys, "dbd", "solve", "overlaid.nc", "--unknown-noise")
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
    ("options", "told"),
    [
        (("--out", "overlaid.nc", "--overwrite"), "which is the input"),
        (("--figure", "planes.doc"), "planes.doc"),
        (("--method", "cvxpy", "--solver", "FOO"), "solver: found 'FOO'"),
        (("--weights", "1"), "weights: found 1 numbers, expected one for each of 2"),
    ],
)
def test_a_solution_that_could_not_be_kept_is_not_begun(capsys, tmp_path, options, told):
    main(["dbd", "simulate", *SMALL])
    before = (tmp_path / "overlaid.nc").read_bytes()
    assert told in refused(capsys, "dbd", "solve", "overlaid.nc", *options)
    assert (tmp_path / "overlaid.nc").read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["overlaid.nc"]


def test_a_page_that_could_not_be_kept_is_not_begun(capsys, tmp_path):
    (tmp_path / "dbd_cost.png").write_bytes(b"mine")
    assert "dbd_cost.png" in refused(capsys, "dbd", "report")
    assert [file.name for file in tmp_path.iterdir()] == ["dbd_cost.png"]


@pytest.mark.slow
def test_a_scene_is_told_in_metres_with_bounds(capsys, tmp_path):
    (tmp_path / "mine.yaml").write_text(
        "targets: [{range_m: 0, velocity_m_s: 10, gain: 0.8+0.2j, angle_deg: 30}]\n"
        "paths: [{length_m: 90, velocity_m_s: -5}]\npulses: 5\nsubspace: 2\nantennas: 3\nsnr_db: 25\n"
    )
    main(["dbd", "simulate", "--scenario", "mine.yaml"])
    told = answer(capsys, "dbd", "solve", "overlaid.nc")
    radar, link = told["sources"]["radar"][0], told["sources"]["communications"][0]
    for found, name, true in (
        (radar, "range_m", 0), (radar, "velocity_m_s", 10), (radar, "angle_deg", 30),
        (link, "length_m", 90), (link, "velocity_m_s", -5), (link, "angle_deg", 0),
    ):  # fmt: skip
        assert abs(found[name] - true) < 5 * found[f"{name}_bound"] < 5
    printed = said(capsys, "dbd", "solve", "overlaid.nc", "--out", "again.nc")
    assert "radar: 1 path, there and back\n" in printed
    assert all(heading in printed for heading in ("range, m", "length, m", "velocity, m/s", "angle, degrees"))
