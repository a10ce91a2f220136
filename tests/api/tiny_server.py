"""The command `serve` with tiny jobs besides the real ones: ``python -m tests.api.tiny_server``."""

from __future__ import annotations

import sys
from typing import cast

from scaling_service.api import serving
from scaling_service.cli import main
from scaling_service.runner import launcher, process
from scaling_service.runner.kinds import KINDS, Kind
from scaling_service.runner.process import FROM_PARENT
from tests.api.busy import BUSY
from tests.runner.wholes import WHOLES

if __name__ == "__main__":
    cast("dict[str, Kind]", KINDS).update(WHOLES | BUSY)
    if sys.argv[1:] == [FROM_PARENT]:
        launcher._LAUNCHER = launcher.Launcher("tests.runner.wholes")  # warm at once: tiny jobs need little
        sys.exit(process.main(sys.argv[1:]))
    serving.RunnerProcess.module = "tests.api.tiny_server"
    sys.exit(main(["serve", *sys.argv[1:]]))
