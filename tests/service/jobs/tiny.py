"""Kinds of jobs that take no time, for tests of everything around them."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

from pydantic import Field

from scaling_service.capabilities.shared.job import Documents, JobRequest, Kind, Needed
from scaling_service.core.errors import MarkerMissing
from scaling_service.service.sandbox.child import Progress


class TinyRequest(JobRequest):
    number: int = 0
    seconds: float = Field(default=0.0, ge=0.0)
    fails: bool = False
    spins: bool = False
    subject: str | None = None
    files: tuple[str, ...] = ()

    @property
    def subjects(self) -> tuple[str, ...]:
        return () if self.subject is None else (self.subject,)

    def list_needed(self, _documents: Documents) -> Needed:
        named = {f"files.{k}": name for k, name in enumerate(self.files)}
        return {} if self.subject is None else {self.subject: named}


def square(request: TinyRequest, inputs: Path, outputs: Path, progress: Progress) -> Any:
    end = time.monotonic() + request.seconds
    while (left := end - time.monotonic()) > 0:
        progress("waiting", 1 - left / max(request.seconds, 1e-9))
        time.sleep(min(left, 0.05))
    while request.spins:
        pass
    if request.fails:
        raise MarkerMissing("RASIS", "walk", ["RKNE"])
    read = {p.name: p.read_text() for p in sorted(inputs.rglob("*")) if p.is_file()}
    (outputs / "square.txt").write_text(str(request.number**2))
    return {"square": request.number**2, "read": read, "pid": os.getpid()}


TINY = {
    "tiny": Kind(request=TinyRequest, work=square, route="tiny"),
    "brief": Kind(request=TinyRequest, work=square, route="brief", brief=True),
}


def warm_little() -> None:
    """Tiny jobs need little: a fork server of this process imports no more than they do."""
    from scaling_service.service.sandbox import supervisor

    supervisor.PRELOAD = __name__
