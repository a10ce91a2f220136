"""What the tests let children do: small things, and everything that a child must not."""

from __future__ import annotations

import errno
import fcntl
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from scaling_service.core.errors import MarkerMissing
from scaling_service.service.sandbox.child import Progress


def add(folder: Path, progress: Progress) -> Any:
    progress("adding", 0.5)
    (folder / "outputs" / "part").mkdir()
    (folder / "outputs" / "part" / "sum.txt").write_text("3")
    return {"sum": 3}


def memory_bomb(folder: Path, progress: Progress) -> Any:
    return len(b"x" * (4 << 30))


def busy(folder: Path, progress: Progress) -> Any:
    while True:
        pass


def sleep(folder: Path, progress: Progress) -> Any:
    time.sleep(60)


def one_large_file(folder: Path, progress: Progress) -> Any:
    (folder / "outputs" / "large").write_bytes(b"x" * (1 << 22))


def many_files(folder: Path, progress: Progress) -> Any:
    for k in range(10_000):
        (folder / "outputs" / str(k)).write_bytes(b"x" * (1 << 18))
        time.sleep(0.02)


def refuse(folder: Path, progress: Progress) -> Any:
    error = MarkerMissing("RASIS", "walk", ["RKNE"])
    error.file = str(folder / "inputs" / "S01" / "walk.trc")
    raise error


def broken(folder: Path, progress: Progress) -> Any:
    return {"patient Smith": 1}["Jones"]


def crash(folder: Path, progress: Progress) -> Any:
    os.kill(os.getpid(), signal.SIGSEGV)
    time.sleep(10)


def killed(folder: Path, progress: Progress) -> Any:
    os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(10)


def no_room(folder: Path, progress: Progress) -> Any:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def garbage(folder: Path, progress: Progress) -> Any:
    """What a child might send once foreign bytes have taken it over."""
    for descriptor in range(3, 64):
        try:
            os.write(descriptor, b"\x00{]" * 100 + b"\n")
        except OSError:
            continue
    time.sleep(10)


def nan(folder: Path, progress: Progress) -> Any:
    return {"value": float("nan")}


def grandchild(folder: Path, progress: Progress) -> Any:
    """Start a process, say its number, and wait."""
    started = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    (folder / "outputs" / "pids").write_text(f"{os.getpid()} {started.pid}")
    time.sleep(60)


def abandon(folder: Path, progress: Progress) -> Any:
    """Start a process, and end without waiting for it."""
    started = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    return {"pid": started.pid}


def crash_with_child(folder: Path, progress: Progress) -> Any:
    started = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    (folder / "outputs" / "pids").write_text(f"{os.getpid()} {started.pid}")
    os.kill(os.getpid(), signal.SIGSEGV)
    time.sleep(10)


def environment(folder: Path, progress: Progress) -> Any:
    ours = [name for name in os.environ if name.startswith("SCALING_SERVICE_")]
    return {"ours": ours, "temporary": tempfile.gettempdir()}


def mad_progress(folder: Path, progress: Progress) -> Any:
    """Progress that no database would take, and a result that is fine."""
    progress("a\x00b\ud800" * 3, float("nan"))
    progress("large", 1e300)
    return {}


def mad_name(folder: Path, progress: Progress) -> Any:
    os.close(os.open(os.fsencode(folder / "outputs") + b"/\xff\x01", os.O_CREAT))
    return {}


def mad_result(folder: Path, progress: Progress) -> Any:
    """A result that was written behind the back of what checks it."""
    os.write(message_pipe(), b'{"finished": true}\n' if write_nan(folder) else b"")
    time.sleep(10)


def mad_failure(folder: Path, progress: Progress) -> Any:
    os.write(message_pipe(), b'{"failure": {"kind": "\\ud800", "problem": "a\\u0000b"}}\n')
    time.sleep(10)


def link(folder: Path, progress: Progress) -> Any:
    (folder / "outputs" / "passwords").symlink_to("/etc/passwd")
    return {}


def write_nan(folder: Path) -> bool:
    return bool((folder / "result.json").write_text('{"value": NaN}'))


def message_pipe() -> int:
    """The pipe to the supervisor: of the two that are open, the one that can be written to."""
    for descriptor in range(3, 256):
        try:
            if fcntl.fcntl(descriptor, fcntl.F_GETFL) & os.O_ACCMODE == os.O_WRONLY:
                return descriptor
        except OSError:
            continue
    raise AssertionError("there is no pipe")
