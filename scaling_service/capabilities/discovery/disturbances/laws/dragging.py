"""A plate whose shear follows its own vertical force: the belt on it gives way under load."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.capabilities.discovery.evidence.fitting import Account
from scaling_service.capabilities.discovery.laws.loads import Shear
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.candidates import Candidate, Column
from scaling_service.capabilities.discovery.search.option import Option

_HORIZONTAL = {"x": 0, "z": 2}


def candidates(_now: Account, scene: Scene) -> Iterator[Candidate]:
    """Every loaded plate, along each horizontal axis."""
    for plate in scene.plates:
        for axis, k in _HORIZONTAL.items():
            columns = tuple(Column(what, 1.0, load=Shear(plate, k, what)) for what in Shear.FOLLOWS)
            yield Candidate("dragging", (plate,), columns, note=axis)


def told(option: Option) -> tuple[tuple[str, ...], str]:
    """The plate and the component, and how large."""
    (plate,), axis = option.candidate.where, option.candidate.note
    rate, share, added = option.fitted.size.tolist()
    law = (
        f"the force of {plate} along {axis} is off by {rate:.3g} s x the rate of its vertical force "
        f"+ {share:.3g} x that force + {added:.3g} N while it is loaded"
    )
    return (plate, f"f{axis}"), law.replace("+ -", "- ")
