"""The courses of muscles in which methods differ most, as the page draws them."""

from __future__ import annotations

from collections import abc
from pathlib import Path

import numpy as np

from scaling_service.capabilities.playback.scene import FOLDER
from scaling_service.capabilities.scaling.muscles import compare
from scaling_service.documents import results as documents
from scaling_service.documents.writing import write_json
from scaling_service.files.table_files import ArrayFiles

FILE_NAME = f"{FOLDER}/muscles.json"

MOST_CURVES = 6
"""Of each quantity. Chosen: two rows of a page."""


def write_muscle_scene(
    found: compare.MuscleComparison, outputs: Path, *, brief: bool = False
) -> documents.MuscleScene:
    """Write ``scene/muscles.json`` with its tables.

    ``outputs``: the folder of the job's files. ``brief``: whether numbers are kept in brief.
    """
    files = ArrayFiles(outputs, FOLDER, brief=brief)
    curves = []
    for k, each in enumerate(_list_distinct(found.differences)):
        factor, unit = compare.UNITS[each.quantity]
        times = found.courses[each.method][each.trial].times
        courses = {
            method: trials[each.trial].courses(each.quantity).get((each.muscle, each.coordinate))
            for method, trials in found.courses.items()
        }
        known = {method: factor * values for method, values in courses.items() if values is not None}
        curves.append(
            documents.MuscleCurve(
                quantity=each.quantity,
                muscle=each.muscle,
                coordinate=each.coordinate,
                trial=each.trial,
                unit=unit,
                start_s=float(times[0]),
                rate_hz=round(1.0 / float(np.median(np.diff(times))), 6),
                methods=list(known),
                values=files.write(f"muscle_{k}", np.column_stack(list(known.values())), unit),
            )
        )
    document = documents.MuscleScene(curves=curves)
    write_json(outputs / FILE_NAME, document)
    return document


def _list_distinct(
    differences: abc.Sequence[documents.MuscleDifference],
) -> abc.Iterator[documents.MuscleDifference]:
    """Of each quantity the largest of all methods, each muscle and coordinate once."""
    for quantity in compare.UNITS:
        largest: dict[tuple[str, str], documents.MuscleDifference] = {}
        of = [each for each in differences if each.quantity == quantity]
        for each in sorted(of, key=lambda each: -abs(each.difference)):
            largest.setdefault((each.muscle, each.coordinate), each)
        yield from list(largest.values())[:MOST_CURVES]
