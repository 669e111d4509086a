"""Studies of one's own scenes from the command line: what a YAML would say, decoders of files, failures."""

import csv
import json
import shlex
import shutil

import numpy as np
import pytest
import yaml

from tests.cli.refusals import refused
from tmca.cameras import SpectralCamera
from tmca.cli import main
from tmca.cli.study import _described
from tmca.codes import write_codes
from tmca.data import label, label_light_field, read_dataset, write_dataset, write_light_field
from tmca.data.scenes import load_scene
from tmca.errors import DataError, SettingError
from tmca.evaluation import StudyResults
from tmca.evaluation.camera import evaluation_of
from tmca.evaluation.gains import over
from tmca.evaluation.own import own_study
from tmca.evaluation.own_codes import _code_names
from tmca.evaluation.own_sensors import read_sensors
from tmca.evaluation.plan import Plan
from tmca.evaluation.study import read_study
from tmca.evaluation.tables import latex_table, made_by
from tmca.lab.decoder_files import decoders_named
from tmca.plots.style import blank_figure

DECODERS = """
import torch
from tmca.decoders import Decoder

class Scaled(Decoder):
    def reconstruct(self, prepared, values, progress):
        return 0.1 * prepared.A_adjoint(values)

class Raises(Decoder):
    def reconstruct(self, prepared, values, progress):
        raise RuntimeError("no weights at hand")

class Narrow(Decoder):
    def reconstruct(self, prepared, values, progress):
        return values

class Picky(Decoder):
    def reconstruct(self, prepared, values, progress):
        if values.mean() > 1:
            raise RuntimeError("too bright")
        return 0.1 * prepared.A_adjoint(values)

class Unfinished(Decoder):
    def reconstruct(self, prepared, values, progress):
        return torch.full((len(values), *prepared.scene_shape), torch.nan)
"""


@pytest.fixture(scope="module")
def mug(tmp_path_factory):
    """The file of a scene."""
    scene = load_scene("coffee", bands=4, size=(26, 34)).to_dataset(name="radiance")
    return write_dataset(scene, tmp_path_factory.mktemp("scene") / "mug.nc")


@pytest.fixture
def here(mug, tmp_path, monkeypatch):
    """A folder with a scene, a sensor, decoders; the current one."""
    monkeypatch.chdir(tmp_path)
    shutil.copy(mug, tmp_path)
    (tmp_path / "sensor.yaml").write_text("full_well: 20000\nread_noise_electrons: 4\n")
    (tmp_path / "mine.py").write_text(DECODERS)
    return tmp_path


@pytest.fixture
def plain_pictures(monkeypatch):
    """Scenes are drawn as an empty figure, where what is drawn does not matter."""
    monkeypatch.setattr("tmca.evaluation.paper.scene_figure", lambda *_: blank_figure(1.0, 1.0))


def test_options_say_what_a_yaml_says(here, capsys):
    main(["study", "mug.nc", "--sensor", "sensor.yaml", "--crop", "20x24", "--codes", "cassi,two-bucket",
          "--decoders", "dagger", "--json"])  # fmt: skip
    found = json.loads(capsys.readouterr().out)
    described = {
        "camera": "spectral", "scenes": {"test": ["mug.nc"]}, "reading": {"bands": 4, "size": [20, 24]},
        "codes": {"cassi": {"camera": {"slots": 1, "aperture": "static", "shutter": "open"}},
                  "two-bucket": {"camera": {"slots": 4, "shutter": "balanced", "buckets": 2}}},
        "noises": {"sensor": {"full_well": 20000, "read_noise_electrons": 4}}, "decoders": ["dagger"], "figure": False,
    }  # fmt: skip
    (here / "same.yaml").write_text(yaml.safe_dump(described))
    main(["study", "same.yaml", "--json"])
    same = json.loads(capsys.readouterr().out)
    levels = [[(row["code"], row["psnr"]) for row in one["rows"]] for one in (found, same)]
    assert levels[0] == levels[1]
    written = {file.name for file in (here / "mug-study").iterdir()}
    assert written == {"cells", *(f"mug.{end}" for end in ("json", "csv", "md", "tex", "html", "pdf", "png"))}
    assert "mug.json" in refused(capsys, "study", "mug.nc", "--codes", "cassi", "--decoders", "dagger")
    assert (here / "mug-study" / "mug.pdf").read_bytes().startswith(b"%PDF")
    assert (here / "mug-study" / "mug.md").read_text().startswith("# mug: codes and decoders\n")
    page = (here / "mug-study" / "mug.html").read_text()
    assert "UIQI: universal image quality index, at most 1, higher is better" in page
    assert "the best code of several slots over the best of one slot" in page
    assert "without a test scene" not in page
    assert "2 codes and 1 decoder of a spectral camera" in page
    assert page.count("<th>UIQI</th>") == 2  # the table, and gains
    assert "seed by seed" not in page
    assert "searched codes" not in page
    written = (here / "mug-study" / "mug.tex").read_text()
    assert written.count(r"\\") == 3
    assert "two-bucket & least norm & " in written
    assert "seconds" not in written


