"""Any order of leasing, dying and coming back late: no job is lost, none has two results."""

from __future__ import annotations

from collections import Counter
from itertools import count

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from scaling_service.documents.jobs import State
from scaling_service.service.jobs.ledger import AttemptOutput
from scaling_service.service.jobs.machine import Event
from scaling_service.service.store import jobs
from scaling_service.service.store.store import Store
from scaling_service.service.store.tables import JobRow
from tests.service.jobs.test_ledger import WHY, ask, ledger_of

OFTEN = ("lease", "lease", "lease", "finish", "finish", "finish", "die", "die")
"""Drawn more often than the others: a walk without leases and ends tells little."""

STEPS = st.tuples(
    st.sampled_from((*OFTEN, "ask", "fail", "lose", "release", "cancel")),
    st.integers(0, 9),
)
_OWNERS = count()


class Walk:
    """One owner's two jobs and all attempts at them that there ever were, some of them long stale."""

    def __init__(self, store: Store) -> None:
        self.store, self.ledger, self.owner = store, ledger_of(store), f"owner-{next(_OWNERS)}"
        self.asked = {ask(self.ledger, number, self.owner)[0].id for number in range(2)}
        self.attempts, self.results = list[JobRow](), Counter[str]()

    def step(self, what: str, choice: int) -> None:
        if what == "ask":
            ask(self.ledger, choice % 2, self.owner)
        elif what == "cancel":
            self.ledger.cancel(self.owner, f"{self.owner}-{choice % 2:04}")
        elif what == "die":
            self.ledger.take_back(dead=["a" if choice % 3 else "b"])
        elif what == "lease":
            row = self.ledger.lease("a" if choice % 3 else "b", "host")
            self.attempts += [] if row is None else [row]
        elif self.attempts:
            self.end(self.attempts[choice % len(self.attempts)], what)

    def end(self, attempt: JobRow, how: str) -> None:
        before = jobs.get(self.store.database, self.owner, attempt.id)
        if how == "finish":
            state = self.ledger.finish(attempt, AttemptOutput(f"{attempt.attempt}"), "{}")
        else:
            state = self.ledger.settle(attempt, Event(how), WHY, "{}")
        assert state is None or attempt.attempt == before.attempt, "a stale attempt was heard"
        self.results[attempt.id] += state is State.DONE

    def check(self) -> None:
        rows = {row.id: row for row in jobs.list_page(self.store.database, self.owner).items}
        assert set(rows) == self.asked
        for job, row in rows.items():
            assert self.results[job] == (row.state is State.DONE)
            assert (row.worker is None) == (not row.state.is_leased)
            assert (row.failure is not None) == (row.state is State.FAILED)

    def cancel_all(self) -> None:
        """Leave nothing that the next walk could lease."""
        self.ledger.take_back(dead=["a", "b"])
        for job in self.asked:
            self.ledger.cancel(self.owner, job)


@pytest.mark.parametrize("most", [10, pytest.param(100, marks=pytest.mark.costly)])
def test_no_walk_of_two_runners_loses_or_doubles_a_job(sqlite_store: Store, most: int) -> None:
    @settings(max_examples=most, suppress_health_check=list(HealthCheck))
    @given(steps=st.lists(STEPS, min_size=30, max_size=60))
    def walks(steps: list[tuple[str, int]]) -> None:
        walk = Walk(sqlite_store)
        for what, choice in steps:
            walk.step(what, choice)
            walk.check()
        walk.cancel_all()

    walks()
