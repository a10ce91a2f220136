"""OpenSim models in and out, as body models: the opensim library works in another process, asked in JSON.

That process loads the library once and answers every request in a fork of itself, so that a crash, or what
OpenSim keeps in mind, ends with the request.
"""

from __future__ import annotations

import atexit
import dataclasses
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
import uuid
from collections import abc
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from scaling_service.core import errors
from scaling_service.files.osim.setups import parse_xml
from scaling_service.model import body, document
from scaling_service.model.results import JointMove

TIME_LIMIT_S = 120.0
"""Chosen: loading the largest public models takes about one second, also on a busy machine some ten."""

_WORKER = "scaling_service.files.osim.worker"
_KINDS: abc.Mapping[str, type[errors.InputError]] = {
    kind.__name__: kind
    for kind in (errors.DependencyMissing, errors.FileUnreadable, errors.ModelRefused, errors.InputError)
}


_GRAVITY = re.compile(rb"<gravity>\s*([^<]*?)\s*</gravity>")

_NO_FACTORS: abc.Mapping[str, body.Vector] = MappingProxyType({})
_NO_TILTS: abc.Mapping[str, tuple[float, float]] = MappingProxyType({})
_NO_MOVES: abc.Mapping[str, JointMove] = MappingProxyType({})


def read_vertical(path: Path) -> int:
    """Which axis of an OpenSim model its gravity points along, 0 to 2; y where the file does not say."""
    found = _GRAVITY.search(path.read_bytes())
    try:
        parts = [abs(float(part)) for part in found[1].split()] if found else []
    except ValueError:
        return 1
    return parts.index(max(parts)) if len(parts) == 3 and max(parts) > 0.0 else 1


def ask(request: abc.Mapping[str, Any], *, time_limit_s: float = TIME_LIMIT_S) -> dict[str, Any]:
    """Send one request to a worker and return its answer.

    ``request``: JSON-ready; ``file`` names the file that an unexplained failure is blamed on. Raises
    DependencyMissing if opensim is not installed. Raises FileUnreadable if OpenSim cannot read the file,
    crashes on it or takes too long. Raises ModelRefused if the model holds a component that cannot be
    represented.
    """
    with tempfile.TemporaryDirectory(prefix="osim-", ignore_cleanup_errors=True) as scratch:
        began = time.monotonic()
        reply = _stand_by(os.getpid()).carry_out(request, scratch, time_limit_s)
    if "answer" not in reply:
        said, why = f"ended without an answer ({reply['ended']})", "whether it is sound"
        if time.monotonic() - began >= time_limit_s:
            said, why = f"gave no answer within {time_limit_s:g} s", "where it hangs"
        remedy = f"Open the file in OpenSim itself to see {why}"
        raise errors.FileUnreadable(f"OpenSim {said}", file=request.get("file"), remedy=remedy)
    answer: dict[str, Any] = reply["answer"]
    if "error" in answer:
        raise _make_error(answer["error"], request)
    return answer


def _make_error(problem: abc.Mapping[str, Any], request: abc.Mapping[str, Any]) -> errors.InputError:
    return _KINDS.get(problem["kind"], errors.InputError)(
        problem["problem"],
        file=problem["file"] or request.get("file"),
        field=problem["field"],
        remedy=problem["remedy"],
    )


@dataclasses.dataclass(slots=True, eq=False)
class _Worker:
    """A process that carries out one request after another; it starts with the first, and anew if it died.

    ``owner``: the process that asks; what is forked from it has a worker of its own.
    """

    owner: int
    process: subprocess.Popen[str] | None = None
    turn: threading.Lock = dataclasses.field(default_factory=threading.Lock)

    def carry_out(self, request: abc.Mapping[str, Any], scratch: str, time_limit_s: float) -> dict[str, Any]:
        """The ``answer`` to a request that is carried out in a folder, or how it ``ended`` without one."""
        with self.turn:
            if self.process is None or self.process.poll() is not None:
                self.process = _start_process(scratch)
            process = self.process
            assert process.stdin is not None
            assert process.stdout is not None
            clock = threading.Timer(time_limit_s, process.kill)
            clock.start()
            try:
                asked = {"request": dict(request), "scratch": scratch, "time_limit_s": time_limit_s}
                with suppress(BrokenPipeError):  # it has died, and says nothing
                    process.stdin.write(json.dumps(asked) + "\n")
                    process.stdin.flush()
                line = process.stdout.readline()
            except BaseException:
                process.kill()  # or the next request would get this one's answer
                raise
            finally:
                clock.cancel()
            reply: dict[str, Any] = json.loads(line) if line.endswith("\n") else {"ended": process.wait()}
        if isinstance(code := reply.get("ended"), int):
            reply["ended"] = signal.Signals(-code).name if code < 0 else f"exit {code}"
        return reply