@pytest.mark.slow
def test_bands_that_are_left_out_are_said_in_the_terminal_and_on_the_pages(here, plain_pictures, capsys):
    asked = ("study", "mug.nc", "--crop", "20x24", "--codes", "cassi", "--decoders", "dagger")
    main([*asked, "--bands", "2", "--out", "few"])
    told = "2 of 4 bands (--bands 4 for all)"
    assert f"\n{told}\n" in capsys.readouterr().out
    assert all(f"{told}." in (here / "few" / f"mug.{end}").read_text() for end in ("md", "html"))
    main([*asked, "--out", "all"])
    assert "bands" not in capsys.readouterr().out


@pytest.mark.parametrize(("command", "commit", "told"), [
    ("tmca study a", "0123", "Command: `tmca study a` at commit `0123`."),
    ("tmca study a", None, "Command: `tmca study a`."), ("", None, "Called from Python."),
])  # fmt: skip
def test_a_page_says_the_command_and_where_there_is_one_the_commit(command, commit, told):
    assert made_by({"command": command, "commit": commit}) == told


def test_decoders_that_fail_are_named_and_the_others_go_on(here, plain_pictures, capsys):
    named = ",".join(f"mine.py:{name}" for name in ("Scaled", "Raises", "Narrow", "Unfinished"))
    with pytest.raises(SystemExit):
        main(["study", "mug.nc", "--crop", "20x24", "--codes", "cassi", "--decoders", named])
    table, said = capsys.readouterr()
    assert "| cassi | Scaled |" in table
    assert "3 of 4 cells failed (mug · cassi · noise-free · Raises" in said
    assert "RuntimeError: no weights at hand" in said
    found = json.loads((here / "mug-study" / "mug.json").read_text())
    assert [row["decoder"] for row in found["rows"]] == ["Scaled"]
    reasons = {name.split(" · ")[3]: reason for name, reason in found["failed"].items()}
    mine = here / "mine.py"
    assert reasons["Raises"].startswith(f"decoder: found Raises of {mine}, which fails with RuntimeError: no weights")
    assert reasons["Raises"].count("Raises") == 1
    assert f"shape (1, 1, 20, 27) from Narrow of {mine}" in reasons["Narrow"]
    assert f"an estimate of Unfinished of {mine} with NaN or infinite values: 1920 of 1920" in reasons["Unfinished"]
    assert "no weights at hand" in (here / "mug-study" / "mug.html").read_text()
    with pytest.raises(SystemExit):
        main(["study", "mug.nc", "--crop", "20x24", "--codes", "cassi", "--decoders", "mine.py:Scaled"])
    assert "results of another study (other decoders" in capsys.readouterr().err
    mended = DECODERS.replace('raise RuntimeError("no weights at hand")', "return 0.1 * prepared.A_adjoint(values)")
    (here / "mine.py").write_text(mended)
    with pytest.raises(SystemExit):
        main(["study", "mug.nc", "--crop", "20x24", "--codes", "cassi", "--decoders", named])
    assert "2 of 4 cells failed (mug · cassi · noise-free · Narrow" in capsys.readouterr().err


