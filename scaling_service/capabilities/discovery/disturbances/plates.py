"""Disturbances of the plates: belts that give way, crossed channels, curved gains, clocks that drift."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from scaling_service.capabilities.discovery.disturbances.disturbance import DisturbanceLaw
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.scoring import ScoredCandidate
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Column
from scaling_service.capabilities.discovery.laws.loads import (
    Crossed,
    CurvedGain,
    Drifting,
    Late,
    PlateGain,
    Shear,
)
from scaling_service.capabilities.discovery.observations.wrench import COMPONENTS

_HORIZONTAL = {"x": 0, "z": 2}
_WIRED = (
    ((1.0, -1.0, -1.0, 1.0), "these two channels were exchanged"),
    ((1.0, 1.0, 1.0, 1.0), "these two channels were exchanged"),  # the plate's axes lie across the ground's
    ((2.0, 0.0, 0.0, 0.0), "fx had the wrong sign"),
    ((0.0, 0.0, 0.0, 2.0), "fz had the wrong sign"),
)
"""By how much wrong plugs put fx, fx, fz and fz off, as shares of fx, fz, fx and fz; and what they are."""

_LIKE = 0.2  # chosen: of these shares


def propose_dragging(fit: Fit) -> Iterator[Candidate]:
    """Every loaded plate, along each horizontal axis: its shear follows its own vertical force."""
    for plate in fit.scene.plates:
        for axis, k in _HORIZONTAL.items():
            columns = tuple(Column(name=what, unit=1.0, load=Shear(plate, k, what)) for what in Shear.FOLLOWS)
            yield Candidate(kind="dragging", where=(plate,), columns=columns, note=axis)


def _describe_dragged(found: ScoredCandidate) -> tuple[tuple[str, ...], str]:
    (plate,), axis = found.candidate.where, found.candidate.note
    rate, share, added = found.fitted.size.tolist()
    law = (
        f"the force of {plate} along {axis} is off by {rate:.3g} s x the rate of its vertical force "
        f"+ {share:.3g} x that force + {added:.3g} N while it is loaded"
    )
    return (plate, f"f{axis}"), law.replace("+ -", "- ")


def propose_crossing(fit: Fit) -> Iterator[Candidate]:
    """Every loaded plate: its horizontal channels stand for each other, or for what is not theirs.

    A program that takes the centre of pressure from them is wrong about the vertical moment, too.
    """
    for plate in fit.scene.plates:
        pairs = [(component, axis) for component in (0, 2, 4) for axis in _HORIZONTAL.values()]
        columns = tuple(
            Column(name=COMPONENTS[c], unit=1.0, load=Crossed(plate, c, axis)) for c, axis in pairs
        )
        yield Candidate(kind="crossing", where=(plate,), columns=columns)


def _describe_crossed(found: ScoredCandidate) -> tuple[tuple[str, ...], str]:
    (plate,) = found.candidate.where
    (xx, xz), (zx, zz) = found.fitted.size[:4].reshape(2, 2).tolist()
    law = (
        f"the horizontal forces of {plate} are off by {xx:.2g} fx + {xz:.2g} fz along x "
        f"and by {zx:.2g} fx + {zz:.2g} fz along z".replace("+ -", "- ")
    )
    for shares, fault in _WIRED:
        if np.abs(found.fitted.size[:4] - shares).max() < _LIKE:
            law += f", as if {fault}"
    return (plate, "fx", "fz"), law


def propose_curving(fit: Fit) -> Iterator[Candidate]:
    """Every loaded plate, with a gain that depends on its load."""
    for plate in fit.scene.plates:
        columns = (
            Column(name="gain", unit=1.0, load=PlateGain(plate)),
            Column(name="more", unit=1.0, load=CurvedGain(plate)),
        )
        yield Candidate(kind="curving", where=(plate,), columns=columns)


def _describe_curved(found: ScoredCandidate) -> tuple[tuple[str, ...], str]:
    (plate,), (gain, more) = found.candidate.where, (100.0 * found.fitted.size).tolist()
    return (plate,), f"{plate} is off by {gain:.3g} % of what it reads and by {more:.3g} % more for each kN"


def propose_drifting_clock(fit: Fit) -> Iterator[Candidate]:
    """All forces together, in step with the cameras at first, seconds later no more."""
    if fit.scene.plates:
        columns = (
            Column(name="delay", unit=1.0, load=Late()),
            Column(name="drift", unit=1.0, load=Drifting()),
        )
        yield Candidate(kind="drifting_clock", where=("forces",), columns=columns)


def _describe_drifted(found: ScoredCandidate) -> tuple[tuple[str, ...], str]:
    at_first, more = (1e3 * found.fitted.size).tolist()
    law = f"the forces come {at_first:.3g} ms late at first and {more:.3g} ms later every second"
    return found.candidate.where, law


LAWS = (
    DisturbanceLaw(propose_dragging, _describe_dragged),
    DisturbanceLaw(propose_crossing, _describe_crossed),
    DisturbanceLaw(propose_curving, _describe_curved),
    DisturbanceLaw(propose_drifting_clock, _describe_drifted),
)
