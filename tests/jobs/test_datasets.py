"""Downloads from a server on this machine: what is written, what is kept, and what is refused."""

from __future__ import annotations

import errno
import hashlib
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from scaling_service.capabilities.datasets import downloads
from scaling_service.capabilities.datasets.catalogue import Dataset
from scaling_service.capabilities.datasets.downloads import DownloadFailed, check_base_url
from scaling_service.capabilities.datasets.run import Obtained, get_dataset
from scaling_service.capabilities.subject.reading import load_subject
from scaling_service.core.errors import InputError
from scaling_service.files.image_markers import read_image_markers
from tests.jobs.mirror import MODEL, Mirror, laid_out, made_up, serve

FILES = {
    "standing.trc": ("data/a folder/Subject 1+2.trc", b"standing " * 20_000),
    "walk.trc": ("data/walk.trc", b"walking " * 10_000),
    "models/imaged.osim": ("models/imaged.osim", MODEL),
}
SUBJECT = yaml.safe_dump(
    {
        "subject": {"id": "made_up"},
        "model": "lower_limb_14dof",
        "trials": {"static": "standing.trc", "evaluation": ["walk.trc"]},
        "image_markers": "image_markers.csv",
    }
)
WALKER = made_up(FILES, image_markers_from="models/imaged.osim", subject=SUBJECT)
MADE_HERE = {"subject.yaml", "image_markers.csv", "SOURCE.md"}


@pytest.fixture
def mirror() -> Iterator[Mirror]:
    with serve(laid_out(WALKER, FILES)) as server:
        yield server


def get(mirror: Mirror, folder: Path, cache: str = "cache", dataset: Dataset = WALKER) -> Obtained:
    return get_dataset("walker", dataset, folder / "out", cache=folder / cache, base_url=mirror.url)


def files_in(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def test_everything_is_written_as_published(mirror: Mirror, tmp_path: Path) -> None:
    reported: list[tuple[str, float]] = []
    obtained = get_dataset(
        "walker",
        WALKER,
        tmp_path / "out",
        cache=tmp_path / "cache",
        base_url=mirror.url + "/",
        progress=lambda what, share: reported.append((what, share)),
    )
    assert set(obtained.written) == files_in(tmp_path / "out") == {*FILES, *MADE_HERE}
    assert obtained.kept == ()
    for name, (_, data) in FILES.items():
        assert (tmp_path / "out" / name).read_bytes() == data
    assert mirror.asked[0] == f"/owner/name.of-it/{WALKER.commit}/data/a%20folder/Subject%201%2B2.trc"
    shares = [share for _, share in reported]
    assert shares == sorted(shares)
    assert (shares[0], shares[-1]) == (0.0, 1.0)
    assert load_subject(tmp_path / "out" / "subject.yaml").static == tmp_path / "out" / "standing.trc"


def test_the_note_holds_source_terms_and_hashes(mirror: Mirror, tmp_path: Path) -> None:
    get(mirror, tmp_path)
    note = (tmp_path / "out" / "SOURCE.md").read_text(encoding="utf-8")
    said = ("https://github.com/owner/name.of-it", WALKER.commit, "CC BY-NC 4.0", "NON-COMMERCIAL USE ONLY")
    for words in (*said, "Ask first.", "Nobody (2000) Nothing.", "Nobody was recorded.", "image_markers.csv"):
        assert words in note
    for path, data in FILES.values():
        assert path in note
        assert hashlib.sha256(data).hexdigest() in note


def test_image_markers_are_where_the_model_has_them(mirror: Mirror, tmp_path: Path) -> None:
    get(mirror, tmp_path)
    found = read_image_markers(tmp_path / "out" / "image_markers.csv")
    assert found["RASI"] == ("pelvis", pytest.approx((-0.114189, -0.12625, -0.127356)))
    assert found["RKNE"] == ("femur_r", pytest.approx((-0.12116, -0.01875, -0.58264)))


def test_what_is_there_is_neither_fetched_nor_written_again(mirror: Mirror, tmp_path: Path) -> None:
    get(mirror, tmp_path)
    assert len(mirror.wants()) == len(FILES)
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "out").rglob("*")}
    again = get(mirror, tmp_path, cache="another")
    assert again.written == ()
    assert set(again.kept) == {*FILES, *MADE_HERE}
    assert mirror.asked == []
    assert before == {path: path.stat().st_mtime_ns for path in (tmp_path / "out").rglob("*")}
    (tmp_path / "out" / "walk.trc").unlink()
    (tmp_path / "out" / "subject.yaml").unlink()
    assert get(mirror, tmp_path, cache="another").written == ("walk.trc", "subject.yaml")
    assert mirror.wants() == ["data/walk.trc"]


