"""Sizes of a person that were measured by hand, as a laboratory writes them into its recordings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

_AGREE = 0.005
"""Chosen: heights, masses and sizes of two files that differ by less are one measurement, rounded."""


@dataclass(frozen=True, slots=True)
class MeasuredSizes:
    """What was measured on a person by hand.

    Parameters
    ----------
    height_m, mass_kg : float, optional
    lengths_m : mapping
        Keys of ``RANGES_M`` to m.
    """

    height_m: float | None = None
    mass_kg: float | None = None
    lengths_m: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))

    def __bool__(self) -> bool:
        return self.height_m is not None or self.mass_kg is not None or bool(self.lengths_m)

    def or_else(self, other: MeasuredSizes) -> MeasuredSizes:
        """These sizes, and the other's where these say nothing."""
        return MeasuredSizes(
            other.height_m if self.height_m is None else self.height_m,
            other.mass_kg if self.mass_kg is None else self.mass_kg,
            {**other.lengths_m, **self.lengths_m},
        )

    def conflicts(self, other: MeasuredSizes) -> tuple[str, ...]:
        """Names of what both state differently."""
        mine, theirs = self.as_mapping(), other.as_mapping()
        return tuple(
            name
            for name, value in mine.items()
            if name in theirs and abs(theirs[name] - value) > _AGREE * abs(value)
        )

    def as_mapping(self) -> dict[str, float]:
        """All of it by name, m and kg; what is not known is left out."""
        whole = {"height": self.height_m, "mass": self.mass_kg}
        return {name: v for name, v in whole.items() if v is not None} | dict(self.lengths_m)


NOT_MEASURED = MeasuredSizes()
"""Nothing was measured by hand."""


def merge(sizes: Iterable[MeasuredSizes]) -> MeasuredSizes:
    """The sizes of several files as one; of two that differ the first counts.

    Examples
    --------
    >>> merge([MeasuredSizes(1.7), MeasuredSizes(1.8, 60.0)])
    MeasuredSizes(height_m=1.7, mass_kg=60.0, lengths_m={})
    """
    result = MeasuredSizes()
    for item in sizes:
        result = result.or_else(item)
    return result
