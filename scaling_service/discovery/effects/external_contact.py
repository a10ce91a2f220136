"""Something touches a segment and no plate measures it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from scaling_service.discovery.additions import Sized
from scaling_service.discovery.candidates import Candidate, Contact
from scaling_service.discovery.comparing import Unseen
from scaling_service.discovery.contacts import touches
from scaling_service.discovery.fitting import Account
from scaling_service.discovery.option import Option
from scaling_service.discovery.scene import Scene

KIND = "external_contact"
MEANING = "something touches the segment that no plate measures"


def options(now: Account, scene: Scene, stretch_s: float) -> Iterator[Option]:
    """The best segment of every trial in which the force stands out, and of all of them if all do alike."""
    for touch in touches(now.weighed, stretch_s):
        made = [
            Candidate(KIND, (contact.segment,), (), trials=touch.trials, change=contact)
            for contact in (touch.contact, *touch.others)
        ]
        if not _known(made[0], now):
            tried = Unseen(touch.gain_share, touch.fitted.p, True)
            yield Option(made[0], touch.fitted, None, tried, tuple(made[1:]))


def _known(candidate: Candidate, now: Account) -> bool:
    """Whether a contact at this segment is known already, in the same trials or in all."""
    known = [e.candidate for e in now.effects if e.candidate.kind == KIND]
    return any(c.where == candidate.where and c.trials in ((), candidate.trials) for c in known)


def details(effect: Sized, after: Account) -> Mapping[str, float]:
    """From when to when, where on the segment, and how strong."""
    contact = effect.candidate.change
    assert isinstance(contact, Contact)
    point = dict(zip(("x_mm", "y_mm", "z_mm"), (1e3 * v for v in contact.point), strict=True))
    rms = _rms(after, contact, effect.candidate)
    return {"start_s": contact.start_s, "end_s": contact.end_s, "rms_N": rms, **point}


def _rms(after: Account, contact: Contact, candidate: Candidate) -> float:
    """RMS of the force inferred, N."""
    squares = [
        np.square(item.touched[inside, :3]).sum(axis=1)
        for item in after.weighed
        if candidate.holds_in(item.name) and item.touched is not None
        for inside in [(item.times >= contact.start_s) & (item.times <= contact.end_s)]
    ]
    return float(np.sqrt(np.concatenate(squares).mean())) if squares else float("nan")
