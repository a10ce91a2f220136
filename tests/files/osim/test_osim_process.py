"""What becomes of an absent library, a crash, a hang and a file that OpenSim cannot read."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.util import find_spec

import pytest

from scaling_service.core.errors import DependencyMissing, FileUnreadable
from scaling_service.files.osim import models
from scaling_service.files.osim.models import read_osim


@pytest.fixture
def model_file(tmp_path):
    path = tmp_path / "model.osim"
    path.write_text('<OpenSimDocument Version="40000"><Model name="m"></Model></OpenSimDocument>')
    return path


def stand_in(monkeypatch, folder, content):
    """Put another opensim in front of the installed one, in a worker of its own."""
    folder.mkdir()
    (folder / "opensim.py").write_text(content)
    monkeypatch.setenv("PYTHONPATH", str(folder))
    worker = models._Worker(os.getpid())
    monkeypatch.setattr(models, "_stand_by", lambda _: worker)


@pytest.mark.skipif(find_spec("opensim") is None, reason="opensim is not installed")
def test_after_a_crash_and_a_refusal_the_same_is_answered_again(shared_data, tmp_path, monkeypatch):
    file = shared_data / "gait2354" / "gait2354_simbody.osim"
    request = {"operation": "read", "file": str(file), "marker_set": None}
    first, worker = models.ask(request), models._stand_by(os.getpid()).process
    broken = tmp_path / "broken.osim"
    broken.write_text("<OpenSimDocument/>")
    with pytest.raises(FileUnreadable):
        models.ask(request | {"file": str(broken)})
    assert models.ask(request) == first
    assert models._stand_by(os.getpid()).process is worker  # it loads OpenSim once
    worker.kill()
    worker.wait()
    assert models.ask(request) == first


def test_several_models_written_by_one_worker_are_those_written_alone(shared_data, tmp_path):
    source, absent = shared_data / "gait2354" / "gait2354_simbody.osim", tmp_path / "absent.osim"
    model = read_osim(source)
    first, refused, last = models.render_several(
        [models.request_osim(model, source=path) for path in (None, absent, source)]
    )
    assert first == models.render_osim(model)
    with pytest.raises(FileUnreadable) as caught:
        models.render_osim(model, source=absent)
    assert (type(refused), str(refused)) == (FileUnreadable, str(caught.value))
    assert last == models.render_osim(model, source=source)


def test_without_the_library(monkeypatch, tmp_path, model_file):
    stand_in(monkeypatch, tmp_path / "fake", "raise ImportError('libosim.so is missing')\n")
    with pytest.raises(DependencyMissing) as caught:
        read_osim(model_file)
    assert "pip install scaling-service[opensim]" in caught.value.remedy


def test_a_crash(monkeypatch, tmp_path, model_file):
    stand_in(monkeypatch, tmp_path / "fake", "import os, signal\nos.kill(os.getpid(), signal.SIGSEGV)\n")
    with pytest.raises(FileUnreadable, match="SIGSEGV") as caught:
        read_osim(model_file)
    assert caught.value.file == str(model_file)


def test_an_unexpected_error(monkeypatch, tmp_path, model_file):
    stand_in(monkeypatch, tmp_path / "fake", "raise LookupError('odd')\n")
    with pytest.raises(FileUnreadable, match="odd"):
        read_osim(model_file)


def test_a_hang(monkeypatch, tmp_path, model_file):
    stand_in(monkeypatch, tmp_path / "fake", "import time\ntime.sleep(60)\n")
    with pytest.raises(FileUnreadable, match="within 1 s"):
        models.ask({"operation": "read", "file": str(model_file), "marker_set": None}, time_limit_s=1.0)


def test_files_that_opensim_cannot_read(oracle, tmp_path):
    for name, content in (("a.osim", "no model"), ("b.osim", "<OpenSimDocument/>"), ("c.osim", "")):
        path = tmp_path / name
        path.write_text(content)
        with pytest.raises(FileUnreadable) as caught:
            read_osim(path)
        assert caught.value.file == str(path)
    with pytest.raises(FileUnreadable):
        read_osim(tmp_path / "absent.osim")


def test_a_marker_set_that_does_not_fit(oracle, tmp_path):
    path = tmp_path / "model.osim"
    pin = {"kind": "PinJoint", "name": "j", "parent": "ground", "child": "a"}
    oracle({"operation": "build", "file": str(path), "joints": [pin]})
    markers = tmp_path / "markers.xml"
    markers.write_text("not xml")
    with pytest.raises(FileUnreadable) as caught:
        read_osim(path, markers)
    assert caught.value.file == str(markers)
    markers.write_text(
        '<OpenSimDocument Version="30000"><MarkerSet><objects><Marker name="lost"><body>tail</body>'
        "<location>0 0 0</location></Marker></objects></MarkerSet></OpenSimDocument>"
    )
    with pytest.raises(Exception, match="lost") as caught:
        read_osim(path, markers)
    assert caught.value.field == "lost"


def test_the_calling_process_never_imports_opensim(tmp_path):
    modules = ", ".join(f"scaling_service.files.osim.{name}" for name in ("models", "muscles", "setups"))
    code = f"import sys, {modules}; print('opensim' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env=models.make_environment(),
    )
    assert done.stdout.strip() == "False"


@pytest.mark.skipif(find_spec("opensim") is None, reason="opensim is not installed")
@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("", "empty"),
        ("no markup", "not well-formed XML"),
        ('<OpenSimDocument Version="40000"><ScaleTool/></OpenSimDocument>', "holds no OpenSim model"),
        ("<html><body/></html>", "holds no OpenSim model"),
        ('<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/hosts">]><a>&b;</a>', "document type"),
    ],
)
def test_a_file_that_is_no_model_says_so_in_plain_words(tmp_path, content, problem):
    path = tmp_path / "model.osim"
    path.write_text(content)
    with pytest.raises(FileUnreadable, match=problem) as caught:
        read_osim(path)
    assert caught.value.file == str(path)
    assert caught.value.remedy
    assert "SimTK" not in str(caught.value)


def test_the_worker_loads_only_what_it_uses():
    """It is started for every model that is read or written."""
    heavy = ("trimesh", "scipy", "yaml", "pyvista")
    code = f"import sys, scaling_service.files.osim.worker; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env=models.make_environment(),
    )
    assert done.stdout.strip() == "[]"
