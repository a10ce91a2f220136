"""Listing and downloading datasets as typed, from a server on this machine."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from scaling_service.capabilities.datasets import catalogue as catalogues
from scaling_service.capabilities.datasets.catalogue import Dataset, read_catalogue
from scaling_service.capabilities.scaling import saving
from scaling_service.cli import main
from tests.jobs.laboratory import laboratory
from tests.jobs.mirror import Mirror, laid_out, made_up, serve

Files = dict[str, tuple[str, bytes]]


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Files:
    folder = tmp_path_factory.mktemp("laboratory")
    laboratory(folder)
    names = ("standing.trc", "hips.trc", "walk.trc", "S01.yaml")
    return {name: (f"data/{name}", (folder / name).read_bytes()) for name in names}


@pytest.fixture
def catalogue(files: Files) -> dict[str, Dataset]:
    subject = files["S01.yaml"][1].decode()
    recordings = {name: file for name, file in files.items() if name != "S01.yaml"}
    bones = made_up(
        {"F.stl": ("F.stl", b"no mesh")}, next=["landmarks --units mm --femur_r {folder}/F.stl --out found"]
    )
    return {"walker": made_up(recordings, subject=subject), "bones_only": bones}


@pytest.fixture
def mirror(
    files: Files, catalogue: dict[str, Dataset], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Mirror]:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(catalogues, "read_catalogue", lambda: catalogue)
    monkeypatch.setattr(saving, "render_scaled", lambda found, _: ["<model/>"] * len(found))
    bones = {f"owner/name.of-it/{catalogue['bones_only'].commit}/F.stl": b"no mesh"}
    with serve(laid_out(catalogue["walker"], files) | bones) as server:
        monkeypatch.setenv("SCALING_SERVICE_DATASETS_URL", server.url)
        monkeypatch.setenv("SCALING_SERVICE_CACHE", str(tmp_path / "cache"))
        yield server


def run(*arguments: object) -> int:
    return main(["datasets", *(str(a) for a in arguments)])


def test_list_tells_name_size_terms_and_use(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("list") == 0
    shown = " ".join(capsys.readouterr().out.split())
    for name, dataset in read_catalogue().items():
        assert name in shown
        assert f"{dataset.total_bytes / 1e6:.1f}" in shown
    assert "Apache-2.0" in shown
    assert "datasets get" in shown


def test_non_commercial_terms_are_reported(mirror: Mirror, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("list") == 0
    assert "NON-COMMERCIAL" in capsys.readouterr().out
    assert run("get", "walker") == 0
    assert "NON-COMMERCIAL USE ONLY" in capsys.readouterr().out


def test_the_command_that_get_prints_works(mirror: Mirror, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("get", "walker") == 0
    shown = capsys.readouterr()
    assert shown.err == ""
    command = shown.out.strip().splitlines()[-1]
    assert shlex.split(command)[:3] == ["scaling-service", "compare", "walker/subject.yaml"]
    assert main(shlex.split(command)[1:]) == 0
    assert Path("walker_results/comparison.json").is_file()
    assert "walk (held out)" in capsys.readouterr().out


def test_bones_alone_get_the_landmarks_command(mirror: Mirror, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("get", "bones_only", "--out", "some bones") == 0
    last = capsys.readouterr().out.strip().splitlines()[-1]
    assert last.strip() == "scaling-service landmarks --units mm --femur_r 'some bones/F.stl' --out found"
    assert not Path("some bones/subject.yaml").exists()


def test_a_second_time_says_what_was_there(mirror: Mirror, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("get", "walker") == 0
    assert "Written under walker" in capsys.readouterr().out
    mirror.wants()
    assert run("get", "walker", "--cache", "another") == 0
    shown = capsys.readouterr().out
    assert "Written" not in shown
    assert "Already there" in shown
    assert mirror.asked == []


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["get", "waker"], "NAME: there is no dataset 'waker'. Did you mean 'walker'?"),
        (["get"], "NAME"),
        (["get", "walker", "--base-url", "nowhere"], "--base-url: 'nowhere' is not a web address"),
        (["get", "walker", "--out", ""], "--out: no folder is given"),
        (["get", "walker", "--cache", " "], "--cache: no folder is given"),
        (["get", "walker", "--out", "a_file"], "a_file, --out: it is a file. Name a folder"),
        (["get", "walker", "--cache", "a_file"], "a_file/walker, --cache: downloads cannot be kept there"),
    ],
)
def test_what_cannot_be_done_is_one_line(
    mirror: Mirror, capsys: pytest.CaptureFixture[str], arguments: list[str], said: str
) -> None:
    Path("a_file").write_text("")
    assert run(*arguments) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not Path("walker").exists()


def test_server_faults_are_one_line_and_leave_nothing(
    mirror: Mirror, capsys: pytest.CaptureFixture[str]
) -> None:
    def said() -> str:
        assert run("get", "walker") == 2
        assert not Path("walker").exists()
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        return error

    mirror.status["walk.trc"] = 404
    assert "walk.trc, --base-url" in said()
    mirror.status.clear()
    mirror.instead["walk.trc"] = b"other"
    assert "expected SHA-256" in said()


def test_an_interruption_leaves_nothing(
    mirror: Mirror, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("requests.get", interrupted)
    assert run("get", "walker") == 130
    assert "interrupted" in capsys.readouterr().err
    assert [path for path in Path().rglob("*") if path.is_file()] == []


def test_help_teaches(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments in (["--help"], ["list", "--help"], ["get", "--help"]):
        assert run(*arguments) == 0
        assert "datasets" in capsys.readouterr().out