def test_a_row_that_lacks_scenes_says_so_everywhere(here, capsys):
    scene = read_dataset("mug.nc", ())
    write_dataset(scene.assign(radiance=0 * scene["radiance"] + 0.9), here / "white.nc")
    with pytest.raises(SystemExit):
        main(["study", "mug.nc", "white.nc", "--crop", "20x24", "--codes", "cassi", "--seeds", "2",
              "--decoders", "mine.py:Scaled,mine.py:Picky"])  # fmt: skip
    told = capsys.readouterr().out
    assert "| cassi | Picky | 1 of 2 scenes |" in told
    assert "| cassi | Scaled |  |" in told
    results = here / "mug-study"
    table = {row["decoder"]: row for row in csv.DictReader((results / "mug.csv").open())}
    assert (table["Picky"]["measured"], table["Scaled"]["measured"]) == ("1 of 2 scenes", "")
    assert "1 of 2 scenes" in (results / "mug.html").read_text()
    assert "PSNR (dB) white" in (results / "mug.md").read_text()
    found = StudyResults(json.loads((results / "mug.json").read_text()), ("psnr", "PSNR (dB)", ".2f"))
    assert any("1 of 2 scenes" in label.get_text() for label in found.plot().axes[0].get_yticklabels())


def test_rows_are_compared_on_the_scenes_that_both_have():
    study = own_study(["coffee"], codes=["cassi"], decoders=["dagger"], crop=(20, 24))
    one = {"scenes": {"a": {"psnr": 30.0}, "b": {"psnr": 10.0}}, "seed_psnr": [20.0]}
    other = {"scenes": {"a": {"psnr": 28.0}}, "seed_psnr": [28.0], "measured": "1 of 2 scenes"}
    gained = over(one, other, ["a", "b"], study)
    assert (gained["gain"], gained["seeds"], gained["scenes"]) == (2.0, "", "a +2.00")


def test_code_in_a_file_runs_only_where_the_command_line_names_it_too(here, capsys):
    described = {"camera": "spectral", "scenes": {"test": ["mug.nc"]}, "reading": {"bands": 4, "size": [20, 24]},
                 "codes": {"a": {"camera": {"slots": 1, "shutter": "open"}}}, "noises": {"none": {}},
                 "decoders": ["dagger", "ran.py:Ran"]}  # fmt: skip
    (here / "ran.py").write_text(f"open('ran.txt', 'w').close()\n{DECODERS.replace('Scaled', 'Ran')}\n")
    (here / "theirs.yaml").write_text(yaml.safe_dump(described))
    said = refused(capsys, "study", "theirs.yaml")
    assert "ran.py:Ran, which is code" in said
    assert not (here / "ran.txt").exists()
    main(["study", "theirs.yaml", "--decoders", "ran.py:Ran", "--json"])
    assert {row["decoder"] for row in json.loads(capsys.readouterr().out)["rows"]} == {"dagger", "Ran"}
    assert (here / "ran.txt").exists()


def test_the_remedy_of_code_in_a_file_works_when_it_is_pasted(here, capsys):
    described = {"camera": "spectral", "scenes": {"test": ["mug.nc"]}, "reading": {"bands": 4, "size": [20, 24]},
                 "codes": {"a": {"camera": {"slots": 1, "shutter": "open"}}}, "noises": {"none": {}},
                 "decoders": ["mine.py:Scaled", "it's/mine.py:Scaled", "half.pt2"],
                 "options": {"mine.py:Scaled": {}}}  # fmt: skip
    (here / "it's").mkdir()
    (here / "it's" / "mine.py").write_text(DECODERS)
    (here / "theirs.yaml").write_text(yaml.safe_dump(described))
    said = refused(capsys, "study", "theirs.yaml")
    assert "half.pt2, which are code" in said
    pasted = shlex.split(said.partition("; pass ")[2].partition(" if you trust them")[0])
    assert pasted == ["--decoders", "mine.py:Scaled,it's/mine.py:Scaled,half.pt2"]
    asked = _described("theirs.yaml", "./mine.py:Scaled,it's/mine.py:Scaled", None, {})
    assert asked.decoders[1:] == ("it's-mine-Scaled", "half.pt2")
    assert asked.decoders[0] in asked.options


