"""Damaged and hostile files: each can only fail its own job, with a reason, within the job's limits."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from scaling_service.client import Client
from scaling_service.documents.jobs import State
from tests.service.http.example import example_files
from tests.service.http.served import Served, serving, settings_in
from tests.service.http.surfaces import surfaces, vtp
from tests.service.http.test_subjects import person
from tests.service.jobs.services import running

PER_FORMAT = 4
"""Damaged files of each format in the normal tests; the benchmark has many more."""

LAUGHS = (
    b'<!DOCTYPE l [<!ENTITY a "ha">'
    + b"".join(b'<!ENTITY %c "%s">' % (98 + k, b"&%c;" % (97 + k) * 10) for k in range(9))
    + b"]>"
)
"""Entities that would grow to a billion."""

BOMBS = {
    "huge.c3d": b"\x02\x50\xff\xff\xff\xff\x01\x00\xff\xff" + b"\xff" * 502,
    "huge.stl": b"\x00" * 80 + struct.pack("<I", 0xFFFFFFFF) + b"\x00" * 500,
    "huge.ply": b"ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty double x\n"
    b"property double y\nproperty double z\nend_header\n",
    "faces.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 2000000000\n",
    "entity.vtp": b'<?xml version="1.0"?><!DOCTYPE v [<!ENTITY x SYSTEM "file:///etc/passwd">]>'
    b'<VTKFile type="PolyData"><PolyData><Piece NumberOfPoints="1">&x;</Piece></PolyData></VTKFile>',
    "points.vtp": vtp().replace(b'NumberOfPoints="4"', b'NumberOfPoints="4000000000"'),
    "cells.vtp": vtp().replace(b'NumberOfPolys="4"', b'NumberOfPolys="4000000000"'),
    "indices.vtp": vtp().replace(b"0 1 2 ", b"0 1 2000000000 "),
    "offsets.vtp": vtp().replace(b"3 6 9 12", b"3 6 9 2000000000"),
    "blocks.vtp": vtp(inflated=1 << 40),
    "zeros.vtp": vtp(inflated=1 << 31),
    "laughs.vtp": vtp().replace(b"<VTKFile", LAUGHS + b"<VTKFile").replace(b"0 1 2 ", b"&j; "),
    "deep.vtp": b"<VTKFile type='PolyData'>" + b"<PolyData>" * 200_000,
    "laughs.osim": b'<?xml version="1.0"?>'
    + LAUGHS
    + b'<OpenSimDocument Version="40000"><Model name="&j;"/></OpenSimDocument>',
    "counts.trc": b"PathFileType\t4\t(X/Y/Z)\tx.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\n"
    b"100\t100\t999999999\t999999999\tmm\nFrame#\tTime\tRASI\n\t\tX1\tY1\tZ1\n1\t0.0\t1\t2\t3\n",
    "counts.mot": b"x\nversion=1\nnRows=999999999\nnColumns=999999999\ninDegrees=yes\nendheader\n"
    b"time\ta\n0\t1\n",
}


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    limits = {"limit_memory_mb": 1000, "limit_cpu_s": 20.0, "limit_wall_s": 40.0, "limit_output_mb": 100}
    folder = tmp_path_factory.mktemp("hostile")
    with serving(settings_in(folder, **limits), loopback=True) as served, running(served.service):
        yield served


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """A sound file of each format that is parsed."""
    made = {path.name: path.read_bytes() for path in example_files(tmp_path_factory.mktemp("sound") / "lab")}
    return {"a.trc": made["walk.trc"], "a.stl": made["femur_r.stl"]} | surfaces()


def damaged(content: bytes, rng: np.random.Generator) -> bytes:
    """Cut short, with bits turned, with a stretch overwritten, or nothing but noise."""
    way = rng.integers(4)
    if way == 0:
        return content[: rng.integers(len(content))]
    changed = bytearray(content)
    if way == 1:
        for place in rng.integers(len(changed), size=max(1, len(changed) // 500)):
            changed[place] ^= 1 << int(rng.integers(8))
    elif way == 2:
        start = int(rng.integers(len(changed)))
        changed[start : start + 64] = rng.choice(np.array([b"\xff", b"\x00", b"9", b"\t"])).tobytes() * 64
    else:
        return rng.bytes(min(len(content), 4096))
    return bytes(changed)


def asked(client: Client, subject: str, name: str, folder: Path) -> str:
    """A job that parses one file, whatever its format."""
    suffix = name.rpartition(".")[2]
    if suffix in ("stl", "ply", "obj", "vtp"):
        client.put_subject({"subject": {"id": subject}})
        client.upload(subject, folder / name)
        return client.ask("scalings/mesh-landmarks", subject=subject, bones={"femur_r": name}).id
    trials = {"static": "standing.trc", "evaluation": ["walk.trc"]}
    changes: dict[str, object] = {"trials": trials}
    if suffix == "osim":
        changes["model"] = name
    elif suffix == "mot":
        changes["forces"] = {"walk.trc": name}
    else:
        changes["trials"] = trials | {"evaluation": [name]}
    client.put_subject(person(subject, **changes))
    for file in {"standing.trc", "walk.trc", name}:
        client.upload(subject, folder / file)
    return client.ask("scalings/linear", subject=subject).id


def check(service: Served, contents: dict[str, bytes], folder: Path, prefix: str) -> dict[str, str]:
    """Upload every file, ask for it to be parsed, and see that each job ended by itself."""
    example_files(folder)
    with service.client() as client:
        jobs = {}
        for k, (name, content) in enumerate(contents.items()):
            (folder / name).write_bytes(content)
            jobs[name] = asked(client, f"{prefix}{k}", name, folder)
        ended = {}
        for name, job in jobs.items():
            found = list(client.events(job))[-1]
            assert found.state in (State.DONE, State.FAILED), name
            if found.failure is not None:
                assert found.failure.kind != "WorkerLost", (name, found.failure)
                assert str(folder) not in str(found.failure)
                assert found.failure.problem
                assert found.failure.remedy
            ended[name] = found.state.value if found.failure is None else found.failure.kind
        assert service.call("GET", "/health").status_code == 200
        return ended


def test_bombs_fail_alone(service: Served, tmp_path: Path) -> None:
    ended = check(service, BOMBS, tmp_path / "lab", "B")
    assert {name for name, how in ended.items() if how == "done"} <= {"counts.trc", "counts.mot"}, ended
    crashed = {name for name, how in ended.items() if how == "ProgramError"}
    assert crashed <= {"offsets.vtp", "blocks.vtp", "zeros.vtp"}, ended  # see report()


def test_damaged_files_fail_alone(service: Served, files: dict[str, bytes], tmp_path: Path) -> None:
    report(check(service, many(files, PER_FORMAT, seed=1), tmp_path / "lab", "D"))


@pytest.mark.benchmark
def test_a_thousand_damaged_files(
    service: Served, files: dict[str, bytes], shared_data: Path, tmp_path: Path
) -> None:
    whole = files | {
        "a.c3d": (shared_data / "jia_mri" / "Walking01.c3d").read_bytes(),
        "a.mot": (shared_data / "opencap_squat" / "walking1_grf.mot").read_bytes(),
        "a.osim": (shared_data / "gait2354" / "gait2354_simbody.osim").read_bytes(),
    }
    report(check(service, many(whole, 143, seed=2), tmp_path / "lab", "T"))


def many(sound: dict[str, bytes], each: int, seed: int) -> dict[str, bytes]:
    rng = np.random.default_rng(seed)
    return {f"{k}_{name}": damaged(content, rng) for k in range(each) for name, content in sound.items()}


def report(ended: dict[str, str]) -> None:
    counts: dict[str, int] = {}
    for how in ended.values():
        counts[how] = counts.get(how, 0) + 1
    print(counts)  # noqa: T201 (shown by -s)
    # VTK ends its process when it gets no memory for what a file claims to hold: only that job fails.
    broken = [name for name, how in ended.items() if how == "ProgramError" and not name.endswith(".vtp")]
    assert broken == []