_stand_by = lru_cache(maxsize=2)(_Worker)


def _start_process(folder: str) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-m", _WORKER],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        encoding="utf-8",
        cwd=folder,
        env=make_environment(),
    )

    def end() -> None:
        process.kill()
        process.communicate()

    atexit.register(end)
    return process


def make_environment() -> dict[str, str]:
    """The caller's environment, with this package importable and one thread per library."""
    root = str(Path(__file__).resolve().parents[3])
    path = os.environ.get("PYTHONPATH")
    return {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([root, path] if path else [root]),
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_NUM_THREADS": "1",
    }


@errors.name_file
def read_osim(path: Path, marker_set: Path | None = None) -> body.BodyModel:
    """Read an OpenSim model of any version that OpenSim itself can upgrade.

    ``path``: the ``.osim`` file.
    ``marker_set``: an OpenSim MarkerSet file. Its markers are added; those of the same name are replaced.
    One segment per body, in topological order. A segment's chain is: the parent's joint frame (constant
        translations that scale with the parent, constant rotation), the joint's translations, its rotations,
        and the child's joint frame inverted. Coordinates that an enforced CoordinateCouplerConstraint makes
        dependent are replaced in the laws and listed as couplers only. A coordinate is of kind ``rotation``
        only where OpenSim calls it rotational: only those are converted to degrees in OpenSim's motion
        files. Markers that OpenSim keeps fixed in its marker placement are ``anatomical``.
    Raises DependencyMissing: if the opensim library is not installed.
    Raises FileUnreadable: if a file is absent or OpenSim cannot read it.
    Raises ModelRefused: if a component cannot be represented; ``field`` names it.

    A marker in an offset frame is expressed in the body; when such a frame is turned against the body, a
    later non-uniform scaling differs from OpenSim's, which scales along the offset frame.
    """
    return _read(_read_version(path), _read_version(marker_set) if marker_set is not None else None)


class _Version(NamedTuple):
    """A file as it is now: a changed one is another key of the cache."""

    path: Path
    mtime_ns: int
    size: int


def _read_version(path: Path) -> _Version:
    try:
        status = path.stat()
    except OSError as error:
        problem = f"cannot be opened ({error.strerror})"
        raise errors.FileUnreadable(problem, file=path, remedy="Check the path") from error
    return _Version(path, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=16)  # chosen: more models than one subject ever uses
def _read(model: _Version, marker_set: _Version | None) -> body.BodyModel:
    request = {
        "operation": "read",
        "file": str(model.path.resolve()),
        "marker_set": str(marker_set.path.resolve()) if marker_set is not None else None,
    }
    try:
        found = document.from_document(ask(request)["model"])
    except errors.FileUnreadable:
        # Of a file that is no XML, or holds something else, OpenSim names a line of its own source code.
        root = parse_xml(model.path)
        if root.tag != "Model" and root.find("Model") is None:
            raise _report_no_model() from None
        if marker_set is not None:
            parse_xml(marker_set.path)
        raise
    if not found.segments:
        raise _report_no_model()
    return dataclasses.replace(found, source=str(model.path))


def _report_no_model() -> errors.FileUnreadable:
    return errors.FileUnreadable("holds no OpenSim model", remedy="Give an .osim file")


