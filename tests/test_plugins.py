"""A class of a file that is named on the command line: it is run, and what is wrong with it is one line."""

import re
import subprocess
import sys

import pytest

from tmca.decoders import Decoder
from tmca.errors import SettingError
from tmca.plugins import class_from_file, foreign_source, names_a_file

SOURCE = """
from __future__ import annotations
from dataclasses import dataclass
from tmca.decoders import Decoder

@dataclass
class Doubled(Decoder):
    gain: float = 2.0

    def reconstruct(self, prepared, values, progress):
        return self.gain * values

class Unfinished(Decoder):
    pass

class Lamp:
    pass
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(SOURCE)
    return path


def test_a_class_of_a_file_is_a_class_like_any_other(file):
    cls = class_from_file(f"{file}:Doubled", Decoder, "--decoder")
    assert issubclass(cls, Decoder)
    assert cls(gain=3.0).gain == 3
    assert sys.modules[cls.__module__].Doubled is cls
    assert class_from_file(f"{file}:Lamp", object, "--device").__name__ == "Lamp"


def test_a_file_runs_once_and_again_after_it_was_edited(file):
    first = class_from_file(f"{file}:Doubled", Decoder, "--decoder")
    assert class_from_file(f"{file}:Doubled", Decoder, "--decoder") is first
    said = foreign_source(first)
    file.write_text(SOURCE.replace("2.0", "4.0"))
    second = class_from_file(f"{file}:Doubled", Decoder, "--decoder")
    assert (first().gain, second().gain) == (2, 4)
    assert first.__module__ == second.__module__
    assert foreign_source(second) != said != ""


def test_it_imports_what_lies_beside_it_and_the_path_stays_as_it_was(file, tmp_path):
    (tmp_path / "vendor_of_mine.py").write_text("LEVEL = 7\n")
    (tmp_path / "json.py").write_text("raise RuntimeError('shadowed')\n")
    file.write_text("import json\nfrom vendor_of_mine import LEVEL\nclass Lamp:\n    level = LEVEL\n")
    before = list(sys.path)
    assert class_from_file(f"{file}:Lamp", object, "--device").level == 7
    assert sys.path == before
    sys.modules.pop("vendor_of_mine")


def test_files_of_two_folders_import_their_own_module_of_one_name(tmp_path):
    lamps = []
    for level in (3, 4):
        folder = tmp_path / str(level)
        folder.mkdir()
        (folder / "levels.py").write_text(f"LEVEL = {level}\n")
        (folder / "lamp.py").write_text("from levels import LEVEL\nclass Lamp:\n    level = LEVEL\n")
        lamps.append(class_from_file(f"{folder / 'lamp.py'}:Lamp", object, "--device"))
    assert [lamp.level for lamp in lamps] == [3, 4]


def test_packages_of_an_environment_below_the_folder_are_not_beside_a_file(file, tmp_path, monkeypatch):
    packages = tmp_path / ".venv" / "lib"
    packages.mkdir(parents=True)
    (packages / "installed_there.py").write_text("")
    (tmp_path / "beside_it.py").write_text("")
    monkeypatch.syspath_prepend(str(packages))
    file.write_text("import installed_there, beside_it\nclass Lamp:\n    pass\n")
    class_from_file(f"{file}:Lamp", object, "--device")
    (tmp_path / "other.py").write_text("class Lamp:\n    pass\n")
    class_from_file(f"{tmp_path / 'other.py'}:Lamp", object, "--device")
    assert {"installed_there", "beside_it"} & {*sys.modules} == {"installed_there"}
    sys.modules.pop("installed_there")


def test_the_script_that_names_files_beside_it_stays(tmp_path):
    for name in ("a", "b"):
        (tmp_path / f"{name}.py").write_text("class Lamp:\n    pass\n")
    load = "[class_from_file(f'{one}.py:Lamp', object, 'device') for one in 'ab']"
    code = f"import sys\nfrom tmca.plugins import class_from_file\n{load}\nprint('__main__' in sys.modules)\n"
    (tmp_path / "script.py").write_text(code)
    done = subprocess.run([sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True)
    assert done.stdout == "True\n", done.stderr


def test_an_edited_module_beside_a_file_makes_another_class(tmp_path):
    (tmp_path / "brightness.py").write_text("LEVEL = 3\n")
    (tmp_path / "lamp.py").write_text("from brightness import LEVEL\nclass Lamp:\n    level = LEVEL\n")
    first = class_from_file(f"{tmp_path / 'lamp.py'}:Lamp", object, "--device")
    before = foreign_source(first)
    (tmp_path / "brightness.py").write_text("LEVEL = 50\n")
    second = class_from_file(f"{tmp_path / 'lamp.py'}:Lamp", object, "--device")
    assert (first.level, second.level) == (3, 50)
    assert foreign_source(second) != before


@pytest.mark.parametrize(("text", "said"), [
    ("lmmse", "--decoder: found 'lmmse', expected FILE.py:Class"),
    ("{file}:", "--decoder: found '.*:', expected FILE.py:Class"),
    ("{file}:a b", "expected FILE.py:Class"),
    ("{folder}/none.py:Doubled", "none.py, which is no file, expected a Python file"),
    ("{file}:Dubled", "no class Dubled in .*expected a subclass of Decoder: Doubled, Unfinished; did you mean Doubled"),
    ("{file}:Lamp", "mine.py:Lamp, which is no Decoder, expected a subclass of Decoder: Doubled, Unfinished"),
    ("{file}:Unfinished", "mine.py:Unfinished without reconstruct"),
])  # fmt: skip
def test_what_is_no_class_of_a_file_is_one_line(file, text, said):
    with pytest.raises(SettingError, match=said) as refused:
        class_from_file(text.format(file=file, folder=file.parent), Decoder, "--decoder")
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(("source", "said"), [
    ("import no_such_vendor\n", r"ModuleNotFoundError: No module named 'no_such_vendor' \(line 1\)"),
    ("x = 1\n1 / 0\n", r"ZeroDivisionError: division by zero \(line 2\)"),
    ("def f(:\n", "SyntaxError: .*line 1"),
    ("raise SystemExit('bye')\n", "SystemExit: bye"),
])  # fmt: skip
def test_a_file_that_fails_says_where_and_leaves_no_module(tmp_path, source, said):
    path = tmp_path / "broken.py"
    path.write_text(source)
    before = {*sys.modules}
    with pytest.raises(SettingError, match=re.escape(str(path)) + f", which fails with {said}"):
        class_from_file(f"{path}:Lamp", object, "--device")
    assert not [name for name in {*sys.modules} - before if name.startswith("broken_")]
    path.write_text("class Lamp:\n    pass\n")
    assert class_from_file(f"{path}:Lamp", object, "--device").__name__ == "Lamp"


def test_a_name_is_told_from_a_class_of_a_file():
    assert [names_a_file(text) for text in ("lmmse", "a.py:B", "C:\\\\a.py:B", "a.py", "a.yaml:B")] == [
        False, True, True, False, False,
    ]  # fmt: skip
