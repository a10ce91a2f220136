"""Published tables of body segment inertial parameters, as they are printed.

What the numbers mean is told in ``reference_models/README.md``, section "Inertial tables".
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

import yaml

from scaling_service.core.errors import InputError
from scaling_service.model.reference import reference_folder

Sex = Literal["F", "M"]

TABLE_NAMES: tuple[str, ...] = ("dumas2007", "dumas_wojtusch2018", "deleva1996", "winter2009")
"""Dumas et al. 2007; Dumas and Wojtusch 2018; de Leva 1996; Winter 2009 (Dempster)."""


@dataclass(frozen=True, slots=True)
class InertiaRow:
    """One segment of one sex.

    Parameters
    ----------
    segment : str
        ``thigh``, ``thorax`` …
    sex : 'F' or 'M'
    mass_pct : float
        Of the body's mass.
    span : (str, str)
        Landmarks: where the centre of mass is counted from, and what the length L reaches to.
    length_m : float or None
        L of the table's mean subject.
    com_pct : tuple of float or None
        % of L: three along the segment's axes, or one along the span. None where the table is silent.
    radii_pct : three floats or None
        Radii of gyration about the centre of mass, axes x, y, z, % of L.
    products_pct : three floats
        xy, xz, yz, % of L: the product of inertia is ``sign * mass * (v L)^2``.
    """

    segment: str
    sex: Sex
    mass_pct: float
    span: tuple[str, str]
    length_m: float | None
    com_pct: tuple[float, ...] | None
    radii_pct: tuple[float | None, float | None, float | None]
    products_pct: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class InertiaTable:
    """One published table.

    Parameters
    ----------
    name, source : str
    stature_m : mapping
        Sex to the stature of the mean subject.
    notes : tuple of str
        What a user of the table must know.
    fallback : str or None
        The table that is asked where this one is silent.
    rows : tuple of InertiaRow
    """

    name: str
    source: str
    stature_m: Mapping[str, float]
    notes: tuple[str, ...]
    fallback: str | None
    rows: tuple[InertiaRow, ...]

    def find(self, segment: str, sex: Sex) -> InertiaRow | None:
        """The row of a segment and sex, None if the table has none."""
        return next((r for r in self.rows if r.segment == segment and r.sex == sex), None)

    def row(self, segment: str, sex: Sex) -> InertiaRow:
        """The row of a segment and sex.

        Raises
        ------
        InputError
            The table has none.
        """
        found = self.find(segment, sex)
        if found is None:
            known = ", ".join(dict.fromkeys(r.segment for r in self.rows))
            raise InputError(
                f"table '{self.name}' has no segment '{segment}' for sex '{sex}'",
                field="inertia",
                remedy=f"It has {known}, for F and M",
            )
        return found


@cache
def inertia_table(name: str) -> InertiaTable:
    """A table by its name.

    Raises
    ------
    InputError
        There is no such table; the names are listed.

    Examples
    --------
    >>> inertia_table("dumas2007").row("thigh", "M").mass_pct
    12.3
    """
    if name not in TABLE_NAMES:
        raise InputError(
            f"there is no inertial table '{name}'",
            field="inertia",
            remedy=f"Use one of {', '.join(TABLE_NAMES)}",
        )
    text = (reference_folder() / f"inertia_{name}.yaml").read_text(encoding="utf-8")
    content: dict[str, Any] = yaml.safe_load(text)
    return InertiaTable(
        name,
        content["source"],
        content["stature_m"],
        tuple(content["notes"]),
        content.get("fallback"),
        tuple(_row(entry) for entry in content["rows"]),
    )


def _row(entry: Mapping[str, Any]) -> InertiaRow:
    com, length = entry["com_pct"], entry["length_mm"]
    start, end = entry["span"]
    x, y, z = entry["radii_pct"]
    xy, xz, yz = entry["products_pct"]
    return InertiaRow(
        entry["segment"],
        entry["sex"],
        float(entry["mass_pct"]),
        (start, end),
        None if length is None else length / 1000.0,
        None if com is None else tuple(float(c) for c in com),
        (x, y, z),
        (xy, xz, yz),
    )