def render_osim(model: body.BodyModel, **how: Any) -> str:
    """The text of a model's file for OpenSim, checked by reading it back.

    ``how``: as for :func:`request_osim`. Raises DependencyMissing, FileUnreadable: as for reading.
    Raises ModelRefused: if OpenSim cannot represent a component, or the file read back differs from ``model``
        by more than ``to_opensim.SAME`` at some pose; ``field`` names it.
    """
    text: str = ask(request_osim(model, **how))["text"]
    return text


def render_several(requests: abc.Sequence[abc.Mapping[str, Any]]) -> list[str | errors.InputError]:
    """What :func:`render_osim` returns or raises for each of several models, by one worker.

    ``requests``: from :func:`request_osim`, one or more. Loading OpenSim takes ten times as long as writing a
    model. Raises FileUnreadable: the worker crashed or took too long.
    """
    together = {"operation": "several", "requests": list(requests), "file": requests[0]["file"]}
    answers = ask(together, time_limit_s=TIME_LIMIT_S * len(requests))["answers"]
    return [
        _make_error(answer["error"], request) if "error" in answer else answer["text"]
        for answer, request in zip(answers, requests, strict=True)
    ]


def request_osim(
    model: body.BodyModel,
    *,
    source: Path | None = None,
    factors: abc.Mapping[str, body.Vector] = _NO_FACTORS,
    axis_tilts: abc.Mapping[str, tuple[float, float]] = _NO_TILTS,
    joint_moves: abc.Mapping[str, JointMove] = _NO_MOVES,
    mass_kg: float | None = None,
    marker_set: Path | None = None,
    preserve_mass_distribution: bool = True,
    inertia_from_model: bool = False,
) -> dict[str, Any]:
    """What to ask a worker for to write a model's file for OpenSim.

    ``model``: what the file must represent, with all parameters folded into the laws.
    ``source``: the generic ``.osim`` file it was made from: it is scaled by OpenSim itself with ``factors``
        (muscles, wraps and meshes follow), its joints are tilted, its markers become the model's. Without it
        (built-in models) bodies, joints and markers are made from ``model`` alone, and the arguments below
        are not used, for the model holds them already.
    ``factors``: segment to its x, y, z factors.
    ``axis_tilts``: joint to the turns x and y (rad) of its axes: rotations become T R T^-1, T = Ry(y) Rx(x),
        in the parent's joint frame; translations stay.
    ``joint_moves``: joint to the shift of its centre after scaling, and a turn of its axes before the tilt.
    ``mass_kg``: total mass to scale to.
    ``marker_set``: as for reading; the model's markers replace it in the end.
    ``preserve_mass_distribution``: as for OpenSim's scale tool.
    ``inertia_from_model``: take masses, centres of mass and inertias from ``model`` instead of OpenSim's
        scaling.
    """
    if model.parameters:
        raise ValueError("fold the parameters into the laws before writing a model")
    return {
        "operation": "write",
        "model": document.to_document(model),
        "file": str(source.resolve()) if source is not None else None,
        "marker_set": str(marker_set.resolve()) if marker_set is not None else None,
        "factors": dict(factors),
        "axis_tilts": dict(axis_tilts),
        "joint_moves": {joint: dataclasses.asdict(move) for joint, move in joint_moves.items()},
        "mass_kg": mass_kg,
        "preserve_mass_distribution": preserve_mass_distribution,
        "inertia_from_model": inertia_from_model,
    }


def write_osim(path: Path, model: body.BodyModel, **how: Any) -> None:
    """Write a model for OpenSim, complete or not at all.

    ``path``: the file to write; replaced in one step once the content has been checked.
    ``model``, ``how``: as for :func:`render_osim`, which raises what is refused.
    Raises InputError: if the file cannot be written.
    """
    replace_text(path, render_osim(model, **how))


def replace_text(path: Path, text: str) -> None:
    """Write a file in one step, so that it is never there in part (InputError: it cannot be written)."""
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex}")
    try:
        try:
            temporary.write_text(text, encoding="utf-8")
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise errors.InputError(
            f"cannot be written ({error.strerror})",
            file=path,
            remedy="Choose a folder that can be written to",
        ) from error
