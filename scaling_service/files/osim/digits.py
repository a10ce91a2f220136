"""Files of OpenSim with all digits of their splines."""

from __future__ import annotations

import re

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.files.osim.joints import merge_shapes
from scaling_service.model.body import BodyModel
from scaling_service.model.compile import evaluate_shape

_POINTS = re.compile(r"<x>([^<]*)</x>(\s*)<y>([^<]*)</y>")


def restore_digits(text: str, model: BodyModel) -> str:
    """A file with the points of its splines as the model has them: OpenSim writes them with six digits.

    A turn of 2.4 rad is then off by 5e-6 rad, and a foot by 2 um.
    """
    known: dict[tuple[str, ...], Array] = {}
    for law in (*(j.law for _, j in model.joints()), *(c.law for c in model.couplers)):
        shapes = [term.shape for term in law.terms if term.shape is not None]
        if shapes and len(law.coordinates) == 1:
            shapes.append(merge_shapes(law))
        for shape in shapes:
            x = np.array(shape.breaks)
            points = np.array([x, evaluate_shape(shape, x)])
            known.setdefault(tuple(f"{value:g}" for value in points.ravel() + 0.0), points)

    def restore(found: re.Match[str]) -> str:
        written = tuple(f"{float(value) + 0.0:g}" for value in f"{found[1]} {found[3]}".split())
        if written not in known:
            return found[0]
        x, y = (" ".join(map(repr, row)) for row in known[written].tolist())
        return f"<x>{x}</x>{found[2]}<y>{y}</y>"

    return _POINTS.sub(restore, text)
