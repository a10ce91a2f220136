"""``study.json`` of Puchaud 2019 done again: the paper's numbers beside ours, and the tables of both."""

from __future__ import annotations

from collections import abc
from functools import cache
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from pydantic import Field

from scaling_service.capabilities.cohort import result as documents
from scaling_service.capabilities.cohort.words import describe_quantity
from scaling_service.core.text import format_p
from scaling_service.documents import base
from scaling_service.model import reference
from scaling_service.report import tables
from scaling_service.report.summary import Summary
from scaling_service.studies import claims

METHODS = ("MB", "MB_lam", "MB_am", "EB", "EB_am")
"""The five models, in the order of the paper's figures."""

LENGTHS = ("femur_r", "femur_l", "inter_hip", "shank_r", "shank_l")
"""The rows of table 2."""

AXES = ("r_x", "r_y", "l_x", "l_y")
"""Turns of the knee axes, as in table 3."""

SAME_LENGTHS: abc.Mapping[str, str] = {"MB_am": "MB", "EB_am": "EB"}
"""Methods that keep the lengths of their first guess share its column in table 2."""


class Beside(base.Part):
    """One cell of a table of the paper beside ours; mean and standard deviation over subjects."""

    quantity: str
    method: str
    paper_mean: base.Rounded | None = Field(description="Null where the paper gives none.")
    paper_sd: base.Rounded | None
    mean: base.Rounded
    sd: base.Rounded
    paper_stars: str = Field(default="", description="The paper's mark of a difference from EB.")
    p_from_EB: float | None = Field(
        default=None, description="Ours, Tukey's HSD; null where it was not tested."
    )
    significant: bool | None = Field(default=None, description="After Friedman's test, at 5 %.")


class Puchaud2019Document(claims.StudyDocument):
    """``study.json``."""

    study: Literal["puchaud2019"] = "puchaud2019"
    subjects: list[str]
    walkers: list[str] = Field(description="Whose gait alone the paper's number of walkers is.")
    segment_lengths_mm: list[Beside] = Field(description="Table 2.")
    knee_axis_deg: list[Beside] = Field(description="Table 3.")
    kinematic_error_mm: list[Beside] = Field(description="Table 5 and figure 5, on functional movements.")
    literature_error_mm: dict[str, float] = Field(description="Table 5: other studies.")
    length_difference_mm: list[Beside] = Field(description="Figure 4: method minus EB.")
    marker_shift_mm: list[Beside] = Field(description="Section 3.1.")
    statistics: documents.StatisticsDocument = Field(description="All subjects; joint angles are figure 6.")
    walkers_statistics: documents.StatisticsDocument
    slowest_subject_s: float

    @property
    def size(self) -> int:
        """How many virtual persons there are."""
        return len(self.subjects)


Spread = tuple[float, float]
"""Mean and standard deviation over subjects."""


@cache
def read_paper() -> abc.Mapping[str, Any]:
    """The paper's numbers as ``puchaud2019.yaml`` has them, read once."""
    return MappingProxyType(reference.read_reference(reference.find_reference_folder() / "puchaud2019.yaml"))


def compare_lengths(found: documents.StatisticsDocument) -> list[Beside]:
    """Table 2."""
    theirs = read_paper()["segment_lengths_mm"]
    stars = theirs["differs_from_EB"]
    return [
        _put_against_image(
            found.quantity("segment_lengths_mm", name),
            method,
            theirs[SAME_LENGTHS.get(method, method)][name],
            stars.get(method, {}).get(name, ""),
        )
        for name in LENGTHS
        for method in METHODS
    ]


def compare_knee_axes(found: documents.StatisticsDocument) -> list[Beside]:
    """Table 3."""
    return [
        _put_beside(found.quantity("knee_axis_deg", name), method, row[name])
        for method, row in read_paper()["knee_axis_deg"].items()
        for name in AXES
    ]


def compare_errors(found: documents.StatisticsDocument) -> list[Beside]:
    """Figure 5, of which table 5 repeats some means."""
    entry = found.quantity("kinematic_error_mm", "calibration")
    return [
        _put_against_image(entry, method, read_paper()["kinematic_error_mm"][method]) for method in METHODS
    ]


