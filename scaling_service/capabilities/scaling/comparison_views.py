"""Views of a comparison: errors, lengths or angles of all methods side by side, as a document and a table."""

from __future__ import annotations

import csv
import itertools
from collections import abc
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from scaling_service.core.arrays import Array
from scaling_service.documents import results as documents
from scaling_service.documents.base import Known, Part, Rounded
from scaling_service.documents.writing import write_json

if TYPE_CHECKING:
    from scaling_service.capabilities.scaling.result import Results

IMAGED = "EB"


class KinematicErrorComparison(documents.Provenance):
    """How closely each method's model follows the markers."""

    kinematic_error_mm: dict[str, dict[str, documents.TrialError]] = Field(
        description="Method to trial to error."
    )
    fitted_mean_mm: dict[str, float | None] = Field(description="Method to the mean over calibration trials.")
    held_out_mean_mm: dict[str, float | None] = Field(
        description="Method to the mean over evaluation trials."
    )
    warnings: list[str]


class SegmentLengthComparison(documents.Provenance):
    """The sizes of the methods' models."""

    segment_lengths_mm: dict[str, dict[str, float]] = Field(description="Method to segment to length.")
    joint_centres_mm: dict[str, dict[str, documents.JointCentre]] = Field(
        description="Method to joint to centre."
    )
    reference: str = Field(
        description="EB, whose lengths come from images, where it was done; else the first."
    )
    difference_mm: dict[str, dict[str, Rounded]] = Field(
        description="Every other method to segment to its length minus the reference's."
    )
    warnings: list[str]


class AngleDifference(Part):
    """Two methods' angle over the frames in which both know it, degrees; null where there are none."""

    methods: tuple[str, str]
    frames: int
    rms_deg: Known
    mean_deg: Known = Field(description="First minus second.")
    largest_deg: Known


class AngleEntry(Part):
    """A joint angle in one recording."""

    mean_deg: dict[str, Known] = Field(description="Method to the mean over frames.")
    range_deg: dict[str, Known] = Field(description="Method to largest minus smallest.")
    pairs: list[AngleDifference]


class CycleEntry(Part):
    """A joint angle over the gait cycle, 0 to 100 %."""

    cycles: int
    mean_deg: dict[str, list[float]]
    sd_deg: dict[str, list[float]]
    p: float | None = Field(description="Of an analysis of variance along the curve; null: not tested.")
    can_decide: bool = Field(description="False where there are too few cycles for 5 %.")
    differ_percent: list[tuple[float, float]] = Field(description="Stretches in which the methods differ.")


class GaitEntry(Part):
    """Joint angles over the gait cycles of this person."""

    trials: list[str]
    held_out: bool = Field(description="Whether none of these trials was fitted.")
    reason: str = Field(description="Why there are no cycles; empty where there are.")
    angles: dict[str, CycleEntry]


class JointAngleComparison(documents.Provenance):
    """The joint angles that the methods' models give in the same recordings."""

    joint_angles: dict[str, dict[str, AngleEntry]] = Field(description="Trial to joint angle.")
    gait: GaitEntry
    warnings: list[str]


Row = list[str | float | None]
View = KinematicErrorComparison | SegmentLengthComparison | JointAngleComparison


def view_kinematic_error(_: Results, document: documents.ComparisonDocument) -> KinematicErrorComparison:
    """The errors of all methods."""
    methods = document.methods
    return KinematicErrorComparison(
        **_make_origin(document),
        kinematic_error_mm={name: found.kinematic_error_mm for name, found in methods.items()},
        fitted_mean_mm={name: found.fitted_mean_mm for name, found in methods.items()},
        held_out_mean_mm={name: found.held_out_mean_mm for name, found in methods.items()},
    )


def view_segment_lengths(_: Results, document: documents.ComparisonDocument) -> SegmentLengthComparison:
    """The lengths of all methods, and how far they are from the reference's."""
    lengths = {name: found.segment_lengths_mm for name, found in document.methods.items()}
    reference = IMAGED if IMAGED in lengths else next(iter(lengths))
    return SegmentLengthComparison(
        **_make_origin(document),
        segment_lengths_mm=lengths,
        joint_centres_mm={name: found.joint_centres_mm for name, found in document.methods.items()},
        reference=reference,
        difference_mm={
            name: {k: v - lengths[reference][k] for k, v in own.items() if k in lengths[reference]}
            for name, own in lengths.items()
            if name != reference
        },
    )


