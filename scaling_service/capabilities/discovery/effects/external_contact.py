"""Something touches a segment and no plate measures it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from scaling_service.capabilities.discovery.evidence.fitting import Account
from scaling_service.capabilities.discovery.evidence.weighed import Weighed
from scaling_service.capabilities.discovery.laws.additions import Sized
from scaling_service.capabilities.discovery.laws.contact_times import edges_of
from scaling_service.capabilities.discovery.laws.contacts import touches
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.candidates import Candidate, Contact
from scaling_service.capabilities.discovery.search.comparing import Unseen
from scaling_service.capabilities.discovery.search.option import Option

KIND = "external_contact"
OF_FORCES = True
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
    rms, _ = _rms(_touched(effect, after), contact)
    return {"start_s": contact.start_s, "end_s": contact.end_s, "rms_N": rms, **point}


def spreads(effect: Sized, after: Account, stretch_s: float) -> Mapping[str, float]:
    """Of its beginning, end and strength, where it has both of the former."""
    contact = effect.candidate.change
    assert isinstance(contact, Contact)
    here = _touched(effect, after)
    edges = edges_of(here, contact)
    if edges is None:
        return {}
    (_, of_start), (_, of_end) = edges
    rms, of_noise = _rms(here, contact)
    # The mean square over an interval that is longer by a share is smaller by that share.
    of_interval = 0.5 * rms * np.hypot(of_start, of_end) / (contact.end_s - contact.start_s)
    return {"start_s": of_start, "end_s": of_end, "rms_N": float(np.hypot(of_noise, of_interval))}


def _touched(effect: Sized, after: Account) -> list[Weighed]:
    return [
        item for item in after.weighed if effect.candidate.holds_in(item.name) and item.touched is not None
    ]


def _rms(here: Sequence[Weighed], contact: Contact) -> tuple[float, float]:
    """RMS of the force inferred, free of what noise adds to it, and what noise makes of it, N."""
    squares, noise, independent = [], [], 0.0
    for item in here:
        assert item.touched is not None
        inside = (item.times >= contact.start_s) & (item.times <= contact.end_s) & item.usable
        squares.append(np.square(item.touched[inside, :3]).sum(axis=1))
        noise.append(np.full(int(inside.sum()), np.square(item.floor[:3]).sum()))
        independent += inside.sum() * 2.0 * item.cutoff_hz / item.item.trial.rate_hz
    if independent < 1.0:
        return float("nan"), float("nan")
    added = float(np.concatenate(noise).mean())
    rms = np.sqrt(max(float(np.concatenate(squares).mean()) - added, 0.0))
    return float(rms), float(np.sqrt(added / 3.0 / independent))
