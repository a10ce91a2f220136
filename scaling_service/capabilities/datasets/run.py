"""Public recordings into a folder, ready to be used: download, check, convert, write all or nothing."""

from __future__ import annotations

import shlex
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from scaling_service.capabilities.datasets.document import (
    IMAGE_MARKERS_FILE,
    SOURCE_FILE,
    SUBJECT_FILE,
    Dataset,
    RemoteFile,
)
from scaling_service.capabilities.datasets.downloads import (
    BASE_URL,
    Received,
    check_base_url,
    fetch,
    has_hash,
    remote_url,
)
from scaling_service.capabilities.datasets.files import image_markers, source_note
from scaling_service.core.errors import InputError
from scaling_service.core.progress import Progress
from scaling_service.documents.writing import all_or_nothing, check_folder

_MB = 1e6


@dataclass(frozen=True, slots=True)
class Obtained:
    """What a download left.

    Parameters
    ----------
    folder : Path
    written : tuple of str
        Files that this run wrote, relative to the folder.
    kept : tuple of str
        Files that were there already, with the right content.
    """

    folder: Path
    written: tuple[str, ...]
    kept: tuple[str, ...]


def get_dataset(
    name: str,
    dataset: Dataset,
    folder: Path,
    *,
    cache: Path,
    base_url: str = BASE_URL,
    progress: Progress | None = None,
) -> Obtained:
    """Download a dataset into a folder, with a subject file and a note of source and licence.

    A file that is there already with the right content is neither fetched nor written again; one that
    is there with another content is never replaced. Nothing is written unless everything is there.

    Parameters
    ----------
    name : str
        Of the dataset.
    dataset : Dataset
    folder : Path
        Made if it does not exist.
    cache : Path
        Keeps downloads, so that a run that broke off goes on where it stopped.
    base_url : str
        What stands before ``/<owner>/<name>/<commit>/<path>``.
    progress : callable, optional
        Called with what is being fetched and the share of bytes that is there.

    Raises
    ------
    DownloadFailed
        A file cannot be had, or is not the published one.
    InputError
        The folder or the cache cannot be used, or the folder holds a file of the same name that differs.
    """
    base = check_base_url(base_url)
    check_folder(folder)
    texts = _texts(name, dataset)
    new = _not_there(folder, texts)  # asked first: nothing is downloaded for a folder that is refused
    missing = [file for file in dataset.files if not _is_there(folder, file)]
    fetched = _fetch_all(name, dataset, missing, cache, base, progress)
    markers = _markers(dataset, folder, fetched)
    new |= _not_there(folder, markers)
    if fetched or new:
        _write(folder, fetched, new)
    everything = (*(file.saved_as for file in dataset.files), *texts, *markers)
    written = tuple(path for path in everything if path in fetched or path in new)
    return Obtained(folder, written, tuple(path for path in everything if path not in written))


def next_commands(dataset: Dataset, folder: Path) -> list[str]:
    """The commands to run now, as typed into a shell."""
    return [
        shlex.join(word.format(folder=folder) for word in ["scaling-service", *shlex.split(command)])
        for command in dataset.next
    ]


def _is_there(folder: Path, file: RemoteFile) -> bool:
    place = folder / file.saved_as
    if has_hash(place, file.sha256):
        return True
    if place.exists():
        raise _differs(folder, file.saved_as)
    return False


def _fetch_all(
    name: str,
    dataset: Dataset,
    files: Sequence[RemoteFile],
    cache: Path,
    base: str,
    progress: Progress | None,
) -> dict[str, Path]:
    """File name in the dataset to its place in the cache."""
    total = sum(file.bytes for file in files)
    done, fetched = 0, dict[str, Path]()
    for number, file in enumerate(files, start=1):
        received = _told(progress, f"{file.saved_as} ({number} of {len(files)}", done, total)
        received(0)
        url = remote_url(base, dataset.repository, dataset.commit, file.path)
        fetched[file.saved_as] = fetch(url, file, cache / name, received)
        done += file.bytes
    return fetched


def _told(progress: Progress | None, what: str, before: int, total: int) -> Received:
    """What a file's download reports to, counted over all files."""

    def received(size: int) -> None:
        if progress is not None:
            there = before + size
            progress(f"{what}, {there / _MB:.1f} of {total / _MB:.1f} MB)", there / total)

    return received


def _texts(name: str, dataset: Dataset) -> dict[str, str]:
    """What is written beside the downloads and needs none of them."""
    subject = {} if dataset.subject is None else {SUBJECT_FILE: dataset.subject + "\n"}
    return subject | {SOURCE_FILE: source_note(name, dataset)}


def _markers(dataset: Dataset, folder: Path, fetched: dict[str, Path]) -> dict[str, str]:
    """The image markers of a dataset that has them inside a model."""
    source = dataset.image_markers_from
    return {} if source is None else {IMAGE_MARKERS_FILE: image_markers(fetched.get(source, folder / source))}


def _not_there(folder: Path, texts: dict[str, str]) -> dict[str, str]:
    """Those that the folder does not hold; one that differs is an error, for a user may have edited it."""
    for path, content in texts.items():
        place = folder / path
        if place.exists() and not (place.is_file() and place.read_bytes() == content.encode()):
            raise _differs(folder, path)
    return {path: content for path, content in texts.items() if not (folder / path).exists()}


def _differs(folder: Path, name: str) -> InputError:
    return InputError(
        f"'{name}' is there already, and differs from the dataset's; it was left as it is",
        file=folder,
        field="--out",
        remedy="Move it away, or name another folder",
    )


def _write(folder: Path, fetched: dict[str, Path], texts: dict[str, str]) -> None:
    with all_or_nothing(folder) as scratch:
        try:
            for path, source in fetched.items():
                (scratch / path).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(source, scratch / path)
            for path, content in texts.items():
                (scratch / path).write_bytes(content.encode())
        except OSError as error:
            raise InputError(
                f"the dataset cannot be written there: {error.strerror}",
                file=folder,
                field="--out",
                remedy="Free some space, or name another folder",
            ) from None
