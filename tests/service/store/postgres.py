"""A PostgreSQL server of the tests' own, in a temporary folder, never as root."""

from __future__ import annotations

import atexit
import os
import pwd
import shutil
import subprocess
import tempfile
from functools import cache
from itertools import count
from pathlib import Path

import pytest

_PATHS = os.pathsep.join([os.environ.get("PATH", ""), *map(str, Path("/usr/lib/postgresql").glob("*/bin"))])
_NUMBERS = count(1)


class Server:
    """A server that can be stopped and started."""

    def __init__(self) -> None:
        self._folder = Path(tempfile.mkdtemp(prefix="pg"))  # short: it holds a socket
        self._user: str | None = None
        if os.geteuid() == 0:
            known = {entry.pw_name for entry in pwd.getpwall()}
            self._user = next(name for name in ("postgres", "nobody") if name in known)
            shutil.chown(self._folder, self._user)
        self._run("initdb", "-D", str(self._data), "-U", "tests", "-A", "trust", "-E", "UTF8", "--no-sync")
        self.start()

    @property
    def _data(self) -> Path:
        return self._folder / "data"

    def start(self) -> None:
        options = f"-k {self._folder} -c listen_addresses='' -c fsync=off -c max_connections=60"
        self._run(
            "pg_ctl", "-D", str(self._data), "-w", "-o", options, "-l", str(self._folder / "log"), "start"
        )

    def stop(self) -> None:
        self._run("pg_ctl", "-D", str(self._data), "-w", "-m", "immediate", "stop")

    def remove(self) -> None:
        if (self._data / "postmaster.pid").exists():
            self.stop()
        shutil.rmtree(self._folder, ignore_errors=True)

    def url(self, name: str = "postgres") -> str:
        return f"postgresql://tests@/{name}?host={self._folder}"

    def new_database(self) -> str:
        """The URL of an empty database."""
        name = f"t{next(_NUMBERS)}"
        self._run("createdb", "-h", str(self._folder), "-U", "tests", name)
        return self.url(name)

    def _run(self, program: str, *arguments: str) -> None:
        found = shutil.which(program, path=_PATHS)
        assert found is not None
        done = subprocess.run(
            [found, *arguments],
            user=self._user,
            cwd=self._folder,
            env={"PATH": _PATHS, "LC_ALL": "C"},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE if program != "pg_ctl" else subprocess.DEVNULL,
            timeout=60,
            check=False,
        )
        assert done.returncode == 0, f"{program}: {done.stderr!r}"


def require() -> None:
    """Skip where there is no PostgreSQL."""
    pytest.importorskip("psycopg", reason="the driver of PostgreSQL is not installed")
    for program in ("initdb", "pg_ctl", "createdb"):
        if shutil.which(program, path=_PATHS) is None:
            pytest.skip(f"PostgreSQL's {program} is not installed")


@cache
def server() -> Server:
    """The one server that tests share; skips where there is none."""
    require()
    made = Server()
    atexit.register(made.remove)
    return made
