"""Every state and event; and no walk through them loses a job or gives it two results."""

from __future__ import annotations

from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scaling_service.documents.jobs import State
from scaling_service.service.jobs.machine import Event, NotPossible, Standing, follow_event

# Written out apart from the machine: what a reader of the states' names would expect.
EXPECTED = """
queued     lease   running
queued     cancel  cancelled
running    finish  done
running    fail    failed
running    lose    queued
running    release queued
running    cancel  cancelling
cancelling finish  cancelled
cancelling fail    cancelled
cancelling lose    cancelled
cancelling release cancelled
cancelling stop    cancelled
queued     wait    waiting
waiting    ready   queued
waiting    cancel  cancelled
failed     ask     queued
cancelled  ask     queued
"""
TABLE = {(State(a), Event(b)): State(c) for a, b, c in map(str.split, EXPECTED.strip().splitlines())}
MOST = 3


@pytest.mark.parametrize(("state", "event"), list(product(State, Event)))
def test_every_state_and_event(state: State, event: Event) -> None:
    standing = Standing(state, attempt=4, losses=1)
    if (state, event) not in TABLE:
        with pytest.raises(NotPossible, match=f"{state} does not {event}"):
            follow_event(standing, event, MOST)
        return
    new = follow_event(standing, event, MOST)
    assert new.state is TABLE[state, event]
    assert new.attempt == (5 if event is Event.LEASE else 4)
    assert new.losses == {Event.ASK: 0, Event.LOSE: 2 if state is State.RUNNING else 1}.get(event, 1)


def test_a_job_that_lost_too_many_workers_fails() -> None:
    standing = Standing(State.QUEUED)
    for k in range(MOST):
        assert standing.state is State.QUEUED
        standing = follow_event(follow_event(standing, Event.LEASE, MOST), Event.LOSE, MOST)
        assert standing.losses == k + 1
    assert standing.state is State.FAILED
    assert follow_event(standing, Event.ASK, MOST) == Standing(State.QUEUED, attempt=MOST, losses=0)


@given(st.lists(st.sampled_from(list(Event)), max_size=60))
def test_no_walk_loses_a_job_or_finishes_it_twice(events: list[Event]) -> None:
    standing, results, tokens = Standing(State.QUEUED), 0, [0]
    for event in events:
        try:
            new = follow_event(standing, event, MOST)
        except NotPossible:
            continue
        results += new.state is State.DONE
        assert standing.state is not State.DONE  # nothing leads out of it
        assert (new.attempt > standing.attempt) == (event is Event.LEASE)
        tokens.append(new.attempt)
        standing = new
    assert results <= 1
    assert tokens == sorted(tokens)
    # Whatever happened, it is over, or some worker can still bring it to an end.
    for event in (Event.READY, Event.LEASE, Event.FINISH):
        if not standing.state.is_over and (standing.state, event) in TABLE:
            standing = follow_event(standing, event, MOST)
    assert standing.state.is_over