def test_classes_of_one_name_from_two_files_have_names_of_their_own(here, plain_pictures, capsys):
    (here / "twice.py").write_text(DECODERS.replace("0.1", "0.2"))
    named = "mine.py:Scaled,twice.py:Scaled"
    main(["study", "mug.nc", "--crop", "20x24", "--codes", "cassi", "--decoders", named, "--json"])
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert [row["decoder"] for row in rows] == ["mine-Scaled", "twice-Scaled"]
    assert rows[0]["psnr"] != rows[1]["psnr"]
    assert decoders_named("twice.py:Scaled") == ["Scaled"]
    assert "each decoder once" in refused(capsys, "study", "mug.nc", "--decoders", "mine.py:Scaled,./mine.py:Scaled")


def test_codes_of_a_snapshot_are_those_it_was_taken_with(here, capsys):
    main(["simulate", "spectral", "mug.nc", "--all-bands", "--slots", "2", "--seed", "5", "--crop", "20x24",
          "--out", "taken.nc", "--no-figures"])  # fmt: skip
    capsys.readouterr()
    study = own_study(["mug.nc"], codes=["taken.nc"], crop=(20, 24))
    evaluation, code = study.evaluation, study.codes["taken"].file
    shown = evaluation.build({"bands": 4, "size": (20, 24)}, {}, {}, code)
    stored = read_dataset("taken.nc", ())
    assert (shown.codes.aperture.tile().numpy() == stored["aperture"].values).all()
    larger = evaluation.build({"bands": 4, "size": (26, 34)}, {}, {}, code)
    assert larger.size == (26, 34)


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ({"codes": ["cassy"]}, "did you mean cassi"),
        ({"codes": ["cassi", "cassi"]}, "cassi twice"),
        ({"codes": ["none.nc"]}, "none.nc"),
        ({"camera": "pinhole"}, "pinhole"),
        ({"camera": "light-field", "bands": 4}, "none of a light-field camera"),
        ({"sensor": {"odd": {"hiss": 1}}}, "noises.odd"),
        ({"reading": {"views": 5}}, "views"),
    ],
)
def test_what_makes_no_study_is_one_line(here, how, said):
    with pytest.raises((SettingError, DataError), match=said) as stop:
        own_study(["mug.nc"], **how)
    assert "\n" not in str(stop.value)


def test_sensors_of_a_file_are_one_or_several_by_name(here):
    assert read_sensors("sensor.yaml") == {"sensor": {"full_well": 20000, "read_noise_electrons": 4}}
    (here / "two.yaml").write_text("dim: {read_noise: 0.1}\nbright: {full_well: 1000, bits: 8}\n")
    assert read_sensors("two.yaml") == {"dim": {"read_noise": 0.1}, "bright": {"full_well": 1000, "bits": 8}}
    (here / "sheet.yaml").write_text("bits: 8\nexposure: 3\npattern_rate: 100\n")
    assert read_sensors("sheet.yaml") == {"sheet": {"bits": 8}}
    (here / "odd.yaml").write_text("full_wel: 3\n")
    with pytest.raises(DataError, match=r"odd.yaml: full_wel: .*; did you mean full_well\?"):
        read_sensors("odd.yaml")


