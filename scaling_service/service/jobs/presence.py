"""A runner shows that it lives by a lock, which the kernel lets go however the runner ends.

Runners of the same machine see at once when one of them was killed, and take its jobs back without
waiting for the leases. Of other machines nothing is concluded: there the leases decide.
"""

from __future__ import annotations

import fcntl
import os
import secrets
from collections.abc import Iterable
from pathlib import Path
from typing import IO

from scaling_service.service.store.errors import disk_errors

_BOOT = Path("/proc/sys/kernel/random/boot_id")


def machine() -> str:
    """A name of this machine since it was started, the same in all its containers.

    Where the kernel gives none, a name of this process: nothing is then concluded of others.
    """
    try:
        return _BOOT.read_text(encoding="ascii").strip().replace("-", "")[:12]
    except OSError:
        return f"p{os.getpid()}x{secrets.token_hex(4)}"


class Presence:
    """The lock of one runner in a data directory."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder / "runners"
        self._machine = machine()
        self.name = f"{self._machine}-{os.getpid()}-{secrets.token_hex(4)}"
        with disk_errors(folder):
            self._folder.mkdir(mode=0o700, exist_ok=True)
            hidden = self._folder / f".{self.name}"
            self._file: IO[str] = hidden.open("x", encoding="ascii")
            fcntl.flock(self._file, fcntl.LOCK_EX)
            hidden.rename(self._folder / self.name)  # locked before anyone can see it

    def dead(self, names: Iterable[str]) -> list[str]:
        """Those runners that were on this machine and are no more."""
        mine = [name for name in names if name.startswith(f"{self._machine}-") and name != self.name]
        with disk_errors(self._folder):
            return [name for name in mine if not _is_locked(self._folder / name)]

    def forget_dead(self) -> None:
        """Remove what dead runners of this machine left."""
        with disk_errors(self._folder):
            for name in self.dead(path.name for path in self._folder.iterdir()):
                (self._folder / name).unlink(missing_ok=True)

    def close(self) -> None:
        """Be gone."""
        (self._folder / self.name).unlink(missing_ok=True)
        self._file.close()


def _is_locked(file: Path) -> bool:
    """Whether a living process holds the file; one that is not there is held by nobody."""
    try:
        with file.open("r", encoding="ascii") as handle:
            fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
            return False
    except BlockingIOError:
        return True
    except FileNotFoundError:
        return False
