"""Links that open one path without a key until they end, on every server of the store.

A row knows its owner, its end, and the SHA-256 of ticket and path together: whoever reads it learns neither.
"""

from __future__ import annotations

import hashlib
import secrets

import sqlalchemy as sa

from scaling_service.core.errors import InputError
from scaling_service.service.store import database as db
from scaling_service.service.store.keys import ensure_owner
from scaling_service.service.store.tables import links

MOST = 1_000  # that an owner may have open at once. Chosen: every file of a cohort within a minute.


class TooManyLinks(InputError):
    """An owner has as many links open as are allowed."""


def issue(database: db.Database, owner: str, path: str, lifetime_s: int) -> tuple[str, int]:
    """A ticket for a decoded path, and the end, µs since 1970; TooManyLinks. Links that ended are removed."""
    ticket = secrets.token_urlsafe(24)
    mine = links.c.owner == owner
    with database.write() as connection:
        ensure_owner(connection, owner)
        connection.execute(sa.delete(links).where(links.c.until_us < db.NowUs()))
        if (connection.scalar(sa.select(sa.func.count()).where(mine)) or 0) >= MOST:
            raise TooManyLinks(
                f"{MOST:,} links are open, which is the most",
                remedy="Wait until some end, or end all of them",
            )
        until_us = int(connection.scalar(sa.select(db.NowUs())) or 0) + lifetime_s * db.US_PER_S
        made = {"sha256": _digest(ticket, path), "owner": owner, "until_us": until_us}
        connection.execute(sa.insert(links).values(made))
    return ticket, until_us


def find_owner(database: db.Database, ticket: str, path: str) -> str | None:
    """The owner on whose behalf a ticket opens a decoded path; None where it does not, or no more."""
    valid = (links.c.sha256 == _digest(ticket, path)) & (links.c.until_us >= db.NowUs())
    with database.read() as connection:
        return connection.scalar(sa.select(links.c.owner).where(valid))


def end_all(database: db.Database, owner: str) -> None:
    """Let none of an owner's links open anything any more."""
    with database.write() as connection:
        connection.execute(sa.delete(links).where(links.c.owner == owner))


def _digest(ticket: str, path: str) -> str:
    return hashlib.sha256(f"{ticket}\n{path}".encode(errors="surrogatepass")).hexdigest()
