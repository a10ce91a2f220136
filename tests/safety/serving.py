"""The service as the command line starts it."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.safety.running import program_environment

_ENDS_S = 30.0


@contextmanager
def serve(folder: Path) -> Iterator[str]:
    """The address of a service that keeps its data in a folder; it ends with the block."""
    command = [
        sys.executable,
        "-m",
        "scaling_service",
        "serve",
        "--port",
        "0",
        "--data",
        str(folder / "data"),
    ]
    environment = program_environment() | {"SCALING_SERVICE_RESERVE_MB": "0"}
    with (
        (folder / "errors.txt").open("w") as errors,
        subprocess.Popen(
            command, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=errors, text=True
        ) as service,
    ):
        try:
            assert service.stdout is not None
            said = service.stdout.readline()
            listening = re.search(r"Listening on (\S+?),", said)
            assert listening, said + (folder / "errors.txt").read_text()
            yield listening[1]
        finally:
            service.terminate()
            service.wait(_ENDS_S)
