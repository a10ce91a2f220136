"""Disturbances that the readings alone show, noted when they were read: no law is right beside them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from scaling_service.capabilities.discovery.disturbances.disturbance import Disturbance, DisturbanceLaw
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.laws.candidates import Seen
from scaling_service.model.trial import Repair

_CHANNELS = ("dead_channel", "saturated")


def list_faulty_instruments(fit: Fit) -> Iterator[Disturbance]:
    """Channels that are dead or stop at a limit, and cameras that shake."""
    found = {}
    for item in fit.wrenches:
        for note in item.contacts.ground.repairs:
            if note.what in _CHANNELS and note.where not in found:
                found[note.where] = _make_certain(
                    note.where.split(), f"{item.name}: {note.where}", note, "wrench"
                )
    for tracked in fit.tracked:
        for note in tracked.trial.repairs:
            if note.what == "shaking" and "markers" not in found:
                found["markers"] = _make_certain(
                    ["markers"], f"{tracked.name}: {note.where}", note, "markers"
                )
    yield from found.values()


def _make_certain(where: Sequence[str], place: str, note: Repair, seen_in: Seen) -> Disturbance:
    return Disturbance(
        where=tuple(where),
        law=f"{place} {note.detail}",
        expected=np.inf,
        p=0.0,
        held_out=0.0,
        seen_in=seen_in,
        rms=note.off,
    )


LAWS = (DisturbanceLaw(search=list_faulty_instruments),)
