"""Names that options take, without importing what they stand for; each method's and table's is tested."""

from __future__ import annotations

from functools import cache
from importlib.metadata import entry_points
from typing import Annotated

import pydantic

from scaling_service.core.options import Flag

AS_IT_IS = "none"
"""In place of a method: the given model is used as it is."""

OWN = "model"
"""In place of an inertial table's name: what the model holds."""

HIP_REGRESSION_NAMES = (
    "harrington2007_multi",
    "harrington2007_single",
    "bell1990",
    "hara2016",
    "davis1991",
    "plug_in_gait",
)
"""Of ``model.anatomy.hip_centre``."""

TABLE_NAMES = ("dumas2007", "dumas_wojtusch2018", "deleva1996", "winter2009")
"""Of ``model.inertia``."""

BONE_NAMES = ("pelvis", "femur_r", "tibia_r", "talus_r", "femur_l", "tibia_l", "talus_l")
"""Of ``bones.whole``."""

_METHODS = ("MB", "MB_lam", "MB_am", "EB", "EB_am", "MAP")


@cache
def list_method_names() -> tuple[str, ...]:
    """The built-in scaling methods, and those of other distributions (entry points)."""
    added = sorted(point.name for point in entry_points(group="scaling_service.methods"))
    return (*_METHODS, *(name for name in added if name not in _METHODS))


def check_methods(methods: list[str] | None) -> list[str] | None:
    """Refuse names that no method has, and names given twice (ValueError)."""
    for method in methods or ():
        if method not in list_method_names():
            raise ValueError(f"there is no method '{method}'; methods are {', '.join(list_method_names())}")
    if methods is not None and (not methods or len(set(methods)) < len(methods)):
        raise ValueError("name each method once, and at least one")
    return methods


def check_start(start: str | None) -> str | None:
    """Refuse a start that there is not (ValueError)."""
    if start is not None and start not in (*list_method_names(), AS_IT_IS):
        raise ValueError(
            f"there is no method '{start}'; methods are {', '.join(list_method_names())}, and '{AS_IT_IS}' "
            f"takes the model as it is"
        )
    return start


def check_inertia(inertia: str | None) -> str | None:
    """Refuse a table that there is not (ValueError)."""
    if inertia is not None and inertia not in (*TABLE_NAMES, OWN):
        raise ValueError(
            f"there is no inertial table '{inertia}'; use one of {', '.join(TABLE_NAMES)}, or '{OWN}' for "
            "the model's own"
        )
    return inertia


def _make_choice_schema(*names: str) -> pydantic.WithJsonSchema:
    return pydantic.WithJsonSchema({"anyOf": [{"enum": list(names), "type": "string"}, {"type": "null"}]})


Start = Annotated[
    str | None,
    pydantic.AfterValidator(check_start),
    Flag(metavar="|".join((*list_method_names(), AS_IT_IS))),
    _make_choice_schema(*list_method_names(), AS_IT_IS),
]
Inertia = Annotated[
    str | None,
    pydantic.AfterValidator(check_inertia),
    Flag(metavar="|".join((*TABLE_NAMES, OWN))),
    _make_choice_schema(*TABLE_NAMES, OWN),
]
