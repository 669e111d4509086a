"""What files say of themselves: strict, finite, and one line that names the entry."""

import numpy as np
import pytest
from pydantic import BaseModel, ConfigDict, Field, Json, ValidationError

from tmca.attributes import Attributes, FiniteJson, attributes_of, json_of, read_json, unknown_name
from tmca.errors import DataError


class Stated(Attributes):
    size: Json[tuple[int, int]]
    full_scale: float = Field(gt=0)
    about: Json[FiniteJson] = None


GOOD = {"size": "[3, 4]", "full_scale": np.float64(3), "unknown": object()}


def test_attributes_come_back_in_their_types():
    assert attributes_of(Stated, GOOD, "f.nc") == Stated(size="[3, 4]", full_scale=3.0)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("full_scale", np.float32("nan"), "a finite number"),
        ("full_scale", -1, "above 0"),
        ("full_scale", "3", "a number"),
        ("full_scale", True, "a number"),
        ("full_scale", np.zeros(3), "a number"),
        ("full_scale", b"\xff", "no text"),
        ("size", "[3, 4", "JSON"),
        ("size", 3, "JSON"),
        ("size", "[1, 1.5]", "a whole number"),
        ("size", "[1, 1, 1]", "at most 2 values"),
        ("about", "[[NaN]]", "finite"),
        ("about", "[" * 100_000, "JSON"),
    ],
)
def test_odd_attributes_are_one_line(name, value, words):
    with pytest.raises(DataError, match=words) as raised:
        attributes_of(Stated, GOOD | {name: value}, "f.nc")
    assert str(raised.value).startswith("f.nc: found")
    assert len(str(raised.value)) < 250


def test_a_missing_attribute_is_named():
    with pytest.raises(DataError, match="no attribute size"):
        attributes_of(Stated, {"full_scale": 1}, "f.nc")


@pytest.mark.parametrize("text", ["[1", "NaN", "[1e999]", b"\xff", "", '{"a": -Infinity}'])
def test_json_is_whole_and_finite(text):
    with pytest.raises(DataError, match=r"^f\.json: found"):
        json_of(text, "f.json")


def test_json_files_are_read_with_or_without_a_byte_order_mark(tmp_path):
    (tmp_path / "a.json").write_bytes(b'\xef\xbb\xbf{"a": [1, null]}')
    assert read_json(tmp_path / "a.json") == {"a": [1, None]}
    with pytest.raises(DataError, match="no such file"):
        read_json(tmp_path / "b.json")


class _Inner(BaseModel):
    model_config = ConfigDict(extra="forbid")
    file: str = ""
    kind: str = ""


class _Outer(BaseModel):
    model_config = ConfigDict(extra="forbid")
    codes: dict[str, _Inner] = {}
    steps: list[_Inner] = []
    one: _Inner | None = None
    page: str = ""
    sizes: dict[str, int] = {}


@pytest.mark.parametrize(
    ("values", "place"),
    [({"codes": {"a": {"fil": ""}}}, "codes.a.fil"), ({"steps": [{}, {"fil": ""}]}, "steps.1.fil"),
     ({"one": {"fil": ""}}, "one.fil")],
)  # fmt: skip
def test_unknown_names_get_the_names_of_their_place(values, place):
    with pytest.raises(ValidationError) as raised:
        _Outer.model_validate(values)
    assert unknown_name(raised.value, _Outer) == (place, "an unknown name", "one of file, kind", "did you mean file?")
