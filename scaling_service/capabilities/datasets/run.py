"""Public recordings into a folder, ready to be used: download, check, convert, write all or nothing."""

from __future__ import annotations

import csv
import io
import shlex
import shutil
from dataclasses import dataclass
from pathlib import Path

from scaling_service.capabilities.datasets import catalogue, downloads
from scaling_service.core import errors
from scaling_service.core.progress import Progress
from scaling_service.documents import writing
from scaling_service.files.image_markers import COLUMNS
from scaling_service.files.osim.setups import parse_xml

_MB = 1e6

_MM = 1e3


@dataclass(frozen=True, slots=True)
class Obtained:
    """What a download left."""

    folder: Path
    written: tuple[str, ...]  # files that this run wrote, relative to the folder
    kept: tuple[str, ...]  # files that were there already, with the right content


def get_dataset(
    name: str,
    dataset: catalogue.Dataset,
    folder: Path,
    *,
    cache: Path,
    base_url: str = catalogue.BASE_URL,
    progress: Progress | None = None,
) -> Obtained:
    """Download a dataset into a folder, with a subject file and a note of source and licence.

    A file that is there already with the right content is neither fetched nor written again; one that
    is there with another content is never replaced. Nothing is written unless everything is there.

    ``cache``: keeps downloads, so that a run that broke off goes on where it stopped. ``base_url``: what
    stands before ``/<owner>/<name>/<commit>/<path>``. ``progress``: of the bytes. DownloadFailed: a file
    cannot be had, or is not the published one. InputError: the folder or the cache cannot be used, or the
    folder holds a file of the same name that differs.
    """
    base = downloads.check_base_url(base_url)
    writing.check_folder(folder)
    subject = {} if dataset.subject is None else {catalogue.SUBJECT_FILE: dataset.subject + "\n"}
    texts = subject | {catalogue.SOURCE_FILE: write_source_note(name, dataset)}
    new = _list_missing(folder, texts)  # asked first: nothing is downloaded for a folder that is refused
    missing = [file for file in dataset.files if not _is_there(folder, file)]
    # File name in the dataset to its place in the cache
    total = sum(file.bytes for file in missing)
    done, fetched = 0, dict[str, Path]()
    for number, file in enumerate(missing, start=1):
        received = _report_received(progress, f"{file.saved_as} ({number} of {len(missing)}", done, total)
        received(0)
        url = downloads.make_remote_url(base, dataset.repository, dataset.commit, file.path)
        fetched[file.saved_as] = downloads.fetch(url, file, cache / name, received)
        done += file.bytes
    # The image markers of a dataset that has them inside a model.
    source = dataset.image_markers_from
    markers = (
        {}
        if source is None
        else {catalogue.IMAGE_MARKERS_FILE: tabulate_image_markers(fetched.get(source, folder / source))}
    )
    new |= _list_missing(folder, markers)
    if fetched or new:
        with writing.all_or_nothing(folder) as scratch:
            try:
                for path, cached in fetched.items():
                    (scratch / path).parent.mkdir(parents=True, exist_ok=True)
                    shutil.copyfile(cached, scratch / path)
                for path, content in new.items():
                    (scratch / path).write_bytes(content.encode())
            except OSError as error:
                raise errors.InputError(
                    f"the dataset cannot be written there: {error.strerror}",
                    file=folder,
                    field="--out",
                    remedy="Free some space, or name another folder",
                ) from None
    everything = (*(file.saved_as for file in dataset.files), *texts, *markers)
    written = tuple(path for path in everything if path in fetched or path in new)
    return Obtained(folder, written, tuple(path for path in everything if path not in written))


def list_next_commands(dataset: catalogue.Dataset, folder: Path) -> list[str]:
    """The commands to run now, as typed into a shell."""
    return [
        shlex.join(word.format(folder=folder) for word in ["scaling-service", *shlex.split(command)])
        for command in dataset.next
    ]


