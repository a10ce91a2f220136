"""What is written beside downloaded files: image markers, and the note of source and licence."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from pathlib import Path
from xml.etree.ElementTree import Element

from scaling_service.capabilities.datasets.document import IMAGE_MARKERS_FILE, SUBJECT_FILE, Dataset
from scaling_service.core.errors import FileUnreadable
from scaling_service.files.image_markers import COLUMNS
from scaling_service.files.osim.xml_file import parse_xml

_MM = 1e3


def image_markers(model: Path) -> str:
    """The table of image markers, from a model that was made in the image.

    Where each body of a model has the image's origin and axes, as in models from NMSBuilder or STAPLE,
    a marker's place on its body is its place in the image.

    ``model``: an ``.osim`` file of OpenSim 4, positions in m. Returns CSV with the columns
    ``marker,segment,x_mm,y_mm,z_mm``. Raises FileUnreadable: it holds no markers, or one without a place.
    """
    rows = [_row(marker, model) for marker in parse_xml(model).iter("Marker")]
    if not rows:
        raise FileUnreadable("the model holds no markers", file=model, remedy="Report this: it should")
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(COLUMNS)
    table.writerows(rows)
    return text.getvalue()


def _row(marker: Element, model: Path) -> tuple[str, ...]:
    name = marker.get("name", "")
    segment = (marker.findtext("socket_parent_frame") or "").strip().rpartition("/")[2]
    try:
        x, y, z = (float(word) for word in (marker.findtext("location") or "").split())
    except ValueError:
        raise FileUnreadable(
            "the marker has no place", file=model, field=name, remedy="Report this: it should"
        ) from None
    # 0.1 µm, as results are written; the model itself states no more than six digits.
    return name, segment, *(f"{_MM * value:.4f}" for value in (x, y, z))


def source_note(name: str, dataset: Dataset) -> str:
    """``SOURCE.md``: where everything is from, on what terms, and what was made here.

    ``name``: of the dataset.
    """
    return "\n".join([*_head(name, dataset), *_table(dataset), *_made_here(dataset)]) + "\n"


def terms(dataset: Dataset) -> str:
    """The licence in one line, commercial use told where it is excluded."""
    return dataset.licence.name + (" (NON-COMMERCIAL USE ONLY)" if dataset.licence.non_commercial else "")


def _head(name: str, dataset: Dataset) -> Iterator[str]:
    yield f"# {name}: {dataset.title}"
    yield ""
    yield f"Source: https://github.com/{dataset.repository}, commit {dataset.commit}"
    yield ""
    yield f"Licence: {terms(dataset)}"
    if dataset.licence.note:
        yield ""
        yield dataset.licence.note
    yield ""
    yield "Please cite:"
    yield ""
    yield from (f"- {reference}" for reference in dataset.cite)
    yield ""
    yield dataset.about
    yield ""


def _table(dataset: Dataset) -> Iterator[str]:
    yield "| file | in the repository | bytes | SHA-256 |"
    yield "|---|---|---|---|"
    for file in dataset.files:
        yield f"| `{file.saved_as}` | `{file.path}` | {file.bytes} | `{file.sha256}` |"


def _made_here(dataset: Dataset) -> Iterator[str]:
    yield ""
    yield "These are unchanged copies. Made by scaling-service, not part of the source:"
    yield ""
    if dataset.subject is not None:
        yield f"- `{SUBJECT_FILE}`: the subject file"
    if dataset.image_markers_from is not None:
        yield (
            f"- `{IMAGE_MARKERS_FILE}`: the markers of `{dataset.image_markers_from}`, "
            "whose bodies have the image's axes, in mm"
        )
    yield "- this note"
