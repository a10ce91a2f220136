"""Everything that the program writes and says is what it was, asked of the public surface alone.

All of it, costly cases included (about two minutes on two cores; real recordings in $SCALING_SERVICE_DATA):

    pytest tests/safety -m ""

After an intended change, ``python -m tests.safety.renew [case ...]`` renews snapshots and prints what
changed; with ``--dry`` it only prints, and with ``SAFETY_THREADS=2`` it shows what depends on threads.
Numbers are held to ``tests/safety/tolerances.py``, words exactly.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from scaling_service.cli import main
from tests.safety.cases import CASES, Case
from tests.safety.comparing import compare, tell_differences
from tests.safety.running import SCREEN, find_data, run_case
from tests.safety.snapshots import list_snapshots, load_snapshot
from tests.safety.surface import SURFACES

DEMO = ["demo", "--out", "demo"]
PARAMETERS = [pytest.param(c, id=c.name, marks=[pytest.mark.costly] if c.costly else []) for c in CASES]


@pytest.mark.parametrize("case", PARAMETERS)
def test_numbers_and_words_are_what_they_were(
    case: Case,
    tmp_path: Path,
    request: pytest.FixtureRequest,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if case.needs_data and find_data() is None:
        pytest.skip("no recordings; set SCALING_SERVICE_DATA")
    for name, value in SCREEN.items():
        monkeypatch.setenv(name, value)

    def run_here(words: list[str], folder: Path) -> str:
        """What the program prints, without a start of its own: the demo alone was started."""
        if words == DEMO:
            demo: Path = request.getfixturevalue("demo_program")
            shutil.copytree(demo / "demo", folder / "demo")
            return (demo / "screen.txt").read_text(encoding="utf-8")
        monkeypatch.chdir(folder)
        capsys.readouterr()
        assert main(words) == 0
        return capsys.readouterr().out

    found = list(compare(load_snapshot(case.name), run_case(case, tmp_path, run_here)))
    if found:
        advice = f"if this is intended: python -m tests.safety.renew {case.name}"
        pytest.fail(f"{case.name}: {tell_differences(found)}\n{advice}", pytrace=False)


def test_every_case_has_its_snapshot_and_no_other_is_there() -> None:
    assert list_snapshots() == {*(case.name for case in CASES), *SURFACES}