@pytest.mark.parametrize(("scene", "learned"), [("coffee", set()), ("astronaut", {"astronaut"})])
def test_nothing_learns_from_a_measured_scene(scene, learned, tmp_path):
    study = own_study([scene], codes=["designed"], crop=(20, 24))
    plan = Plan(study, study.scenes.train, study.evaluation.places(study, {scene: scene}, [scene]), [], tmp_path)
    examples = next(cell for cell in plan.priors() if cell.prior_kind == "examples")
    rendered = set(study.evaluation.rendered()["train"])
    assert set(examples.scenes) == rendered - learned
    assert set(study.scenes.train) == (rendered - learned if learned else set())


def test_the_usual_codes_and_decoder_stand_in_for_those_not_named():
    study = own_study(["coffee"])
    assert list(study.codes) == ["cassi", "one-hot", "two-bucket"]
    assert study.decoders == ("lmmse",)
    depth = own_study(["motorcycle"], camera="spectral-depth", codes=["quick"])
    assert depth.decoders == ("likelihood",)
    assert "motorcycle" not in depth.scenes.train
    assert read_study("spectral").figure is False


def test_files_of_codes_of_one_name_are_told_apart_by_their_folders(here):
    names = _code_names(["a/codes.nc", "b/codes.nc", "cassi", "x/cassi.nc", "c/else.nc"])
    assert [*names.values()] == ["a/codes", "b/codes", "cassi", "x/cassi", "else"]
    with pytest.raises(SettingError, match="a/codes twice"):
        _code_names(["a/codes.nc", "b/a/codes.nc"])


def test_files_of_codes_may_be_given_names_and_say_that_they_are_a_burst(here):
    for preset in ("burst", "two-bucket"):
        settings = {**SpectralCamera.presets[preset], "bands": 4, "size": (20, 24), "period": 4}
        codes = SpectralCamera(**settings).codes
        planes = (codes.aperture.tile().detach(), codes.shutter.tile().detach())
        write_codes(f"{preset}-4.nc", *planes, (4, 4), buckets=2)
    asked = ["burst", "mine=burst-4.nc", "burst-4.nc", "two-bucket-4.nc", "other=two-bucket-4.nc"]
    study = own_study(["mug.nc"], codes=asked, decoders=["dagger"])
    assert [*study.codes] == ["burst", "mine (burst)", "burst-4", "two-bucket-4", "other"]
    assert [code.burst for code in study.codes.values()] == [True, True, True, False, False]
    assert study.codes["burst"].camera == {"slots": 2, "shutter": "burst", "buckets": 2}
    assert study.codes["mine (burst)"].file == "burst-4.nc"
    with pytest.raises(SettingError, match="mine twice"):
        own_study(["mug.nc"], codes=["mine=burst-4.nc", "mine=two-bucket-4.nc"], decoders=["dagger"])


@pytest.mark.parametrize(("repeated", "one_slot"), [(True, True), (False, False)])
def test_codes_of_a_file_that_do_not_change_have_one_slot(here, repeated, one_slot):
    codes = SpectralCamera(4, (20, 24), slots=1 if repeated else 3, period=4).codes
    planes = [plane.tile().detach().expand(3, -1, -1) for plane in (codes.aperture, codes.shutter)]
    write_codes("mine.nc", *planes, (4, 4))
    study = own_study(["mug.nc"], codes=["cassi", "mine.nc"], decoders=["dagger"])
    assert [code.one_slot for code in study.codes.values()] == [True, one_slot]


def test_scenes_that_leave_none_to_learn_from_are_refused_where_a_prior_needs_them():
    rendered = sorted(evaluation_of("spectral").rendered()["train"])
    with pytest.raises(SettingError, match="scenes: found all rendered scenes that priors learn from"):
        own_study(rendered, crop=(20, 24))
    assert own_study(rendered, crop=(20, 24), decoders=["dagger"]).scenes.train == ()


def test_a_sensor_file_without_an_entry_is_one_line(here):
    (here / "empty.yaml").write_text("{}")
    with pytest.raises(DataError, match=r"empty.yaml: found no entry"):
        read_sensors("empty.yaml")


def test_what_is_no_spectral_scene_is_one_line(here):
    write_light_field(label_light_field(np.ones((3, 3, 20, 24), np.float32)), "field.nc")
    with pytest.raises(DataError, match=r"field.nc: found a light field, expected a spectral scene"):
        own_study(["field.nc"], camera="spectral")


