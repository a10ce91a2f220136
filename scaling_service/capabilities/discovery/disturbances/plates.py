"""Disturbances of the plates: belts that give way, gains that depend on the load, clocks that drift."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.capabilities.discovery.disturbances.disturbance import DisturbanceLaw
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.scoring import ScoredCandidate
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Column
from scaling_service.capabilities.discovery.laws.loads import CurvedGain, Drifting, Late, PlateGain, Shear

_HORIZONTAL = {"x": 0, "z": 2}


def dragging(fit: Fit) -> Iterator[Candidate]:
    """Every loaded plate, along each horizontal axis: its shear follows its own vertical force."""
    for plate in fit.scene.plates:
        for axis, k in _HORIZONTAL.items():
            columns = tuple(Column(what, 1.0, load=Shear(plate, k, what)) for what in Shear.FOLLOWS)
            yield Candidate("dragging", (plate,), columns, note=axis)


def _dragged(found: ScoredCandidate) -> tuple[tuple[str, ...], str]:
    (plate,), axis = found.candidate.where, found.candidate.note
    rate, share, added = found.fitted.size.tolist()
    law = (
        f"the force of {plate} along {axis} is off by {rate:.3g} s x the rate of its vertical force "
        f"+ {share:.3g} x that force + {added:.3g} N while it is loaded"
    )
    return (plate, f"f{axis}"), law.replace("+ -", "- ")


def curving(fit: Fit) -> Iterator[Candidate]:
    """Every loaded plate, with a gain that depends on its load."""
    for plate in fit.scene.plates:
        columns = (
            Column("gain", 1.0, load=PlateGain(plate)),
            Column("more", 1.0, load=CurvedGain(plate)),
        )
        yield Candidate("curving", (plate,), columns)


def _curved(found: ScoredCandidate) -> tuple[tuple[str, ...], str]:
    (plate,), (gain, more) = found.candidate.where, (100.0 * found.fitted.size).tolist()
    return (plate,), f"{plate} is off by {gain:.3g} % of what it reads and by {more:.3g} % more for each kN"


def drifting_clock(fit: Fit) -> Iterator[Candidate]:
    """All forces together, in step with the cameras at first, seconds later no more."""
    if fit.scene.plates:
        columns = (Column("delay", 1.0, load=Late()), Column("drift", 1.0, load=Drifting()))
        yield Candidate("drifting_clock", ("forces",), columns)


def _drifted(found: ScoredCandidate) -> tuple[tuple[str, ...], str]:
    at_first, more = (1e3 * found.fitted.size).tolist()
    law = f"the forces come {at_first:.3g} ms late at first and {more:.3g} ms later every second"
    return found.candidate.where, law


LAWS = (
    DisturbanceLaw(dragging, _dragged),
    DisturbanceLaw(curving, _curved),
    DisturbanceLaw(drifting_clock, _drifted),
)
