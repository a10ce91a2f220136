"""Bounds on memory, time and files of one process."""

from __future__ import annotations

import os
import resource
from dataclasses import dataclass
from pathlib import Path

from scaling_service.core.errors import InputError

GRACE_CPU_S = 5  # between the signal that can be told from others and the one that cannot be ignored. Chosen.


class LimitExceeded(InputError):
    """A job needed more than it is allowed to."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """What one job may use."""

    memory_bytes: int = 4 << 30
    """Address space on top of what the program itself takes; for each process of the job."""
    cpu_s: float = 3600.0  # processor time of each process
    cpu_setting: str = "limit_cpu_s"  # that says so
    niceness: int = 15  # how far it gives way to others
    wall_s: float = 7200.0  # time on the clock of the whole
    file_bytes: int = 1 << 30
    output_bytes: int = 2 << 30  # of all results together

    def apply(self) -> None:
        """Bound this process and all that it starts; there is no way back."""
        os.nice(self.niceness)
        cpu = max(1, round(self.cpu_s))
        _set(resource.RLIMIT_CORE, 0, 0)  # a dump would hold a patient's data
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        _set(resource.RLIMIT_AS, *2 * ((pages * resource.getpagesize()) + self.memory_bytes,))
        _set(resource.RLIMIT_CPU, cpu, cpu + GRACE_CPU_S)
        _set(resource.RLIMIT_FSIZE, self.file_bytes, self.file_bytes)

    def report_exceeded(self, setting: str) -> LimitExceeded:
        """The error for a bound that was reached, by the name of its setting."""
        limit, what = {
            "limit_memory_mb": (f"{self.memory_bytes / 1e9:.3g} GB", "memory"),
            self.cpu_setting: (f"{self.cpu_s:g} s", "processor time"),
            "limit_wall_s": (f"{self.wall_s:g} s", "time"),
            "limit_file_mb": (f"{self.file_bytes / 1e6:g} MB", "disk for one file"),
            "limit_output_mb": (f"{self.output_bytes / 1e6:g} MB", "disk"),
        }[setting]
        remedy = (
            "Check that the files are sound and shorten the recordings, or raise the limit of the service"
        )
        return LimitExceeded(f"the job needed more than {limit} of {what}", field=setting, remedy=remedy)


def _set(what: int, soft: int, hard: int) -> None:
    """A bound that is at most what was already in force."""
    _, most = resource.getrlimit(what)
    if most != resource.RLIM_INFINITY:
        soft, hard = min(soft, most), min(hard, most)
    resource.setrlimit(what, (soft, hard))
