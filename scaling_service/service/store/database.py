"""A connection that reads or writes, and what its errors mean."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sqlalchemy import URL, Connection, Engine, create_engine, event, make_url, text
from sqlalchemy.exc import ArgumentError, DBAPIError, NoSuchModuleError
from sqlalchemy.exc import TimeoutError as PoolTimeout

from scaling_service.core.errors import DependencyMissing, InputError
from scaling_service.service.store.errors import StoreUnavailable, full, of_sqlite
from scaling_service.service.store.sqlite_file import SqliteFile

CONNECT_S = 5
"""Chosen: a PostgreSQL that does not answer by then is told of as unavailable, and tried again later."""

_POSTGRES_FULL = "53100"  # disk_full: PostgreSQL manual, appendix A


class Database:
    """A pool of connections to SQLite or PostgreSQL.

    Parameters
    ----------
    url : str or URL
        ``sqlite:////path`` or ``postgresql://user:password@host/name``.

    Raises
    ------
    InputError
        It is no URL of one of the two.
    DependencyMissing
        The driver of PostgreSQL is not installed.
    """

    def __init__(self, url: str | URL) -> None:
        self._engine = _engine(_checked(url))
        self.is_sqlite = self._engine.dialect.name == "sqlite"

    @contextmanager
    def read(self) -> Iterator[Connection]:
        """A transaction that sees one moment and changes nothing.

        Raises
        ------
        StoreUnavailable
            The database does not answer.
        """
        with database_errors(), self._engine.connect() as connection, connection.begin():
            yield connection

    @contextmanager
    def write(self) -> Iterator[Connection]:
        """A transaction that is kept whole at the end, or not at all where an error leaves it.

        On SQLite there is one writer at a time; the others wait.

        Raises
        ------
        StoreUnavailable
            The database does not answer, or is full or read-only; nothing was changed.
        """
        with database_errors(), self._engine.connect() as connection:
            chosen = connection.execution_options(writes=True)
            with chosen.begin():
                yield chosen

    def run_apart(self, *statements: str) -> list[Any]:
        """Run statements that belong to no transaction, such as VACUUM; the first column of each answer."""
        answers: list[Any] = []
        with self._apart() as connection:
            for statement in statements:
                found = connection.execute(text(statement))
                answers.append(found.scalar() if found.returns_rows else None)
        return answers

    @contextmanager
    def session_lock(self, number: int) -> Iterator[None]:
        """Be the only one among all programs on this database that holds the lock (PostgreSQL only)."""
        with self._apart() as connection:
            connection.execute(text("SELECT pg_advisory_lock(:n)"), {"n": number})
            try:
                yield
            finally:
                connection.execute(text("SELECT pg_advisory_unlock(:n)"), {"n": number})

    @contextmanager
    def _apart(self) -> Iterator[Connection]:
        # On SQLite no BEGIN is sent; PostgreSQL's driver has a mode for it.
        options = {"apart": True} if self.is_sqlite else {"isolation_level": "AUTOCOMMIT"}
        with database_errors(), self._engine.connect() as connection:
            yield connection.execution_options(**options)

    def close(self) -> None:
        """Give all connections back."""
        self._engine.dispose()


def _checked(text_url: str | URL) -> URL:
    try:
        url = make_url(text_url)
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


def _engine(url: URL) -> Engine:
    if url.get_backend_name() == "sqlite":
        file = SqliteFile(Path(url.database or ""))
        engine = create_engine(url, creator=file.connect)
        event.listen(engine, "connect", file.connected)
        event.listen(engine, "checkout", file.check)
        event.listen(engine, "begin", _begin_sqlite)
        return engine
    try:
        return create_engine(url, pool_pre_ping=True, connect_args={"connect_timeout": CONNECT_S})
    except (ImportError, NoSuchModuleError) as error:
        raise DependencyMissing(
            "the driver of PostgreSQL is not installed",
            field="database_url",
            remedy="Install it with `pip install 'scaling-service[postgres]'`",
        ) from error


def _begin_sqlite(connection: Connection) -> None:
    # Asking for the write lock first: a transaction that reads and then writes could otherwise not go on.
    options = connection.get_execution_options()
    if not options.get("apart", False):
        connection.exec_driver_sql("BEGIN IMMEDIATE" if options.get("writes", False) else "BEGIN")


@contextmanager
def database_errors() -> Iterator[None]:
    """Let errors of the connection leave as the store's; errors of a statement stay what they are."""
    try:
        yield
    except PoolTimeout as error:
        raise StoreUnavailable(
            "all connections to the database are busy", remedy="Try again later"
        ) from error
    except DBAPIError as error:
        known = of_sqlite(error.orig) or _of_postgres(error)
        if known is None:
            raise
        raise known from error


def _of_postgres(error: DBAPIError) -> StoreUnavailable | None:
    state = getattr(error.orig, "sqlstate", None)
    if state == _POSTGRES_FULL:
        return full()
    # Classes 08 connection, 53 resources, 57 operator intervention, 25006 read-only, 40 rolled back; or none
    # at all where the server was not reached (PostgreSQL manual, appendix A).
    lost = error.connection_invalidated or (
        state is None and type(error.orig).__module__.startswith("psycopg")
    )
    if lost or (state or "").startswith(("08", "53", "57", "25006", "40", "58")):
        return StoreUnavailable(
            "the database does not answer now",
            field="database_url",
            remedy="Look whether PostgreSQL runs and can write; the service goes on by itself",
        )
    return None
