"""Muscles by method as a document, and their courses as OpenSim tables."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from scaling_service.capabilities.scaling.muscles.compare import MuscleComparison, MuscleCourses
from scaling_service.documents.results import MuscleDifference, MuscleDocument
from scaling_service.files.sto import Table, write_sto
from scaling_service.model.results import Array

_TOLD = 2  # of each method and quantity, in words; chosen: the tables have the rest


def make_muscle_document(found: MuscleComparison) -> MuscleDocument:
    """The part of ``comparison.json``."""
    grouped: dict[tuple[str, str], list[MuscleDifference]] = {}
    for each in found.differences:
        grouped.setdefault((each.method, each.quantity), []).append(each)
    return MuscleDocument(
        reference=found.reference,
        trials=list(found.courses[found.reference]),
        differences=list(found.differences),
        summary=[each.sentence for rows in grouped.values() for each in rows[:_TOLD]],
        notes=list(found.notes),
    )


def write_courses(folder: Path, courses: Mapping[str, MuscleCourses]) -> None:
    """Write ``TRIAL_muscle_lengths.sto``, ``TRIAL_moment_arms.sto``, ``TRIAL_joint_moments.sto``; m, N m.

    A moment arm's column is ``MUSCLE.COORDINATE``; joint moments only where there are forces.
    """
    for trial, own in courses.items():
        tables = {
            "muscle_lengths": {muscle: column for (muscle, _), column in own.courses("length").items()},
            "moment_arms": {".".join(pair): column for pair, column in own.courses("moment arm").items()},
            "joint_moments": {f"{name}_moment": column for name, column in own.moments.items()},
        }
        for what, columns in tables.items():
            if columns:
                write_sto(
                    folder / f"{trial}_{what}.sto", _tabulate_muscles(f"{trial} {what}", own.times, columns)
                )


def _tabulate_muscles(name: str, times: Array, columns: Mapping[str, Array]) -> Table:
    return Table(
        name=name,
        columns=("time", *columns),
        data=np.column_stack([times, *columns.values()]),
        in_degrees=False,
    )
