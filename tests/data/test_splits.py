"""A split names exactly the files behind a result, and a missing or altered one is told."""

from __future__ import annotations

import hashlib
import subprocess

import pytest

from tmca.data import checksum_of, read_split, write_split
from tmca.errors import DataError, OutputError


@pytest.fixture
def root(tmp_path):
    """A data folder: two files, a CAVE folder, a manifest of all, and splits in a folder of their own."""
    files = ["hsi/a.mat", "hsi/b scene.mat", "cave/paints_ms/paints_ms_01.png", "cave/paints_ms/paints_ms_02.png"]
    files += ["rgbd/art_rgb.png", "rgbd/art_disp.png", "rgbd/art2_rgb.png"]
    lines = []
    for name in files:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(name.encode())
        lines.append(f"{hashlib.sha256(name.encode()).hexdigest()}  ./{name}\n")
    (tmp_path / "MANIFEST.sha256").write_text("".join(lines))
    (tmp_path / "splits").mkdir()
    return tmp_path


def split_of(root, text):
    (root / "splits" / "train.txt").write_text(text)
    return root / "splits" / "train.txt"


def test_a_split_is_verified_against_the_manifest(root):
    split = split_of(root, "# the train list\nhsi/a.mat\n\nhsi/b scene.mat\ncave/paints_ms/\nrgbd/art\n")
    expected = ["hsi/a.mat", "hsi/b scene.mat", "cave/paints_ms", "rgbd/art"]
    assert read_split(split) == [root / name for name in expected]


def test_a_scene_with_a_similar_name_is_not_part_of_an_entry(root):
    (root / "rgbd/art2_rgb.png").write_bytes(b"altered")
    assert read_split(split_of(root, "rgbd/art\n"))


def test_an_entry_in_no_list_only_has_to_exist(root):
    (root / "hsi/new.mat").write_bytes(b"x")
    assert read_split(split_of(root, "hsi/new.mat\n")) == [root / "hsi/new.mat"]
    with pytest.raises(DataError, match=r"hsi/other.mat: found no such file"):
        read_split(split_of(root, "hsi/other.mat\n"))


def test_rendered_scenes_may_be_named_and_files_of_their_name_go_first(root):
    split = split_of(root, "hsi/a.mat\nastronaut\ncoffee\ncoffee:1\n")
    assert [str(path) for path in read_split(split)] == [str(root / "hsi/a.mat"), "astronaut", "coffee", "coffee:1"]
    (root / "coffee").mkdir()
    assert read_split(split)[2] == root / "coffee"


@pytest.mark.parametrize("form", ["{sum}  {name}", "{sum} *{name}", "{name} {sum}", "{name}\t{sum}", "{sum}  ./{name}"])
def test_a_checksum_may_stand_before_or_after_the_path(root, form):
    checksum = hashlib.sha256(b"hsi/b scene.mat").hexdigest()
    split = split_of(root, form.format(sum=checksum, name="hsi/b scene.mat") + "\n")
    assert read_split(split) == [root / "hsi/b scene.mat"]
    split = split_of(root, form.format(sum="0" * 64, name="hsi/b scene.mat") + "\n")
    with pytest.raises(DataError, match=r"altered"):
        read_split(split)


def test_a_written_split_is_verified_without_a_manifest(root):
    (root / "MANIFEST.sha256").unlink()
    paths = [root / "hsi/a.mat", root / "cave/paints_ms"]
    split = write_split(paths, root / "train.txt")
    assert read_split(split) == paths
    (root / "cave/paints_ms/paints_ms_03.png").write_bytes(b"one more")
    with pytest.raises(DataError, match=r"paints_ms: found SHA-256"):
        read_split(split)


def test_a_written_split_of_files_passes_sha256sum(root):
    split = write_split([root / "hsi/a.mat", root / "hsi/b scene.mat"], root / "splits/train.txt", root)
    done = subprocess.run(["sha256sum", "-c", str(split)], cwd=root, capture_output=True, check=False)
    assert done.returncode == 0
    assert read_split(split) == [root / "hsi/a.mat", root / "hsi/b scene.mat"]


def test_a_folders_checksum_sees_names_and_contents(root):
    folder = root / "cave/paints_ms"
    before = checksum_of(folder)
    (folder / "paints_ms_01.png").rename(folder / "paints_ms_00.png")
    assert checksum_of(folder) != before


@pytest.mark.parametrize("altered", [True, False])
@pytest.mark.parametrize("file", ["hsi/a.mat", "cave/paints_ms/paints_ms_02.png", "rgbd/art_disp.png"])
def test_an_altered_or_missing_file_is_named(root, file, altered):
    split = split_of(root, "hsi/a.mat\ncave/paints_ms\nrgbd/art\n")
    (root / file).write_bytes(b"altered") if altered else (root / file).unlink()
    with pytest.raises(DataError, match="SHA-256" if altered else "no such file") as caught:
        read_split(split)
    assert caught.value.where == str(root / file)


@pytest.mark.parametrize("text", [b"", b"hsi/a.mat\n./hsi/a.mat\n", b"../x\n", b"/etc/passwd\n", b"\xff\xfe\x00", None])
def test_an_unusable_split_is_refused(root, text):
    if text is not None:
        (root / "splits/train.txt").write_bytes(text)
    with pytest.raises(DataError, match=r"train\.txt"):
        read_split(root / "splits/train.txt")


def test_the_refusal_of_a_path_outside_the_root_names_the_root(root):
    with pytest.raises(DataError, match=f"relative to the folder {root}, inside it"):
        read_split(split_of(root, "/etc/passwd\n"))


@pytest.mark.parametrize(
    ("paths", "split", "error"),
    [
        (["gone"], "s.txt", DataError), (["hsi/a.mat"], "splits/s.txt", DataError), ([], "s.txt", DataError),
        (["hsi/a.mat"], "MANIFEST.sha256", OutputError),
    ],
)  # fmt: skip
def test_writing_refuses_what_it_cannot_name(root, paths, split, error):
    with pytest.raises(error):
        write_split([root / path for path in paths], root / split)