def other_bands(file, first, last, count):
    """The mug with bands of other wavelengths, nm."""
    values = np.random.default_rng(0).random((count, 26, 34), np.float32)
    cube = label(values, np.linspace(first, last, count) * 1e-9)
    write_dataset(cube.to_dataset(name="radiance"), file)


@pytest.mark.filterwarnings("always::tmca.data.in_memory.SceneWarning")
def test_cubes_beyond_the_visible_are_measured_over_the_range_that_all_cover(here, plain_pictures, capsys):
    other_bands("nir.nc", 700, 1000, 7)
    other_bands("far.nc", 800, 1100, 7)
    asked = ("study", "nir.nc", "far.nc", "--crop", "20x24", "--codes", "cassi", "--decoders", "dagger", "--json")
    main([*asked])
    told, said = capsys.readouterr()
    assert "bands from 800 to 1000 nm, which all scenes cover; --range FIRST:LAST" in said
    reading = json.loads(told)["study"]["reading"]
    assert (reading["bands"], reading["range"]) == (5, pytest.approx([8e-7, 1e-6]))
    assert "Bands from 800 to 1000 nm." in (here / "nir-study" / "nir.html").read_text()
    said = refused(capsys, *asked, "--range", "600:900", "--bands", "3", "--out", "x")
    assert "nir.nc: found bands from 700 to 1000 nm, expected bands that cover 600 to 900 nm" in said
    assert "found bands from 400 to 700 nm, expected some beyond the 800 nm" in refused(
        capsys, "study", "mug.nc", "far.nc", "--out", "x")  # fmt: skip


@pytest.mark.parametrize("given", ["400:1000", [400, 1000], [4e-7, 1e-6]])
def test_a_range_is_asked_for_in_nanometres(here, given):
    other_bands("wide.nc", 400, 1000, 13)
    study = own_study(["wide.nc"], codes=["cassi"], reading={"range": given})
    assert study.reading["range"] == pytest.approx([4e-7, 1e-6])
    assert study.reading["bands"] == 12
    assert study.decoders == ("admm-tv",)
    assert study.evaluation.load("wide.nc", study.reading)["wavelength_nm"].values[[0, -1]].tolist() == [400, 1000]
    assert own_study(["wide.nc"]).reading["range"] is None  # it covers the visible
    with pytest.raises(SettingError, match=r"decoders: found lmmse, expected none that learn from the rendered"):
        own_study(["wide.nc"], reading={"range": given}, decoders=["lmmse"])
    with pytest.raises(SettingError, match=r"codes: found designed"):
        own_study(["wide.nc"], reading={"range": given}, codes=["designed"])


@pytest.mark.filterwarnings("always::tmca.data.in_memory.SceneWarning")
def test_a_snapshot_of_such_a_cube_takes_the_range_that_it_covers(here, capsys):
    other_bands("nir.nc", 700, 1000, 7)
    main(["simulate", "spectral", "nir.nc", "--bands", "4", "--slots", "2", "--no-figures", "--out", "s.nc"])
    assert "bands from 700 to 1000 nm, which nir.nc covers" in capsys.readouterr().err
    assert (read_dataset("s.nc", ())["wavelength"].values * 1e9).tolist() == pytest.approx([700, 800, 900, 1000])


def test_a_table_for_latex_has_a_cell_for_every_entry_and_no_sign_that_latex_reads_otherwise():
    rows = [{"code": "a_b & 50 % {x}", "gain": -1.25}, {"code": r"c\d", "gain": None}]
    said = latex_table(rows, [("code", "code", ""), ("gain", "SAM (°)", "+.2f")])
    assert r"\begin{tabular}{lr}" in said
    assert r"code & SAM ($^\circ$) \\" in said
    assert r"a\_b \& 50 \% \{x\} & $-$1.25 \\" in said
    assert r"c\textbackslash{}d &  \\" in said
