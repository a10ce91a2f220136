"""Bounds on memory, time and files of one process."""

from __future__ import annotations

import resource
from dataclasses import dataclass
from pathlib import Path

from scaling_service.core.errors import InputError

GRACE_CPU_S = 5
"""Between the signal that can be told from others and the one that cannot be ignored. Chosen."""


class LimitExceeded(InputError):
    """A job needed more than it is allowed to."""


@dataclass(frozen=True, slots=True)
class Limits:
    """What one job may use.

    Parameters
    ----------
    memory_bytes : int
        Address space on top of what the program itself takes; for each process of the job.
    cpu_s, wall_s : float
        Processor time of each process, and time on the clock of the whole.
    file_bytes, output_bytes : int
        Of each file that is written, and of all results together.
    """

    memory_bytes: int = 4 << 30
    cpu_s: float = 3600.0
    wall_s: float = 7200.0
    file_bytes: int = 1 << 30
    output_bytes: int = 2 << 30


def apply(limits: Limits) -> None:
    """Bound this process and all that it starts; there is no way back."""
    cpu = max(1, round(limits.cpu_s))
    _set(resource.RLIMIT_CORE, 0, 0)  # a dump would hold a patient's data
    _set(resource.RLIMIT_AS, *2 * (_address_space() + limits.memory_bytes,))
    _set(resource.RLIMIT_CPU, cpu, cpu + GRACE_CPU_S)
    _set(resource.RLIMIT_FSIZE, limits.file_bytes, limits.file_bytes)


def exceeded(what: str, limit: str, setting: str) -> LimitExceeded:
    """The error for a bound that was reached."""
    return LimitExceeded(
        f"the job needed more than {limit} of {what}",
        field=setting,
        remedy="Check that the files are sound and shorten the recordings, or raise the limit of the service",
    )


def out_of_memory(limits: Limits) -> LimitExceeded:
    """More memory than allowed."""
    return exceeded("memory", f"{limits.memory_bytes / 1e9:.3g} GB", "limit_memory_mb")


def out_of_time(limits: Limits) -> LimitExceeded:
    """More time on the clock than allowed."""
    return exceeded("time", f"{limits.wall_s:g} s", "limit_wall_s")


def out_of_cpu(limits: Limits) -> LimitExceeded:
    """More processor time than allowed."""
    return exceeded("processor time", f"{limits.cpu_s:g} s", "limit_cpu_s")


def too_much_output(limits: Limits) -> LimitExceeded:
    """Larger results than allowed."""
    return exceeded("disk", f"{limits.output_bytes / 1e6:g} MB", "limit_output_mb")


def too_large_file(limits: Limits) -> LimitExceeded:
    """A larger file than allowed."""
    return exceeded("disk for one file", f"{limits.file_bytes / 1e6:g} MB", "limit_file_mb")


def size_of(folder: Path) -> int:
    """Bytes of all files below a folder, whatever else happens to them meanwhile."""
    total = 0
    for path in folder.rglob("*"):
        try:
            total += path.lstat().st_size
        except OSError:  # removed since it was listed
            continue
    return total


def _address_space() -> int:
    """Bytes of address space that this process has now."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    return pages * resource.getpagesize()


def _set(what: int, soft: int, hard: int) -> None:
    """A bound that is at most what was already in force."""
    _, most = resource.getrlimit(what)
    if most != resource.RLIM_INFINITY:
        soft, hard = min(soft, most), min(hard, most)
    resource.setrlimit(what, (soft, hard))
