"""Plates and cameras on clocks of different speed: in step at first, seconds later no more."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.capabilities.discovery.evidence.fitting import Account
from scaling_service.capabilities.discovery.laws.loads import Drifting, Late
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.candidates import Candidate, Column
from scaling_service.capabilities.discovery.search.option import Option


def candidates(_now: Account, scene: Scene) -> Iterator[Candidate]:
    """All forces together."""
    if scene.plates:
        columns = (Column("delay", 1.0, load=Late()), Column("drift", 1.0, load=Drifting()))
        yield Candidate("drifting_clock", ("forces",), columns)


def told(option: Option) -> tuple[tuple[str, ...], str]:
    """How late at first, and how much later with time."""
    at_first, more = (1e3 * option.fitted.size).tolist()
    law = f"the forces come {at_first:.3g} ms late at first and {more:.3g} ms later every second"
    return option.candidate.where, law
