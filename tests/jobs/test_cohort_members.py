"""Who belongs to a cohort, and every way of writing that wrongly."""

from __future__ import annotations

from pathlib import Path

import pytest

from scaling_service.capabilities.cohort.members import read_members
from scaling_service.core.errors import InputError


@pytest.fixture
def root(tmp_path: Path) -> Path:
    for name in ("A", "B"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "subject.yaml").write_text("subject: {id: x}\n", encoding="utf-8")
    return tmp_path


def _written(root: Path, text: str, encoding: str = "utf-8") -> Path:
    file = root / "cohort.csv"
    file.write_bytes(text.encode(encoding))
    return file


@pytest.mark.parametrize(
    "text",
    [
        "subject,sex,site\nA/subject.yaml,F,north\nB/subject.yaml,M,south\n",
        "\ufeffsubject;sex;site\r\nA/subject.yaml;F;north\r\n\r\nB/subject.yaml;M;south\r\n",
        "\n sex\tsubject \tsite\nF\t A/subject.yaml\tnorth\nM\tB/subject.yaml\tsouth",
        'sex,subject,site\nF,"A/subject.yaml",north\n,,\nM,B/subject.yaml,south\n',
    ],
)
def test_tables_of_many_hands_say_the_same(root: Path, text: str) -> None:
    members, passed = read_members(_written(root, text))
    assert [m.file for m in members] == [root / "A" / "subject.yaml", root / "B" / "subject.yaml"]
    assert [m.shown for m in members] == ["A/subject.yaml", "B/subject.yaml"]
    assert [dict(m.groups) for m in members] == [{"sex": "F", "site": "north"}, {"sex": "M", "site": "south"}]
    assert passed == ()


def test_cells_that_are_not_written_are_empty(root: Path) -> None:
    (member,), _ = read_members(_written(root, "subject,sex,site\nA/subject.yaml,F\n"))
    assert dict(member.groups) == {"sex": "F", "site": ""}


WRONG = [
    ("", "empty", "header"),
    ("\n \n", "empty", "header"),
    ("person,sex\nA/subject.yaml,F\n", "no column `subject`", "person,sex"),
    ("subject,sex\n", "names no subject", "row"),
    ("subject,sex\n,F\n", "line 2", "no subject file"),
    ("subject\nA/subject.yaml\nC/subject.yaml\n", "line 3, subject", "does not exist"),
    ("subject\nA\n", "line 2", "is a folder"),
    ("subject\nA/subject.yaml\nB/../A/subject.yaml\n", "line 3", "line 2 already"),
    ("subject,sex\nA/subject.yaml,F,G\n", "line 2", "3 cells"),
    ("subject,sex,sex\nA/subject.yaml,F,G\n", "header", "two columns are called 'sex'"),
    ("subject,\nA/subject.yaml,F\n", "header", "no name"),
]


@pytest.mark.parametrize(("text", "first", "second"), WRONG)
def test_mistakes_are_named_with_file_line_and_remedy(root: Path, text: str, first: str, second: str) -> None:
    file = _written(root, text)
    with pytest.raises(InputError) as caught:
        read_members(file)
    said = str(caught.value)
    assert str(file) in said
    assert first in said
    assert second in said
    assert caught.value.remedy


def test_no_text_and_no_file(root: Path) -> None:
    with pytest.raises(InputError, match="UTF-8"):
        read_members(_written(root, "subject,site\nA/subject.yaml,Süd\n", "latin-1"))
    with pytest.raises(InputError, match="no such file"):
        read_members(root / "absent.csv")
    with pytest.raises(InputError, match="subject file"):
        read_members(root / "A" / "subject.yaml")


def test_a_folder_gives_its_subject_files_and_those_of_its_folders(root: Path) -> None:
    (root / "C.yml").write_text("subject: {id: C}\n", encoding="utf-8")
    (root / "D.json").write_text('{"subject": {"id": "D"}, "trials": {}}', encoding="utf-8")
    (root / "E.yaml").write_text(
        "subject: [\n", encoding="utf-8"
    )  # broken: its fault is told, not passed over
    (root / "results.json").write_text('{"subject": "A", "methods": {}}', encoding="utf-8")
    (root / "walk.trc").write_text("", encoding="utf-8")
    (root / ".hidden").mkdir()
    (root / "empty").mkdir()
    members, passed = read_members(root)
    assert [m.shown for m in members] == ["A/subject.yaml", "B/subject.yaml", "C.yml", "D.json", "E.yaml"]
    assert passed == ("results.json was passed over: it is no subject file",)


def test_a_folder_without_subject_files_is_refused(root: Path) -> None:
    (root / "results.json").write_text("{}", encoding="utf-8")
    for name in ("A", "B"):
        (root / name / "subject.yaml").rename(root / name / "S01.txt")
    with pytest.raises(InputError, match="no subject file in this folder"):
        read_members(root)
