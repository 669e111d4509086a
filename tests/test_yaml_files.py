"""YAML of people: a strict dialect, bounded, refused in one line with its place."""

import pytest

from tmca.errors import DataError
from tmca.yaml_files import read_yaml

BOMB = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{level}: &a{level} [{', '.join([f'*a{level - 1}'] * 9)}]\n" for level in range(1, 12)
)


def read(tmp_path, text):
    file = tmp_path / "settings.yaml"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_yaml(file, "settings")


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 1e-3),
        ("10e6", 10e6),
        ("1_000", 1000),
        ("010", 10),
        ("-3", -3),
        (".5", 0.5),
        ("1:30", "1:30"),
        ("2024-13-45", "2024-13-45"),
        ("0.3-1j", "0.3-1j"),
        ("[0.4, .inf]", [0.4, float("inf")]),
        ("yes", True),
        ("~", None),
        ("e3", "e3"),
        (".", "."),
    ],
)
def test_values_are_what_they_look_like(tmp_path, text, value):
    read_value = read(tmp_path, f"a: {text}")["a"]
    assert read_value == value
    assert type(read_value) is type(value)


def test_names_are_texts_and_files_may_begin_with_a_mark(tmp_path):
    assert read(tmp_path, "1: a\nno: b\n2024-01-01: c\n") == {"1": "a", "no": "b", "2024-01-01": "c"}
    assert read(tmp_path, b"\xef\xbb\xbfa: 1") == {"a": 1}


def test_anchors_and_merged_names_still_work(tmp_path):
    said = read(tmp_path, "x: &x {a: 1, b: 2}\ny: {<<: *x, b: 3}\nz: *x\n")
    assert said == {"x": {"a": 1, "b": 2}, "y": {"a": 1, "b": 3}, "z": {"a": 1, "b": 2}}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: 1\nb: 2\na: 3", "line 3, column 1: the name 'a' a second time"),
        ("a: {b: 1, b: 1}", "the name 'b' a second time"),
        ("a: &a [*a]", "an alias of what it stands in"),
        (BOMB, "more than 20000 values"),
        ("a: " + "[" * 3000, "more than 32 levels"),
        ("- " * 3000, "more than 32 levels"),
        ("a: .nan", "finite numbers"),
        ("a: 1e999", "finite numbers"),
        ("a: " + "9" * 5000, "a number of 5000 digits"),
        ("a: !!python/object/apply:os.system [ls]", "a tag"),
        ("a: !!int x", "a tag"),
        ("? [a]\n: 1", "a list or names in the place of a name"),
        ("a: 1".encode("utf-16"), "UTF-16"),
        ("a: ü".encode("latin-1"), "not UTF-8"),
        ("x" * (2**20 + 1), "at most 1 MB"),
        ("a: [1, 2", "line 1"),
        ("a: 1\n---\nb: 2", "another document"),
        ("a\x01: 1", "unacceptable character"),
        ("- 1", "a list"),
        ("", "nothing"),
    ],
)
def test_what_is_no_settings_is_refused_in_one_short_line(tmp_path, text, words):
    with pytest.raises(DataError, match=words) as refused:
        read(tmp_path, text)
    said = str(refused.value)
    assert "settings.yaml" in said
    assert "\n" not in said
    assert len(said) < 400


def test_folders_and_missing_files_are_told(tmp_path):
    with pytest.raises(DataError, match="a folder"):
        read_yaml(tmp_path, "settings")
    with pytest.raises(DataError, match="no such file"):
        read_yaml(tmp_path / "none.yaml", "settings")
