"""A job's step from one state to the next, with all that changes with it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sqlalchemy import Connection

from scaling_service.documents.jobs import State
from scaling_service.service.jobs.machine import Event, Standing, after
from scaling_service.service.store import jobs, parts
from scaling_service.service.store.clock import NowUs
from scaling_service.service.store.rows import JobRow

PARTS_SHARE = 0.95
"""Of a job that is made of others. Chosen: what is left to do when they are over takes seconds."""

FRESH: Mapping[str, Any] = {"finished_us": None, "started_us": None}
"""Of a job that is asked for again."""


def move(
    connection: Connection, row: JobRow, event: Event, values: Mapping[str, Any], most_losses: int
) -> State:
    """Write where a job stands after an event, with what belongs to its new state.

    Parameters
    ----------
    connection : Connection
        Of a write transaction, in which the job is locked.
    row : JobRow
    event : Event
    values : mapping
        Further columns.
    most_losses : int
    """
    new = after(Standing(row.state, row.attempt, row.losses), event, most_losses)
    written = {"state": new.state.value, "attempt": new.attempt, "losses": new.losses} | dict(values)
    if not new.state.is_leased:
        written |= {"worker": None, "lease_until_us": None}
    if new.state.is_over:
        written["finished_us"] = NowUs()
    if new.state is State.QUEUED:
        _, count = parts.ended(connection, row.id)
        written |= {
            "progress_share": PARTS_SHARE if count else 0.0,
            "progress_what": "waiting",
            "provenance": None,
        }
    if new.state is not State.FAILED:
        written["failure"] = None
    jobs.change(connection, row.id, written)
    if new.state.is_over:
        _tell_wholes(connection, row.id, new.state, most_losses)
    return new.state


def await_parts(connection: Connection, row: JobRow, most_losses: int) -> None:
    """Let a job that is queued wait for its parts, unless they are over."""
    over, count = parts.ended(connection, row.id)
    if over < count:
        move(connection, row, Event.WAIT, _counted(over, count), most_losses)


def _tell_wholes(connection: Connection, part: str, state: State, most_losses: int) -> None:
    """A part is over: count again, and let go on what waited for the last one."""
    waiting = parts.waiting_for(connection, part)
    if waiting and state is State.CANCELLED:  # cancelled with another whole, just before this one was asked
        row = jobs.locked(connection, part)
        assert row is not None
        move(connection, row, Event.ASK, FRESH, most_losses)
        return
    for whole in waiting:
        row = jobs.locked(connection, whole)
        if row is None or row.state is not State.WAITING:
            continue
        over, count = parts.ended(connection, whole)
        if over == count:
            move(connection, row, Event.READY, {}, most_losses)
        else:
            jobs.change(connection, whole, _counted(over, count))


def _counted(over: int, count: int) -> dict[str, Any]:
    return {"progress_share": PARTS_SHARE * over / count, "progress_what": f"{over} of {count} ended"}
