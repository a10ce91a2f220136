"""The command `serve` in a process of its own."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
COMMAND = [sys.executable, "-m", "scaling_service"]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT), "SCALING_SERVICE_RESERVE_MB": "0"}


def start(
    folder: Path, *arguments: str, command: list[str] | None = None
) -> tuple[subprocess.Popen[str], str]:
    """A service that answers, and its address."""
    with (folder.parent / "log").open("a") as log:
        process = subprocess.Popen(
            [*(command or [*COMMAND, "serve"]), "--port", "0", "--data", str(folder), *arguments],
            env=ENVIRONMENT,
            stdout=subprocess.PIPE,
            stderr=log,
            text=True,
            start_new_session=True,
        )
    assert process.stdout is not None
    line = process.stdout.readline()
    assert line.startswith("Listening on http://127.0.0.1:"), line
    return process, line.split()[2].rstrip(",")


@contextmanager
def served(folder: Path, *arguments: str, command: list[str] | None = None) -> Iterator[str]:
    """The address of a service that ends with the block, tidily."""
    process, url = start(folder, *arguments, command=command)
    try:
        yield url
    finally:
        process.terminate()
        assert process.stdout is not None
        process.stdout.close()
        assert process.wait(30) == 0


def free_port() -> int:
    """A port that nobody uses now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
