"""Jobs that are made of others: which belong together, how far they are, and what they made."""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass

import sqlalchemy as sa

from scaling_service.documents.jobs import State
from scaling_service.service.store import database as db
from scaling_service.service.store import tables

OVER = tuple(state.value for state in State if state.is_over)
_SETTLED = [state for state in State if not state.is_over and state is not State.WAITING]
"""States of a whole that counts on its parts being over."""


@dataclass(frozen=True, slots=True)
class PartRow:
    """How a part ended: its specification, and its result or failure, as JSON."""

    state: State
    specification: str
    result: str | None
    failure: str | None


def link(connection: sa.Connection, whole: str, parts: abc.Sequence[str]) -> None:
    """Say what a job is made of; what is said already stays."""
    rows = [{"whole": whole, "part": part, "position": k} for k, part in enumerate(parts)]
    connection.execute(db.insert_for(connection)(tables.job_parts).on_conflict_do_nothing(), rows)


def of(connection: sa.Connection, wholes: abc.Iterable[str]) -> list[str]:
    """What some jobs are made of, sorted by name: whoever locks them does so in this order, wholes after."""
    wanted = sa.select(tables.job_parts.c.part).where(tables.job_parts.c.whole.in_(list(wholes))).distinct()
    return sorted(connection.scalars(wanted))


def list_waiting(connection: sa.Connection, part: str) -> list[str]:
    """The jobs that wait for a part, sorted by name."""
    return _list_wholes(connection, part, [State.WAITING])


def is_needed(connection: sa.Connection, part: str) -> bool:
    """Whether it belongs to a job that is not over."""
    return bool(_list_wholes(connection, part, [state for state in State if not state.is_over]))


def is_counted_on(connection: sa.Connection, part: str) -> bool:
    """Whether it belongs to a job that no longer waits and is not over: it must stay as it ended."""
    return bool(_list_wholes(connection, part, _SETTLED))


def _list_wholes(connection: sa.Connection, part: str, states: abc.Iterable[State]) -> list[str]:
    wanted = sa.select(tables.job_parts.c.whole).join(
        tables.jobs, tables.jobs.c.id == tables.job_parts.c.whole
    )
    chosen = tables.jobs.c.state.in_([state.value for state in states])
    return sorted(connection.scalars(wanted.where(tables.job_parts.c.part == part, chosen)))


def count_ended(connection: sa.Connection, whole: str) -> tuple[int, int]:
    """How many of a job's parts are over, and how many there are."""
    wanted = (
        sa.select(tables.jobs.c.state, sa.func.count().label("number"))
        .join(tables.job_parts, tables.job_parts.c.part == tables.jobs.c.id)
        .where(tables.job_parts.c.whole == whole)
        .group_by(tables.jobs.c.state)
    )
    counts: dict[str, int] = {row.state: row.number for row in connection.execute(wanted)}
    return sum(counts.get(state, 0) for state in OVER), sum(counts.values())


def list_unneeded(connection: sa.Connection, parts: abc.Iterable[str]) -> list[str]:
    """Those that no job is made of any more."""
    left = tables.jobs.c.id.in_(list(parts)) & ~sa.exists().where(tables.job_parts.c.part == tables.jobs.c.id)
    return list(connection.scalars(sa.select(tables.jobs.c.id).where(left)))


def list_ends(database: db.Database, whole: str) -> list[PartRow]:
    """How a job's parts ended, in their order."""
    wanted = (
        sa.select(
            tables.jobs.c.state, tables.jobs.c.specification, tables.jobs.c.result, tables.jobs.c.failure
        )
        .join(tables.job_parts, tables.job_parts.c.part == tables.jobs.c.id)
        .where(tables.job_parts.c.whole == whole)
        .order_by(tables.job_parts.c.position)
    )
    with database.read() as connection:
        return [PartRow(State(state), *rest) for state, *rest in connection.execute(wanted)]


def list_files(database: db.Database, whole: str, name: str) -> list[tables.FileRow]:
    """The files of that name, in whichever folder, which a job's parts made."""
    wanted = (
        sa.select(tables.job_files.c.path, tables.job_files.c.sha256, tables.job_files.c.size)
        .join(tables.job_parts, tables.job_parts.c.part == tables.job_files.c.job)
        .where(
            tables.job_parts.c.whole == whole, tables.job_files.c.path.endswith(f"/{name}", autoescape=True)
        )
        .order_by(tables.job_files.c.path)
    )
    with database.read() as connection:
        return [tables.FileRow(*row) for row in connection.execute(wanted)]


def take_files(connection: sa.Connection, whole: str) -> None:
    """Let a job refer to all that its parts made, besides what it made itself."""
    made = (
        sa.select(
            sa.literal(whole), tables.job_files.c.path, tables.job_files.c.sha256, tables.job_files.c.size
        )
        .join(tables.job_parts, tables.job_parts.c.part == tables.job_files.c.job)
        .where(tables.job_parts.c.whole == whole)
        .order_by(tables.job_files.c.sha256)  # as everybody who needs several contents
    )
    connection.execute(sa.insert(tables.job_files).from_select(["job", "path", "sha256", "size"], made))
