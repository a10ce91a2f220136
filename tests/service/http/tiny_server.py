"""The command `serve` with tiny jobs besides the real ones: ``python -m tests.service.http.tiny_server``."""

from __future__ import annotations

import sys


def main() -> int:
    """Run the server or its runner; imports stand here, for each process that computes imports this file."""
    from scaling_service import cli
    from scaling_service.service.http import serving
    from scaling_service.service.jobs import process
    from scaling_service.service.jobs.kinds import KINDS
    from scaling_service.service.sandbox import supervisor
    from tests.service.http.busy import BUSY
    from tests.service.jobs.wholes import WHOLES

    KINDS.update(WHOLES | BUSY)  # type: ignore[attr-defined]
    if sys.argv[1:] == [process.FROM_PARENT]:
        supervisor.PRELOAD = "tests.service.jobs.wholes"  # warm at once: tiny jobs need little
        return process.main(sys.argv[1:])
    serving.RunnerProcess.module = "tests.service.http.tiny_server"
    return cli.main(["serve", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