def view_joint_angles(results: Results, document: documents.ComparisonDocument) -> JointAngleComparison:
    """The joint angles of all methods, in each recording and over the gait cycle."""
    from scaling_service.capabilities.scaling.comparison.geometry import list_joint_angles

    names = list_joint_angles(next(iter(results.scalings.values())).calibration.model)
    trials = {
        trial.name: {
            angle: _make_angle(
                {m: np.degrees(s.motions[trial.name].column(angle)) for m, s in results.scalings.items()}
            )
            for angle in names
        }
        for trial in results.session.dynamic
    }
    from scaling_service.capabilities.scaling.comparison.curves import make_gait_curves

    gait = make_gait_curves(results, next(iter(results.scalings)))
    return JointAngleComparison(
        **_make_origin(document),
        joint_angles=trials,
        gait=GaitEntry(
            trials=list(gait.trials),
            held_out=gait.held_out,
            reason=gait.reason,
            angles={curve.name: CycleEntry(**curve.describe(4)) for curve in gait.curves},
        ),
    )


def _make_angle(curves: abc.Mapping[str, Array]) -> AngleEntry:
    known = {name: curve[np.isfinite(curve)] for name, curve in curves.items()}
    pairs = []
    for a, b in itertools.combinations(curves, 2):
        # The difference of two curves over the frames in which both are known
        apart = curves[a] - curves[b]
        both = apart[np.isfinite(apart)]
        pairs.append(
            AngleDifference(
                methods=(a, b),
                frames=both.size,
                rms_deg=np.sqrt(np.mean(both**2)) if both.size else None,
                mean_deg=both.mean() if both.size else None,
                largest_deg=np.abs(both).max() if both.size else None,
            )
        )
    return AngleEntry(
        mean_deg={name: curve.mean() if curve.size else None for name, curve in known.items()},
        range_deg={name: np.ptp(curve) if curve.size else None for name, curve in known.items()},
        pairs=pairs,
    )


def write_view(folder: Path, name: str, results: Results, document: documents.ComparisonDocument) -> View:
    """Write a view as ``name.json`` and its numbers as ``name.csv``."""
    views: abc.Mapping[str, abc.Callable[[Results, documents.ComparisonDocument], View]] = {
        "kinematic_error": view_kinematic_error,
        "segment_lengths": view_segment_lengths,
        "joint_angles": view_joint_angles,
    }
    view = views[name](results, document)
    write_json(folder / f"{name}.json", view)
    with (folder / f"{name}.csv").open("w", encoding="utf-8", newline="") as stream:
        csv.writer(stream).writerows(_list_table_rows(view))
    return view


def _list_table_rows(view: View) -> abc.Iterator[Row]:
    """The header and the rows of a view's table."""
    match view:
        case KinematicErrorComparison():
            yield ["method", "trial", "role", "mean_mm", "sd_mm", "rms_mm", "max_mm"]
            for method, trials in view.kinematic_error_mm.items():
                for trial, e in trials.items():
                    yield [method, trial, e.role, e.mean, e.sd, e.rms, e.max]
        case SegmentLengthComparison():
            yield ["method", "segment", "length_mm", "difference_mm"]
            for method, lengths in view.segment_lengths_mm.items():
                for segment, length in lengths.items():
                    yield [method, segment, length, view.difference_mm.get(method, {}).get(segment)]
        case JointAngleComparison():
            yield ["trial", "angle", "first", "second", "frames", "rms_deg", "mean_deg", "largest_deg"]
            for trial, angles in view.joint_angles.items():
                for angle, entry in angles.items():
                    for p in entry.pairs:
                        yield [trial, angle, *p.methods, p.frames, p.rms_deg, p.mean_deg, p.largest_deg]


def _make_origin(document: documents.ComparisonDocument) -> dict[str, Any]:
    return {name: getattr(document, name) for name in (*documents.Provenance.model_fields, "warnings")}
