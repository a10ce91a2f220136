"""A kind of job that keeps a processor busy, for tests of the service under load."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from scaling_service.capabilities.shared.job import Kind
from scaling_service.service.sandbox.child import Progress
from tests.service.jobs.tiny import TinyRequest


class BusyRequest(TinyRequest):
    pass


def spin(request: BusyRequest, _inputs: Path, outputs: Path, _progress: Progress) -> Any:
    end = time.process_time() + request.seconds
    while time.process_time() < end:
        pass
    (outputs / "number.txt").write_text(str(request.number))
    return {"number": request.number}


BUSY = {"busy": Kind(request=BusyRequest, work=spin, route="busy")}
