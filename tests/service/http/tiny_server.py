"""The command `serve` with tiny jobs besides the real ones: ``python -m tests.service.http.tiny_server``."""

from __future__ import annotations

import sys
from typing import cast

from scaling_service.cli import main
from scaling_service.service.http import serving
from scaling_service.service.jobs import process
from scaling_service.service.jobs.kinds import KINDS, Kind
from scaling_service.service.jobs.process import FROM_PARENT
from scaling_service.service.sandbox import launcher
from tests.service.http.busy import BUSY
from tests.service.jobs.wholes import WHOLES

if __name__ == "__main__":
    cast("dict[str, Kind]", KINDS).update(WHOLES | BUSY)
    if sys.argv[1:] == [FROM_PARENT]:
        launcher._LAUNCHER = launcher.Launcher(
            "tests.service.jobs.wholes"
        )  # warm at once: tiny jobs need little
        sys.exit(process.main(sys.argv[1:]))
    serving.RunnerProcess.module = "tests.service.http.tiny_server"
    sys.exit(main(["serve", *sys.argv[1:]]))
