"""A plate whose shear follows its own vertical force: the belt on it gives way under load."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.discovery.candidates import Candidate, Column
from scaling_service.discovery.findings import Foreign
from scaling_service.discovery.fitting import Account
from scaling_service.discovery.loads import Shear
from scaling_service.discovery.options import compared
from scaling_service.discovery.scene import Scene

_HORIZONTAL = {"x": 0, "z": 2}


def found(now: Account, scene: Scene, stretch_s: float) -> Iterator[Foreign]:
    """Every loaded plate, along each horizontal axis."""
    choice = [_at(plate, axis, k) for plate in scene.plates for axis, k in _HORIZONTAL.items()]
    for option in compared(now, choice, stretch_s, 1):
        (plate,), axis = option.candidate.where, option.candidate.note
        rate, share, added = option.fitted.size.tolist()
        law = (
            f"the force of {plate} along {axis} is off by {rate:.3g} s x the rate of its vertical force "
            f"+ {share:.3g} x that force + {added:.3g} N while it is loaded"
        ).replace("+ -", "- ")
        fitted, where = option.fitted, (plate, f"f{axis}")
        yield Foreign(where, law, fitted.expected, fitted.p, option.unseen.p, of_forces=True)


def _at(plate: str, axis: str, k: int) -> Candidate:
    columns = tuple(Column(what, 1.0, load=Shear(plate, k, what)) for what in Shear.FOLLOWS)
    return Candidate("dragging", (plate,), columns, note=axis)
