"""Progress where nobody watches: a line for each step, with the time that is left."""

from tmca.cli import progress


def test_lines_say_share_step_and_time_left(capsys, monkeypatch):
    now = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    with progress.progress_bar("prior p.nc") as told:
        for share, step, detail in ((0.0, "reading one", ""), (0.2, "reading two", ""), (0.6, "learning", "step 3")):
            told(share, step, detail)
            now[0] += 20
    assert capsys.readouterr().err.splitlines() == [
        "prior p.nc: 0% reading one",
        "prior p.nc: 20% reading two, 80 s left",
        "prior p.nc: 60% learning step 3, 27 s left",
    ]
