"""Room on the disk: deleting works where there is none, uploads are held back before, owners have quotas."""

from __future__ import annotations

import shutil
from pathlib import Path

import requests

from scaling_service.documents.jobs import State
from scaling_service.service.store.room import Spare, measure_taken
from tests.service.http.served import Served, serving, settings_in
from tests.service.http.test_subjects import person
from tests.service.jobs.services import all_done, running, until
from tests.service.jobs.tiny import TINY
from tests.service.store.disks import small_disk


def upload(served: Served, name: str, size: int, key: str | None = None) -> requests.Response:
    return served.call("PUT", f"/v1/subjects/S01/files/{name}", key, data=b"x" * size)


def test_deleting_works_on_a_disk_without_any_room(tmp_path: Path) -> None:
    """Results take more room in the database than is kept back: the subject goes in steps."""
    with small_disk(tmp_path / "disk", 40) as disk:
        settings = settings_in(disk.folder, lease_s=1.0)
        with serving(settings, TINY) as served, running(served.service):
            served.call("POST", "/v1/subjects", json=person("S01"))
            upload(served, "long.txt", 600_000)
            asked = [
                served.call("POST", "/v1/tiny", json={"number": k, "subject": "S01", "files": ["long.txt"]})
                for k in range(10)
            ]
            until(lambda: all_done(served.service))
            waiting = served.call("POST", "/v1/tiny", json={"seconds": 60.0}).json()["id"]
            until(lambda: served.service.counts()[State.RUNNING] == 1)
            disk.fill()
            first = asked[0].json()["id"]
            assert upload(served, "more.txt", 300_000).status_code == 507
            disk.fill()
            assert served.call("DELETE", f"/v1/jobs/{waiting}").status_code == 202
            disk.fill()
            assert served.call("DELETE", f"/v1/jobs/{first}").status_code == 204
            disk.fill()
            assert served.call("DELETE", "/v1/subjects/S01/files/long.txt").status_code == 204
            disk.fill()
            assert served.call("DELETE", "/v1/subjects/S01").status_code == 204
            assert served.call("GET", "/v1/subjects").json()["items"] == []
            assert served.call("GET", f"/v1/jobs/{asked[1].json()['id']}").status_code == 404


def test_what_is_kept_back_is_kept_back_again(tmp_path: Path) -> None:
    spare = Spare(tmp_path)
    spare.keep()
    size = (tmp_path / "spare").stat().st_size
    assert size > 0
    with spare.given_up():
        there = (tmp_path / "spare").exists()
    assert there == (shutil.disk_usage(tmp_path).free >= size)  # given up only where it is needed
    assert (tmp_path / "spare").stat().st_size == size


def test_uploads_are_held_back_as_jobs_are(tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk", 24) as disk:
        settings = settings_in(disk.folder, reserve_mb=8)
        with serving(settings, TINY) as served:
            served.call("POST", "/v1/subjects", json=person("S01"))
            assert upload(served, "a.trc", 1_000_000).status_code == 200
            (disk.folder / "other").write_bytes(bytes(shutil.disk_usage(disk.folder).free - 9_000_000))
            answer = upload(served, "b.trc", 2_000_000)
            assert (answer.status_code, answer.headers["Retry-After"]) == (507, "60")
            assert list((settings.data_directory / "scratch" / "uploads").iterdir()) == []
            (disk.folder / "other").unlink()
            assert upload(served, "b.trc", 2_000_000).status_code == 200


def test_an_owner_has_a_quota(tmp_path: Path) -> None:
    with serving(settings_in(tmp_path, limit_owner_mb=1), TINY) as served:
        one, other = served.key("one"), served.key("other")
        for key in (one, other):
            served.call("POST", "/v1/subjects", key, json=person("S01"))
        assert upload(served, "a.trc", 700_000, one).status_code == 200
        assert upload(served, "copy.trc", 700_000, one).status_code == 507
        assert measure_taken(served.service.store.database, "one") == 700_000
        assert upload(served, "b.trc", 400_000, one).status_code == 507
        refused = upload(served, "b.trc", 400_000, one).json()
        assert (refused["type"], refused["field"]) == ("urn:scaling-service:QuotaReached", "limit_owner_mb")
        assert upload(served, "a.trc", 700_000, other).status_code == 200  # others are not concerned
        assert upload(served, "c.trc", 290_000, one).status_code == 200
        assert served.call("DELETE", "/v1/subjects/S01/files/a.trc", one).status_code == 204
        assert upload(served, "b.trc", 400_000, one).status_code == 200


def test_subjects_of_an_owner_are_bounded(tmp_path: Path) -> None:
    with serving(settings_in(tmp_path, limit_subjects=2), TINY) as served:
        for name, status in (("S01", 201), ("S02", 201), ("S03", 422), ("S02", 200)):
            answer = served.call("POST", "/v1/subjects", json=person(name))
            assert answer.status_code == status, name
        assert served.call("DELETE", "/v1/subjects/S01").status_code == 204
        assert served.call("POST", "/v1/subjects", json=person("S03")).status_code == 201


def test_where_the_quota_is_reached_no_job_is_taken(tmp_path: Path) -> None:
    with serving(settings_in(tmp_path, limit_owner_mb=1), TINY) as served:
        served.call("POST", "/v1/subjects", json=person("S01"))
        assert upload(served, "a.trc", 1_000_000).status_code == 200
        assert served.call("POST", "/v1/tiny", json={"number": 1}).status_code == 202
        served.service.quotas.add("local", 1)
        assert served.call("POST", "/v1/tiny", json={"number": 2}).status_code == 507
        assert served.call("POST", "/v1/tiny", json={"number": 1}).status_code == 202  # it is there already
