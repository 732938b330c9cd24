"""Downloads, unpacked or not, as one tree of files to search.

A source is a folder, or an archive (zip, tar) that is unpacked into a working folder first. An archive that is cut
short or damaged is refused, and so is one with an entry that points outside the folder it is unpacked into.
Files are searched for by name at any depth, because the outer folders of data sets differ from mirror to mirror.
"""

from __future__ import annotations

import lzma
import os
import re
import shutil
import stat
import tarfile
import zipfile
import zlib
from collections.abc import Iterable
from pathlib import Path, PurePosixPath, PureWindowsPath

from acp_lab.errors import InputFileError

_TAR_NAMES = (".tar", ".tar.gz", ".tgz", ".tar.bz2", ".tar.xz")
_AGAIN = "download it again"
_IMAGE_FOLDERS = frozenset(("rgb", "gray", "depth", "mask", "mask_visib", "frames"))


class Source:
    """The files below some folders. Folders of images are not entered: they hold tens of thousands of files."""

    def __init__(self, folders: Iterable[Path]) -> None:
        self.folders = tuple(folders)

    @property
    def name(self) -> str:
        """For messages."""
        return ", ".join(str(folder) for folder in self.folders)

    def files(self, pattern: str) -> list[Path]:
        """Files whose name matches a regular expression, whatever the case, in natural order of their paths."""
        wanted = re.compile(pattern, re.IGNORECASE)
        found = []
        for root in self.folders:
            for folder, inner, names in os.walk(root):
                inner[:] = [name for name in inner if name not in _IMAGE_FOLDERS and not name.startswith(".")]
                found += [Path(folder) / name for name in names if wanted.fullmatch(name)]
        return sorted(found, key=natural)

    def one(self, pattern: str, missing: str) -> Path:
        """The only file of that name; InputFileError saying `missing` when there is none, or naming two of them."""
        found = self.files(pattern)
        if not found:
            raise InputFileError(f"{self.name}: {missing}")
        if len(found) > 1:
            raise InputFileError(f"{self.name}: holds {found[0]} and {found[1]}: give the folder of one of them")
        return found[0]


def open_sources(paths: Iterable[Path], work: Path) -> Source:
    """Folders as they are, archives unpacked into `work`.

    Raises InputFileError for a path that is missing, an archive that is damaged, cut short, too large for the disk
    or has entries that point outside, and a file that is not an archive.
    """
    folders = []
    for number, path in enumerate(paths):
        if path.is_dir():
            folders.append(path)
        elif path.is_file():
            folders.append(work / f"source{number}")
            unpack(path, folders[-1])
        else:
            raise InputFileError(f"{path}: no such file or folder: give the download, unpacked or as an archive")
    return Source(folders)


def unpack(archive: Path, folder: Path) -> None:
    """Unpack a zip or tar file into a new folder; errors as in `open_sources`."""
    name = archive.name.lower()
    if re.search(r"\.(z\d\d|zip\.\d+|7z|rar)$", name):
        raise InputFileError(f"{archive}: cannot be unpacked here: unpack it with 7z x, and give the folder")
    if not name.endswith((".zip", *_TAR_NAMES)):
        raise InputFileError(f"{archive}: no archive (zip, tar): give the download, unpacked or as an archive")
    folder.mkdir(parents=True)
    try:
        if name.endswith(".zip"):
            _unpack_zip(archive, folder)
        else:
            _unpack_tar(archive, folder)
    # What their parsers raise for damaged files.
    except (
        zipfile.BadZipFile, tarfile.TarError, zlib.error, lzma.LZMAError, EOFError, ValueError, NotImplementedError,
    ) as error:  # fmt: skip
        raise InputFileError(f"{archive}: damaged or cut short ({error}): {_AGAIN}") from None
    except OSError as error:
        if error.strerror:
            raise
        raise InputFileError(f"{archive}: damaged or cut short ({error}): {_AGAIN}") from None


def natural(path: Path) -> list[str | int]:
    """Key that sorts scene2 before scene10: text and numbers alternate, so equal places hold equal types."""
    return [int(part) if i % 2 else part for i, part in enumerate(re.split("([0-9]+)", str(path).lower()))]


def _unpack_zip(archive: Path, folder: Path) -> None:
    with zipfile.ZipFile(archive) as file:
        entries = file.infolist()
        _check_space(archive, sum(entry.file_size for entry in entries), folder)
        for entry in entries:
            _check_inside(archive, entry.filename)
            if stat.S_ISLNK(entry.external_attr >> 16):
                raise InputFileError(f"{archive}: entry {entry.filename} is a link: {_AGAIN} from its authors")
            if entry.flag_bits & 1:
                raise InputFileError(f"{archive}: is encrypted: unpack it yourself, and give the folder")
        file.extractall(folder)  # checks each file's checksum on the way


def _unpack_tar(archive: Path, folder: Path) -> None:
    with tarfile.open(archive) as file:
        entries = file.getmembers()
        _check_space(archive, sum(entry.size for entry in entries), folder)
        for entry in entries:
            _check_inside(archive, entry.name)
            if not (entry.isfile() or entry.isdir()):
                raise InputFileError(f"{archive}: entry {entry.name} is no plain file: {_AGAIN} from its authors")
        file.extractall(folder, filter="data")
        # To the very end: the checksum of a compressed file follows the last entry.
        while file.fileobj is not None and file.fileobj.read(1 << 20):
            pass


def _check_inside(archive: Path, name: str) -> None:
    windows = PureWindowsPath(name)
    parts = {*PurePosixPath(name).parts, *windows.parts}
    if name.startswith("/") or windows.drive or windows.root or ".." in parts:
        raise InputFileError(f"{archive}: entry {name} points outside the folder: {_AGAIN} from its authors")


def _check_space(archive: Path, needed: int, folder: Path) -> None:
    free = shutil.disk_usage(folder).free
    if needed > free:
        raise InputFileError(
            f"{archive}: needs {needed / 1e9:.1f} GB unpacked, {free / 1e9:.1f} GB are free: choose another --out"
        )