def _is_there(folder: Path, file: catalogue.RemoteFile) -> bool:
    place = folder / file.saved_as
    if downloads.has_hash(place, file.sha256):
        return True
    if place.exists():
        raise _report_difference(folder, file.saved_as)
    return False


def _report_received(progress: Progress | None, what: str, before: int, total: int) -> downloads.Received:
    """What a file's download reports to, counted over all files."""

    def report(size: int) -> None:
        if progress is not None:
            there = before + size
            progress(f"{what}, {there / _MB:.1f} of {total / _MB:.1f} MB)", there / total)

    return report


def _list_missing(folder: Path, texts: dict[str, str]) -> dict[str, str]:
    """Those that the folder does not hold; one that differs is an error, for a user may have edited it."""
    for path, content in texts.items():
        place = folder / path
        if place.exists() and not (place.is_file() and place.read_bytes() == content.encode()):
            raise _report_difference(folder, path)
    return {path: content for path, content in texts.items() if not (folder / path).exists()}


def _report_difference(folder: Path, name: str) -> errors.InputError:
    return errors.InputError(
        f"'{name}' is there already, and differs from the dataset's; it was left as it is",
        file=folder,
        field="--out",
        remedy="Move it away, or name another folder",
    )


def tabulate_image_markers(model: Path) -> str:
    """The table of image markers, from a model that was made in the image.

    Where each body of a model has the image's origin and axes, as in models from NMSBuilder or STAPLE,
    a marker's place on its body is its place in the image.

    ``model``: an ``.osim`` file of OpenSim 4, positions in m. Returns CSV with the columns
    ``marker,segment,x_mm,y_mm,z_mm``. Raises FileUnreadable: it holds no markers, or one without a place.
    """
    rows = []
    for marker in parse_xml(model).iter("Marker"):
        name = marker.get("name", "")
        segment = (marker.findtext("socket_parent_frame") or "").strip().rpartition("/")[2]
        try:
            x, y, z = (float(word) for word in (marker.findtext("location") or "").split())
        except ValueError:
            raise errors.FileUnreadable(
                "the marker has no place", file=model, field=name, remedy="Report this: it should"
            ) from None
        # 0.1 µm, as results are written; the model itself states no more than six digits.
        rows.append((name, segment, *(f"{_MM * value:.4f}" for value in (x, y, z))))
    if not rows:
        raise errors.FileUnreadable("the model holds no markers", file=model, remedy="Report this: it should")
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(COLUMNS)
    table.writerows(rows)
    return text.getvalue()


def write_source_note(name: str, dataset: catalogue.Dataset) -> str:
    """``SOURCE.md``: where everything is from, on what terms, and what was made here."""
    made = []
    if dataset.subject is not None:
        made.append(f"- `{catalogue.SUBJECT_FILE}`: the subject file")
    if dataset.image_markers_from is not None:
        made.append(
            f"- `{catalogue.IMAGE_MARKERS_FILE}`: the markers of `{dataset.image_markers_from}`, "
            "whose bodies have the image's axes, in mm"
        )
    files = [f"| `{f.saved_as}` | `{f.path}` | {f.bytes} | `{f.sha256}` |" for f in dataset.files]
    paragraphs = [
        f"# {name}: {dataset.title}",
        f"Source: https://github.com/{dataset.repository}, commit {dataset.commit}",
        f"Licence: {describe_terms(dataset)}",
        *([dataset.licence.note] if dataset.licence.note else []),
        "Please cite:",
        "\n".join(f"- {reference}" for reference in dataset.cite),
        dataset.about,
        "\n".join(["| file | in the repository | bytes | SHA-256 |", "|---|---|---|---|", *files]),
        "These are unchanged copies. Made by scaling-service, not part of the source:",
        "\n".join([*made, "- this note"]),
    ]
    return "\n\n".join(paragraphs) + "\n"


def describe_terms(dataset: catalogue.Dataset) -> str:
    """The licence in one line, with a note on commercial use where it is excluded."""
    return dataset.licence.name + (" (NON-COMMERCIAL USE ONLY)" if dataset.licence.non_commercial else "")
