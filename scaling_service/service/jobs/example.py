"""The built-in example put among an owner's subjects; it is made in a process of its own."""

from __future__ import annotations

import json
import subprocess
import tempfile
import threading
from pathlib import Path

from scaling_service.capabilities.shared.job import list_named_files
from scaling_service.core.errors import InputError
from scaling_service.documents.base import DOCUMENT
from scaling_service.documents.reading import check_document
from scaling_service.service.jobs.service import Service
from scaling_service.service.sandbox.supervisor import find_python
from scaling_service.service.store import errors

NAME = "example"
MOST = 5  # examples that can be had. Chosen: enough for a cohort's statistics, made in ten seconds.
TIME_LIMIT_S = 120.0  # for one example. Chosen: it takes two seconds, on a busy machine some twenty.


_MAKER = "scaling_service.virtual.example"  # run apart: who only answers requests does without numpy


class ExampleFailed(InputError):
    """The example could not be made."""


class Examples:
    """Puts examples into a service, one at a time."""

    def __init__(self, service: Service) -> None:
        self._service, self._alone = service, threading.Lock()

    def put(self, owner: str, persons: int) -> tuple[list[str], bool]:
        """Give an owner the first examples: the names of the subjects, and whether any was not there.

        InUse where a subject of the same name is not the example, ExampleFailed where it could not be made.
        """
        names = [NAME if seed == 0 else f"{NAME}_{seed + 1}" for seed in range(persons)]
        with self._alone:
            missing = [seed for seed, name in enumerate(names) if not self._is_there(owner, name)]
            for seed in missing:
                name = names[seed]
                with tempfile.TemporaryDirectory(prefix="example-") as scratch:
                    folder = Path(scratch)
                    _run(folder, name, seed)
                    document = json.loads((folder / DOCUMENT).read_text(encoding="utf-8"))
                    self._service.put_subject(owner, document)
                    for file in sorted(folder.iterdir()):
                        if file.name != DOCUMENT:
                            with self._service.upload(owner, name, file.name) as upload:
                                upload.write(file.read_bytes())
                                upload.keep()
        return names, bool(missing)

    def _is_there(self, owner: str, name: str) -> bool:
        try:
            document = self._service.subject_document(owner, name)
        except errors.NotFound:
            return False
        if "trials" not in document or document.get("image_markers") != "image_markers.csv":
            raise errors.InUse(
                f"you have a subject '{name}' of your own",
                field="subject",
                remedy="Delete it, or upload it under another name, then ask for the example again",
            )
        wanted = set(list_named_files(check_document(document)).values())
        return wanted <= {file.name for file in self._service.subject_files(owner, name)}


def _run(folder: Path, name: str, seed: int) -> None:
    command, environment = find_python(_MAKER, str(folder), name, str(seed))
    try:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            cwd=folder,
            env=environment,
            timeout=TIME_LIMIT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise ExampleFailed(
            f"the example was not made within {TIME_LIMIT_S:g} s",
            remedy="Try again when the machine is less busy",
        ) from None
    if done.returncode != 0:
        last = done.stderr.decode(errors="replace").strip().splitlines()[-1:]
        raise ExampleFailed(f"the example could not be made: {' '.join(last)[:300]}", remedy="Report it")