def compare_length_differences(found: documents.StatisticsDocument) -> list[Beside]:
    """Figure 4: method minus EB."""
    cells = []
    for method in ("MB", "MB_lam"):
        for name in LENGTHS:
            values = found.quantity("segment_lengths_mm", name).values
            gaps = np.array([of[method] - of["EB"] for of in values.values()])
            theirs = read_paper()["length_difference_mm"][method].get(name, (None, None))
            cells.append(
                Beside(
                    quantity=name,
                    method=method,
                    paper_mean=theirs[0],
                    paper_sd=theirs[1],
                    mean=float(gaps.mean()),
                    sd=float(gaps.std(ddof=1)),
                )
            )
    return cells


def compare_marker_shifts(found: documents.StatisticsDocument) -> list[Beside]:
    """Section 3.1. The paper's scatter is over coordinates, ours over subjects."""
    entry = found.quantity("marker_shift_mm", "mean_over_markers")
    return [_put_beside(entry, method, spread) for method, spread in read_paper()["marker_shift_mm"].items()]


def _put_beside(found: documents.QuantityEntry, method: str, theirs: Spread) -> Beside:
    return Beside(
        quantity=found.quantity,
        method=method,
        paper_mean=theirs[0],
        paper_sd=theirs[1],
        mean=found.mean[method],
        sd=found.sd[method],
    )


def _put_against_image(
    found: documents.QuantityEntry, method: str, theirs: Spread, stars: str = ""
) -> Beside:
    plain = _put_beside(found, method, theirs)
    if method == "EB" or found.friedman is None:
        return plain
    pair = found.friedman.pair(method, "EB")
    tested = {"paper_stars": stars, "p_from_EB": pair.p, "significant": pair.significant}
    return plain.model_copy(update=tested)


def summarise(document: Puchaud2019Document) -> Summary:
    """The study in short."""
    return claims.summarise_study("Puchaud et al. 2019", document, make_tables(document))


def make_tables(document: Puchaud2019Document) -> abc.Iterator[tables.Table]:
    """The paper's tables beside ours."""
    yield _tabulate_beside("Table 2: segment lengths, mm", document.segment_lengths_mm)
    yield _tabulate_beside("Table 3: knee axes, degrees", document.knee_axis_deg)
    literature = ", ".join(f"{who} {value:.1f}" for who, value in document.literature_error_mm.items())
    yield _tabulate_beside(
        "Table 5 and figure 5: kinematic error on hip and knee movements, mm",
        document.kinematic_error_mm,
        f"Others, as table 5 gives them: {literature} mm.",
    )
    yield _tabulate_beside("Marker shifts (section 3.1), mm", document.marker_shift_mm)


def _tabulate_beside(caption: str, cells: abc.Sequence[Beside], note: str = "") -> tables.Table:
    methods = list(dict.fromkeys(cell.method for cell in cells))
    rows: list[tables.Row] = []
    # Quantity to method to its cell
    found: dict[str, dict[str, Beside]] = {}
    for cell in cells:
        found.setdefault(cell.quantity, {})[cell.method] = cell
    for quantity, of in found.items():
        rows.append(
            tables.Row(f"{describe_quantity(quantity)}, paper", [_format_paper(of.get(m)) for m in methods])
        )
        rows.append(tables.Row("here", [_format_ours(of.get(m)) for m in methods]))
    said = "Mean ± SD over subjects. A star: differs from EB (Tukey's HSD after Friedman's test)."
    return tables.Table(caption=caption, columns=["", *methods], rows=rows, note=f"{said} {note}".strip())


def _format_paper(cell: Beside | None) -> str:
    if cell is None or cell.paper_mean is None:
        return "–"
    return f"{cell.paper_mean:.1f} ± {cell.paper_sd or 0.0:.1f}{cell.paper_stars}"


def _format_ours(cell: Beside | None) -> str:
    if cell is None:
        return "–"
    tested = f" (p {format_p(cell.p_from_EB)})" if cell.p_from_EB is not None and cell.significant else ""
    return f"{cell.mean:.1f} ± {cell.sd:.1f}{'*' if cell.significant else ''}{tested}"
