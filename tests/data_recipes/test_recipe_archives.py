"""Downloads: unpacked whole or not at all, never outside their folder."""

from __future__ import annotations

import io
import tarfile
import zipfile
from pathlib import Path

import numpy as np
import pytest

from acp_lab.errors import InputFileError
from data_recipes.archives import Source, natural, open_sources, unpack


def _zip(path: Path, names: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in names.items():
            file.writestr(name, content)
    return path


def _tar(path: Path, entries: list[tarfile.TarInfo]) -> Path:
    with tarfile.open(path, "w:gz") as file:
        for entry in entries:
            entry.size = 0 if entry.issym() or entry.islnk() else 3
            file.addfile(entry, io.BytesIO(b"abc"))
    return path


def test_archives_and_folders_become_one_tree(tmp_path: Path) -> None:
    folder = tmp_path / "plain"
    (folder / "scene2").mkdir(parents=True)
    (folder / "scene2" / "gt.yml").write_text("b")
    archive = _zip(tmp_path / "more.zip", {"deep/scene10/GT.yml": b"c", "deep/rgb/gt.yml": b"not looked into"})
    tar = _tar(tmp_path / "rest.tar.gz", [tarfile.TarInfo("scene1/gt.yml")])
    source = open_sources([folder, archive, tar], tmp_path / "work")
    assert sorted(path.parent.name for path in source.files(r"gt\.yml")) == ["scene1", "scene10", "scene2"]
    with pytest.raises(InputFileError, match="nothing here"):
        source.one(r"other\.yml", "nothing here: do this")
    with pytest.raises(InputFileError, match="give the folder of one of them"):
        source.one(r"gt\.yml", "")


def test_order_is_natural() -> None:
    names = ["scene10/a", "scene2/b", "Scene1/c"]
    assert sorted(map(Path, names), key=natural) == [Path("Scene1/c"), Path("scene2/b"), Path("scene10/a")]
    assert Source([]).files(".*") == []


@pytest.mark.parametrize("kept", [0.05, 0.5, 0.9, 0.999])
@pytest.mark.parametrize("suffix", [".zip", ".tar.gz"])
def test_half_a_download_is_refused(tmp_path: Path, suffix: str, kept: float) -> None:
    path = tmp_path / f"half{suffix}"
    if suffix == ".zip":
        _zip(path, {f"{i}.txt": bytes(range(256)) * 4 for i in range(20)})
    else:
        _tar(path, [tarfile.TarInfo(f"{i}.txt") for i in range(40)])
    data = path.read_bytes()
    path.write_bytes(data[: int(kept * len(data))])
    with pytest.raises(InputFileError, match=r"half.*damaged or cut short.*download it again"):
        unpack(path, tmp_path / "out")


def test_a_flipped_byte_in_a_zip_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "set.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as file:
        file.writestr("a.txt", b"x" * 400)
    data = bytearray(path.read_bytes())
    data[200] ^= 1
    path.write_bytes(data)
    with pytest.raises(InputFileError, match="damaged or cut short"):
        unpack(path, tmp_path / "out")


def test_damage_within_an_xz_archive_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "set.tar.xz"
    with tarfile.open(path, "w:xz") as file:
        entry = tarfile.TarInfo("a.bin")
        entry.size = 100_000
        file.addfile(entry, io.BytesIO(np.random.default_rng(0).bytes(entry.size)))
    data = bytearray(path.read_bytes())
    data[-40:-20] = bytes(20)
    path.write_bytes(data)
    with pytest.raises(InputFileError, match="damaged or cut short"):
        unpack(path, tmp_path / "out")


OUTSIDE = ["../evil.txt", "a/../../evil.txt", "/evil.txt", "C:\\evil.txt", "a\\..\\..\\evil.txt"]


@pytest.mark.parametrize("name", OUTSIDE)
def test_entries_outside_are_refused_and_nothing_is_written_there(tmp_path: Path, name: str) -> None:
    inner = tmp_path / "inner"
    inner.mkdir()
    archives = [
        _zip(inner / "set.zip", {"fine.txt": b"x", name: b"evil"}),
        _tar(inner / "set.tar.gz", [tarfile.TarInfo("fine.txt"), tarfile.TarInfo(name)]),
    ]
    for number, archive in enumerate(archives):
        with pytest.raises(InputFileError, match="points outside the folder"):
            unpack(archive, inner / f"out{number}")
    assert not (tmp_path / "evil.txt").exists()
    assert not Path("/evil.txt").exists()
    assert not list(inner.rglob("evil*"))


def test_links_are_refused(tmp_path: Path) -> None:
    link = zipfile.ZipInfo("link")
    link.external_attr = 0o120777 << 16
    with zipfile.ZipFile(tmp_path / "set.zip", "w") as file:
        file.writestr(link, "/etc/passwd")
    with pytest.raises(InputFileError, match="entry link is a link"):
        unpack(tmp_path / "set.zip", tmp_path / "out0")
    symbolic, hard = tarfile.TarInfo("link"), tarfile.TarInfo("link")
    symbolic.type, hard.type = tarfile.SYMTYPE, tarfile.LNKTYPE
    symbolic.linkname = hard.linkname = "../outside"
    for number, entry in enumerate((symbolic, hard), start=1):
        with pytest.raises(InputFileError, match="entry link is no plain file"):
            unpack(_tar(tmp_path / f"set{number}.tar.gz", [entry]), tmp_path / f"out{number}")


@pytest.mark.parametrize(
    ("name", "word"),
    [("set.z01", "7z x"), ("set.7z", "7z x"), ("notes.txt", "no archive"), ("missing.zip", "no such file")],
)
def test_what_is_no_archive(tmp_path: Path, name: str, word: str) -> None:
    if "missing" not in name:
        (tmp_path / name).write_bytes(b"x")
    with pytest.raises(InputFileError, match=word):
        open_sources([tmp_path / name], tmp_path / "work")


def test_more_than_the_disk_holds_is_refused_before_a_byte_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    archive = _zip(tmp_path / "set.zip", {"a.txt": b"x" * 5000})
    monkeypatch.setattr("data_recipes.archives.shutil.disk_usage", lambda _: type("Usage", (), {"free": 4000})())
    with pytest.raises(InputFileError, match=r"needs 0\.0 GB unpacked"):
        unpack(archive, tmp_path / "out")
    assert list((tmp_path / "out").iterdir()) == []
