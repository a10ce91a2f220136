"""The states of a job, as one pure function.

::

    (new) --ask--> queued --lease--> running --finish--> done
                     ^  ^              |  |
                     |  +-release/lose-+  +--fail--> failed
                     |                 |
                     |               cancel
                     |                 v
      cancelled <----|-------- cancelling --finish/fail/stop/lose/release--> cancelled
          |          |
          +---ask----+----ask---- failed

A job that is made of others first waits for them, however each of them ends::

    queued --wait--> waiting --ready--> queued
                        |
                        +--cancel--> cancelled
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

from scaling_service.documents.jobs import State


class Event(StrEnum):
    """What can happen to a job."""

    ASK = "ask"  # it is asked for (again)
    LEASE = "lease"  # a worker takes it
    FINISH = "finish"  # its worker has the result
    FAIL = "fail"  # its worker knows why there is none
    LOSE = "lose"  # its worker, or the process that computed, is gone without a word
    RELEASE = "release"  # its worker gives it back unharmed: it stops, or the disk is full
    CANCEL = "cancel"  # its owner wants it no more
    STOP = "stop"  # its worker has stopped it
    WAIT = "wait"  # it is made of others that are not over
    READY = "ready"  # they are over, each in its own way


@dataclass(frozen=True, slots=True)
class Standing:
    """Where a job stands."""

    state: State
    attempt: int = 0  # how often it was leased: the fencing token
    losses: int = 0  # how often its worker was lost since it was last asked for


class NotPossible(Exception):
    """The event means nothing in this state."""

    def __init__(self, state: State, event: Event) -> None:
        super().__init__(f"a job that is {state} does not {event}")
        self.state, self.event = state, event


def follow_event(standing: Standing, event: Event, most_losses: int) -> Standing:
    """Where a job stands after an event; one that lost ``most_losses`` workers fails.

    Examples
    --------
    >>> follow_event(Standing(State.QUEUED), Event.LEASE, 3)
    Standing(state=<State.RUNNING: 'running'>, attempt=1, losses=0)
    """
    if event is Event.LOSE and standing.state is State.RUNNING:
        losses = standing.losses + 1
        return replace(standing, state=State.QUEUED if losses < most_losses else State.FAILED, losses=losses)
    following = _NEXT.get((standing.state, event))
    if following is None:
        raise NotPossible(standing.state, event)
    if event is Event.LEASE:
        return replace(standing, state=following, attempt=standing.attempt + 1)
    if event is Event.ASK:
        return replace(standing, state=following, losses=0)
    return replace(standing, state=following)


_NEXT = {
    (State.QUEUED, Event.LEASE): State.RUNNING,
    (State.QUEUED, Event.CANCEL): State.CANCELLED,
    (State.QUEUED, Event.WAIT): State.WAITING,
    (State.WAITING, Event.READY): State.QUEUED,
    (State.WAITING, Event.CANCEL): State.CANCELLED,
    (State.RUNNING, Event.FINISH): State.DONE,
    (State.RUNNING, Event.FAIL): State.FAILED,
    (State.RUNNING, Event.RELEASE): State.QUEUED,
    (State.RUNNING, Event.CANCEL): State.CANCELLING,
    (State.CANCELLING, Event.FINISH): State.CANCELLED,
    (State.CANCELLING, Event.FAIL): State.CANCELLED,
    (State.CANCELLING, Event.LOSE): State.CANCELLED,
    (State.CANCELLING, Event.RELEASE): State.CANCELLED,
    (State.CANCELLING, Event.STOP): State.CANCELLED,
    (State.FAILED, Event.ASK): State.QUEUED,
    (State.CANCELLED, Event.ASK): State.QUEUED,
}
"""State and event to the next state; a lost worker of a running job is decided by number."""
