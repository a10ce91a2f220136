"""Plates and cameras on clocks of different speed: in step at first, seconds later no more."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.discovery.candidates import Candidate, Column
from scaling_service.discovery.findings import Foreign
from scaling_service.discovery.fitting import Account
from scaling_service.discovery.loads import Drifting, Late
from scaling_service.discovery.options import compared
from scaling_service.discovery.scene import Scene

_COLUMNS = (Column("delay", 1.0, load=Late()), Column("drift", 1.0, load=Drifting()))


def found(now: Account, scene: Scene, stretch_s: float) -> Iterator[Foreign]:
    """All forces together."""
    choice = [Candidate("drifting_clock", ("forces",), _COLUMNS)] if scene.plates else []
    for option in compared(now, choice, stretch_s, 1):
        at_first, more = (1e3 * option.fitted.size).tolist()
        law = f"the forces come {at_first:.3g} ms late at first and {more:.3g} ms later every second"
        yield Foreign(
            ("forces",), law, option.fitted.expected, option.fitted.p, option.unseen.p, of_forces=True
        )
