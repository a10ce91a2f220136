"""A connection that reads or writes, what its errors mean, and one clock for all machines.

The clock is the database's, in microseconds since 1970: workers on several machines compare leases with it,
so a machine whose own clock is wrong takes no job from another.
"""

from __future__ import annotations

import contextlib
import os
import sqlite3
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

import sqlalchemy as sa
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.exc import ArgumentError, DBAPIError, DisconnectionError, NoSuchModuleError
from sqlalchemy.exc import TimeoutError as PoolTimeout
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.functions import FunctionElement

from scaling_service.core.errors import DependencyMissing, InputError
from scaling_service.service.store import errors

CONNECT_S = 5
"""Chosen: a PostgreSQL that does not answer by then is reported as unavailable, and tried again later."""

BUSY_S = 10.0
"""How long a writer waits for another. Chosen: the longest write, a cascading delete, takes well under it."""

US_PER_S = 1_000_000

_POSTGRES_FULL = "53100"  # disk_full: PostgreSQL manual, appendix A

_PRAGMAS = (
    "PRAGMA journal_mode=WAL",  # readers never wait for writers
    "PRAGMA synchronous=FULL",  # what a client was told is kept survives a power failure
    "PRAGMA foreign_keys=ON",
    "PRAGMA secure_delete=ON",  # deleted content is overwritten
)


class NowUs(FunctionElement[int]):
    """Time of the database when the statement runs (µs; SQLite's clock has a resolution of 1 ms)."""

    name = "now_us"
    type = sa.BigInteger()
    inherit_cache = True


@compiles(NowUs, "sqlite")
def _compile_for_sqlite(_element: NowUs, _compiler: Any, **_options: Any) -> str:
    # 2440587.5: the Julian day of 1970-01-01 (Meeus 1998, Astronomical Algorithms, chapter 7).
    return "CAST(ROUND((julianday('now') - 2440587.5) * 86400000.0) AS INTEGER) * 1000"


@compiles(NowUs, "postgresql")
def _compile_for_postgresql(_element: NowUs, _compiler: Any, **_options: Any) -> str:
    return "CAST(EXTRACT(EPOCH FROM clock_timestamp()) * 1000000 AS BIGINT)"


def insert_for(connection: sa.Connection) -> Any:
    """The ``insert`` of a connection's own dialect, which knows what to do on conflicts."""
    return postgresql.insert if connection.dialect.name == "postgresql" else sqlite.insert


class Database:
    """A pool of connections to ``sqlite:////path`` or ``postgresql://user:password@host/name``."""

    def __init__(self, url: str | sa.URL) -> None:
        self._engine = _make_engine(_check_url(url))
        self.is_sqlite = self._engine.dialect.name == "sqlite"
        self._turn: contextlib.AbstractContextManager[object] = (
            threading.Lock() if self.is_sqlite else contextlib.nullcontext()
        )

    @contextlib.contextmanager
    def read(self) -> Iterator[sa.Connection]:
        """A transaction that sees one moment and changes nothing."""
        with database_errors(), self._engine.connect() as connection, connection.begin():
            yield connection

    @contextlib.contextmanager
    def write(self) -> Iterator[sa.Connection]:
        """A transaction that is kept whole at the end, or not at all where an error leaves it.

        On SQLite there is one writer at a time. Those of this process wait without a connection, and without
        asking SQLite again and again, which serves whoever happens to ask next.
        """
        with self._turn, database_errors(), self._engine.connect() as connection:
            chosen = connection.execution_options(writes=True)
            with chosen.begin():
                yield chosen

    def run_apart(self, *statements: str) -> list[Any]:
        """Run statements that belong to no transaction, such as VACUUM; the first column of each answer."""
        answers: list[Any] = []
        with self._apart() as connection:
            for statement in statements:
                found = connection.execute(sa.text(statement))
                answers.append(found.scalar() if found.returns_rows else None)
        return answers

    @contextlib.contextmanager
    def session_lock(self, number: int) -> Iterator[None]:
        """Be the only one among all programs on this database that holds the lock (PostgreSQL only)."""
        with self._apart() as connection:
            connection.execute(sa.text("SELECT pg_advisory_lock(:n)"), {"n": number})
            try:
                yield
            finally:
                connection.execute(sa.text("SELECT pg_advisory_unlock(:n)"), {"n": number})

    @contextlib.contextmanager
    def _apart(self) -> Iterator[sa.Connection]:
        # On SQLite no BEGIN is sent; PostgreSQL's driver has a mode for it.
        options = {"apart": True} if self.is_sqlite else {"isolation_level": "AUTOCOMMIT"}
        with database_errors(), self._engine.connect() as connection:
            yield connection.execution_options(**options)

    def close(self) -> None:
        """Give all connections back."""
        self._engine.dispose()


