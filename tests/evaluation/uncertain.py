"""A short recording of a virtual person, and what its tests share."""

from __future__ import annotations

from functools import cache

from scaling_service.capabilities.dynamics.uncertainty.reference import LoadedMotion
from scaling_service.studies.muller2017.excitation import (
    ExcitationSettings,
    ExcitedPerson,
    make_excited_person,
)

SHORT = ExcitationSettings(seconds=8.0)


@cache
def person() -> ExcitedPerson:
    return make_excited_person(7, SHORT, ("in_order",))


def recording() -> LoadedMotion:
    return person().performances["in_order"].recording
