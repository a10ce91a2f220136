"""Files that cannot be used: the page says which, why, and what to do, and goes on."""

from __future__ import annotations

from pathlib import Path

from tests.service.page.conftest import Visit


def test_every_problem_says_what_to_do(visit: Visit, url: str, tmp_path: Path) -> None:
    (tmp_path / "noise.c3d").write_bytes(bytes(range(256)) * 40)
    (tmp_path / "empty.trc").write_bytes(b"")
    (tmp_path / "torn.trc").write_text("PathFileType\t4\t(X/Y/Z)\ttorn.trc\nDataRate\n", encoding="utf-8")
    (tmp_path / "femur_r.stl").write_text("solid nothing\nendsolid nothing\n", encoding="utf-8")
    visitor = visit(url)
    visitor.go()
    visitor.drops(*sorted(tmp_path.glob("*.*")))
    visitor.page.get_by_label("Whose 4 files are these?").fill("Ünsal 1")
    visitor.press("Check them")
    visitor.sees("0 recordings in 4 files can be read")
    for name in ("noise.c3d", "empty.trc", "torn.trc"):
        row = visitor.page.get_by_role("row").filter(has=visitor.page.get_by_role("rowheader", name=name))
        assert row.locator(".tone.poor").count() == 1, name
    boxes = visitor.page.locator(".problem").all()
    assert boxes
    for box in boxes:
        offered = box.locator(".remedy").count() + box.get_by_role("button").count()
        assert offered, box.inner_text()


def test_names_and_subject_files_that_are_refused(visit: Visit, url: str, tmp_path: Path) -> None:
    visitor = visit(url)
    visitor.go()
    (tmp_path / "subject.yaml").write_text("subject: {id: [}", encoding="utf-8")
    visitor.drops(tmp_path / "subject.yaml")
    visitor.sees("It is not valid YAML")
    (tmp_path / "subject.yaml").write_text(
        "subject: {id: S01, height_m: 170}\nmodel: lower_limb_14dof\ntrials: {static: s.trc}\n",
        encoding="utf-8",
    )
    visitor.drops(tmp_path / "subject.yaml")
    visitor.sees("Give it in metres")
    (tmp_path / "#1.trc").write_bytes(b"")
    visitor.drops(tmp_path / "#1.trc")
    visitor.press("Check them")
    visitor.sees("#1.trc is kept as _1.trc")