def test_the_cache_serves_another_folder(mirror: Mirror, tmp_path: Path) -> None:
    get(mirror, tmp_path)
    mirror.wants()
    shutil.rmtree(tmp_path / "out")
    spoilt = tmp_path / "cache" / "walker" / "walk.trc"
    spoilt.write_bytes(b"spoilt")
    get(mirror, tmp_path)
    assert mirror.wants() == ["data/walk.trc"]
    assert (tmp_path / "out" / "walk.trc").read_bytes() == FILES["walk.trc"][1]


def test_a_download_that_broke_off_goes_on(mirror: Mirror, tmp_path: Path) -> None:
    mirror.status["walk.trc"] = 404
    with pytest.raises(DownloadFailed, match=r"walk\.trc, --base-url: .*HTTP 404.*<commit>"):
        get(mirror, tmp_path)
    assert not (tmp_path / "out").exists()
    assert files_in(tmp_path / "cache") == {"walker/standing.trc"}
    mirror.status.clear()
    mirror.wants()
    get(mirror, tmp_path)
    assert mirror.wants() == ["data/walk.trc", "models/imaged.osim"]


@pytest.mark.parametrize(
    ("served", "found"), [(b"a sign-in page", "14 bytes"), (b"x" * 500_000, "more than")]
)
def test_another_content_is_deleted(mirror: Mirror, tmp_path: Path, served: bytes, found: str) -> None:
    mirror.instead["walk.trc"] = served
    with pytest.raises(DownloadFailed, match="was deleted") as caught:
        get(mirror, tmp_path)
    message = str(caught.value)
    expected = hashlib.sha256(FILES["walk.trc"][1]).hexdigest()
    for words in ("walk.trc", "sha256", expected, found, "--base-url"):
        assert words in message
    if len(served) < 100:
        assert hashlib.sha256(served).hexdigest() in message
    assert not (tmp_path / "out").exists()
    assert files_in(tmp_path / "cache") == {"walker/standing.trc"}


def test_a_connection_that_breaks_leaves_nothing(mirror: Mirror, tmp_path: Path) -> None:
    mirror.cut.add("walk.trc")
    with pytest.raises(DownloadFailed, match=r"walk\.trc.*(broke off|was deleted).*[Tt]ry again"):
        get(mirror, tmp_path)
    assert files_in(tmp_path) == {"cache/walker/standing.trc"}


def test_a_server_that_does_not_answer(
    mirror: Mirror, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(downloads, "TIMEOUT_S", (0.2, 0.05))
    mirror.silent.add("walk.trc")
    with pytest.raises(DownloadFailed, match="does not answer in time"):
        get(mirror, tmp_path)


def test_no_network(tmp_path: Path) -> None:
    with serve({}) as gone:
        url = gone.url
    with pytest.raises(DownloadFailed, match=r"127\.0\.0\.1:\d+ cannot be reached.*Check the network"):
        get(Mirror({}, url=url), tmp_path)
    assert files_in(tmp_path) == set()


@pytest.mark.parametrize("status", [403, 429, 500])
def test_other_refusals(mirror: Mirror, tmp_path: Path, status: int) -> None:
    mirror.status["walk.trc"] = status
    with pytest.raises(DownloadFailed, match=f"refused \\(HTTP {status}\\)"):
        get(mirror, tmp_path)


@pytest.mark.parametrize("url", ["", "ftp://host", "host", "https://", "http://[::1"])
def test_no_web_address(url: str) -> None:
    with pytest.raises(InputError, match=r"--base-url: .*is not a web address.*https://"):
        check_base_url(url)


@pytest.mark.parametrize("name", ["subject.yaml", "SOURCE.md", "walk.trc", "image_markers.csv"])
def test_a_file_that_differs_is_never_replaced(mirror: Mirror, tmp_path: Path, name: str) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / name).write_text("mine")
    with pytest.raises(InputError, match=f"'{name}' is there already, and differs"):
        get(mirror, tmp_path)
    assert files_in(tmp_path / "out") == {name}
    assert (tmp_path / "out" / name).read_text() == "mine"
    assert name == "image_markers.csv" or mirror.asked == []


def test_other_files_of_the_folder_stay(mirror: Mirror, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "notes.txt").write_text("mine")
    get(mirror, tmp_path)
    assert (tmp_path / "out" / "notes.txt").read_text() == "mine"


def test_a_cache_that_cannot_be_written_to(mirror: Mirror, tmp_path: Path) -> None:
    (tmp_path / "cache").write_text("a file")
    with pytest.raises(InputError, match=r"cache.*--cache: downloads cannot be kept there.*name a folder"):
        get(mirror, tmp_path)
    assert not (tmp_path / "out").exists()


def test_a_full_disk(mirror: Mirror, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(shutil, "copyfile", full)
    with pytest.raises(InputError, match=r"--out: .*No space left on device\. Free some space"):
        get(mirror, tmp_path)
    assert files_in(tmp_path / "out") == set()
    assert [path.name for path in tmp_path.iterdir()] == ["cache"]
