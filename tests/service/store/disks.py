"""A small disk that can be filled and made read-only."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest


class SmallDisk:
    """A file system in memory, mounted on a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def fill(self) -> None:
        """Leave no room at all."""
        size = 1 << 20
        with (self.folder / "filler").open("ab", buffering=0) as file:
            while size:
                try:
                    file.write(b"x" * size)
                except OSError:
                    size //= 2

    def empty(self) -> None:
        """Make room again."""
        (self.folder / "filler").unlink()

    def make_read_only(self) -> None:
        _mount("-o", "remount,ro", str(self.folder))

    def make_writable(self) -> None:
        _mount("-o", "remount,rw", str(self.folder))


@contextmanager
def small_disk(folder: Path, megabytes: int) -> Iterator[SmallDisk]:
    """Such a disk; skips where this user may not mount one."""
    folder.mkdir()
    try:
        _mount("-t", "tmpfs", "-o", f"size={megabytes}m", "tmpfs", str(folder))
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("this user may not mount a disk")
    try:
        yield SmallDisk(folder)
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True, capture_output=True)


def _mount(*arguments: str) -> None:
    subprocess.run(["mount", *arguments], check=True, capture_output=True)


class FailingDisk:
    """A disk of its own that can fail: the kernel then lets nobody write to it, whoever has files open."""

    def __init__(self, folder: Path, image: Path) -> None:
        self.folder, self._image = folder, image
        self._devices: list[str] = []

    def mount(self) -> None:
        device = _output("losetup", "--find", "--show", str(self._image))
        self._devices.append(device)
        _mount("-o", "errors=remount-ro", device, str(self.folder))

    def fail(self) -> None:
        """What an error of the device does to a file system."""
        _output("sync", "--file-system", str(self.folder))
        (Path("/sys/fs/ext4") / Path(self._devices[-1]).name / "trigger_fs_error").write_text("1")

    def repair(self) -> None:
        """What an administrator does, without asking anyone to close their files."""
        _output("umount", "--lazy", str(self.folder))
        subprocess.run(["e2fsck", "-fy", str(self._image)], check=False, capture_output=True)
        self.mount()

    def remove(self) -> None:
        subprocess.run(["umount", "--lazy", str(self.folder)], check=False, capture_output=True)
        for device in self._devices:
            _output("losetup", "--detach", device)


@contextmanager
def failing_disk(folder: Path, megabytes: int) -> Iterator[FailingDisk]:
    """Such a disk; skips where this user may not mount one."""
    folder.mkdir()
    image = folder.with_suffix(".img")
    with image.open("wb") as file:
        file.truncate(megabytes << 20)
    disk = FailingDisk(folder, image)
    try:
        _output("mkfs.ext4", "-q", "-F", str(image))
        disk.mount()
    except (OSError, subprocess.CalledProcessError):
        disk.remove()
        pytest.skip("this user may not mount a disk of its own")
    try:
        yield disk
    finally:
        disk.remove()


def _output(*command: str) -> str:
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()