class SqliteFile:
    """The file of a SQLite database: never made by chance, and opened anew where it was changed.

    A disk that failed is mounted again, or a backup is put in place, while the service runs. Connections that
    are open still see the file that was there before. The methods listen to a pool of SQLAlchemy's.
    """

    def __init__(self, path: Path) -> None:
        self._path = path

    def make(self) -> None:
        """Make an empty file, unless there is one."""
        os.close(os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600))

    def connect(self) -> sqlite3.Connection:
        """Open the file; where it is gone, perhaps with its disk, none is made in its place."""
        return sqlite3.connect(
            f"file:{quote(str(self._path))}?mode=rw",
            timeout=BUSY_S,
            uri=True,
            check_same_thread=False,  # a pool's connection has one user at a time
            isolation_level=None,  # transactions are begun by the caller
        )

    def remember_connection(self, raw: Any, record: Any) -> None:
        """Remember which file it is, and how it is used."""
        record.info["file"] = self._identity()
        for pragma in _PRAGMAS:
            raw.execute(pragma)

    def check(self, _raw: Any, record: Any, _proxy: Any) -> None:
        """Have the file opened anew where another stands under its name now."""
        if record.info["file"] != self._identity():
            raise DisconnectionError

    def _identity(self) -> tuple[int, int] | None:
        try:
            found = self._path.stat()
        except OSError:
            return None
        return found.st_dev, found.st_ino


def _check_url(text_url: str | sa.URL) -> sa.URL:
    try:
        url = sa.make_url(text_url)
    except ArgumentError:
        url = None
    kind = None if url is None else url.get_backend_name()
    if url is None or kind not in ("sqlite", "postgresql"):
        raise InputError(
            "this is no database that is supported",
            field="database_url",
            remedy="Use postgresql://user:password@host/name, or leave it out for SQLite",
        )
    return url.set(drivername="postgresql+psycopg") if kind == "postgresql" else url


def _make_engine(url: sa.URL) -> sa.Engine:
    if url.get_backend_name() == "sqlite":
        file = SqliteFile(Path(url.database or ""))
        engine = sa.create_engine(url, creator=file.connect)
        sa.event.listen(engine, "connect", file.remember_connection)
        sa.event.listen(engine, "checkout", file.check)
        sa.event.listen(engine, "begin", _begin_sqlite)
        return engine
    try:
        return sa.create_engine(url, pool_pre_ping=True, connect_args={"connect_timeout": CONNECT_S})
    except (ImportError, NoSuchModuleError) as error:
        raise DependencyMissing(
            "the driver of PostgreSQL is not installed",
            field="database_url",
            remedy="Install it with `pip install 'scaling-service[postgres]'`",
        ) from error


def _begin_sqlite(connection: sa.Connection) -> None:
    # Asking for the write lock first: a transaction that reads and then writes could otherwise not go on.
    options = connection.get_execution_options()
    if not options.get("apart", False):
        connection.exec_driver_sql("BEGIN IMMEDIATE" if options.get("writes", False) else "BEGIN")


@contextlib.contextmanager
def database_errors() -> Iterator[None]:
    """Let errors of the connection leave as the store's; errors of a statement stay what they are."""
    try:
        yield
    except PoolTimeout as error:
        busy = errors.StoreUnavailable("all connections to the database are busy", remedy="Try again later")
        raise busy from error
    except DBAPIError as error:
        known = errors.of_sqlite(error.orig) or _of_postgres(error)
        if known is None:
            raise
        raise known from error


def _of_postgres(error: DBAPIError) -> errors.StoreUnavailable | None:
    state = getattr(error.orig, "sqlstate", None)
    if state == _POSTGRES_FULL:
        return errors.report_full()
    # Classes 08 connection, 53 resources, 57 operator intervention, 25006 read-only, 40 rolled back; or none
    # at all where the server was not reached (PostgreSQL manual, appendix A).
    unreached = state is None and type(error.orig).__module__.startswith("psycopg")
    refused = (state or "").startswith(("08", "53", "57", "25006", "40", "58"))
    if error.connection_invalidated or unreached or refused:
        return errors.StoreUnavailable(
            "the database does not answer now",
            field="database_url",
            remedy="Look whether PostgreSQL runs and can write; the service goes on by itself",
        )
    return None
