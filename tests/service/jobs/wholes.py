"""A kind of job that is made of others, which take no time."""

from __future__ import annotations

import json
import os
import signal
import time
from pathlib import Path
from typing import Any

from pydantic import Field

from scaling_service.capabilities.shared.job import Kind, Parts
from scaling_service.documents.base import PARTS
from scaling_service.service.sandbox.child import Progress
from tests.service.jobs.tiny import TINY, TinyRequest, square


class PartRequest(TinyRequest):
    crashes: bool = False


class WholeRequest(TinyRequest):
    numbers: tuple[int, ...] = Field(default=(1, 2, 3))
    failing: tuple[int, ...] = ()
    crashing: tuple[int, ...] = ()

    def parts(self) -> list[PartRequest]:
        return [
            PartRequest(number=k, seconds=self.seconds, fails=k in self.failing, crashes=k in self.crashing)
            for k in self.numbers
        ]


def part(request: PartRequest, inputs: Path, outputs: Path, progress: Progress) -> Any:
    if request.crashes:
        os.kill(os.getpid(), signal.SIGSEGV)
        time.sleep(10)
    found = square(request, inputs, outputs, progress)
    (outputs / str(request.number)).mkdir()
    (outputs / "square.txt").rename(outputs / str(request.number) / "square.txt")
    return {"number": request.number, "pid": found["pid"]}


def whole(request: WholeRequest, inputs: Path, outputs: Path, _progress: Progress) -> Any:
    """The sum of the squares that the parts found, and what did not end well."""
    ends = json.loads((inputs / PARTS).read_text())
    total = sum(int(file.read_text()) for file in inputs.rglob("square.txt"))
    (outputs / "sum.txt").write_text(str(total))
    return {
        "sum": total,
        "numbers": [end["request"]["number"] for end in ends],
        "failed": [end["request"]["number"] for end in ends if end["state"] == "failed"],
    }


WHOLES = TINY | {
    "whole": Kind(
        request=WholeRequest,
        work=whole,
        route="whole",
        parts=Parts(kind="part", requests=WholeRequest.parts, file="square.txt"),
    ),
    "part": Kind(request=PartRequest, work=part, route=None),
}
