"""What laboratories give by mistake: exit 2, one line that names file, field and remedy, nothing written.

Where a mistake can be told from the recording itself, the run goes on and says what it did.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.scaling import saving
from scaling_service.cli import main
from tests.cli.spoilt import (
    Spoil,
    as_c3d,
    assert_refused,
    at,
    copied,
    cut,
    holding,
    in_recordings,
    on,
    recorded,
    replaced,
    subject,
    trials,
    unseen,
    without,
)
from tests.files.c3d_writing import write_c3d
from tests.jobs.laboratory import write_recording


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Writing .osim files takes a second each, and is tested elsewhere."""
    monkeypatch.setattr(saving, "render_scaled", lambda found, _: ["<model/>"] * len(found))


@dataclass(frozen=True)
class Mistake:
    """What is spoilt, the file that the message names, and what else it says."""

    spoil: Spoil
    file: str
    says: tuple[str, ...]


NO_UNIT = "extend over"
HELD_OUT = "holds the same recording as 'hips.trc'"
MISTAKES = {
    "a pelvis marker missing": Mistake(
        in_recordings(without("RASIS")), "S01.yaml", ("no marker 'RASIS'", "it has LASIS", "under `markers:`")
    ),
    "an outer knee marker missing": Mistake(
        in_recordings(without("LLFE")), "S01.yaml", ("no marker 'LLFE'", "under `markers:`")
    ),
    "a pelvis marker with an unknown name": Mistake(
        in_recordings(lambda t: t.relabel({"RPSIS": "Back1", "LPSIS": "Back2"})),
        "S01.yaml",
        ("'RPSIS'; it has Back1",),
    ),
    "no marker with a known name": Mistake(
        in_recordings(lambda t: t.relabel({n: f"M{k}" for k, n in enumerate(t.labels)})),
        "S01.yaml",
        ("no segment could be measured", "under `markers:`"),
    ),
    "an unknown key": Mistake(
        subject(modle="x"), "S01.yaml", ("modle: unknown key", "Did you mean 'model'?")
    ),
    "an unknown key below": Mistake(
        trials(evalution=["walk.trc"]), "S01.yaml", ("trials.evalution: unknown key", "'evaluation'?")
    ),
    "an empty subject file": Mistake(holding("S01.yaml", b""), "S01.yaml", ("nothing", "Start with")),
    "a subject file that is a list": Mistake(
        holding("S01.yaml", b"- a\n"), "S01.yaml", ("list", "Start with")
    ),
    "no YAML": Mistake(
        holding("S01.yaml", b"subject: {id: S01\nmodel: [x\n"), "S01.yaml", ("line 2", "valid YAML")
    ),
    "a key given twice": Mistake(
        replaced("S01.yaml", "model:", "model: squat_4dof\nmodel:"), "S01.yaml", ("'model' is given twice",)
    ),
    "an empty TRC": Mistake(holding("hips.trc", b""), "hips.trc", ("empty", "Export")),
    "an empty C3D": Mistake(as_c3d(holding("hips.c3d", b"")), "hips.c3d", ("empty", "Export")),
    "a TRC cut in its header": Mistake(cut("hips.trc", 0.002), "hips.trc", ("truncated", "Export")),
    "a TRC cut in its rows": Mistake(cut("hips.trc", 0.5), "hips.trc", ("cut off", "Copy or export")),
    "a C3D cut in its header": Mistake(as_c3d(cut("hips.c3d", 0.01)), "hips.c3d", ("cut off", "Export")),
    "a C3D cut in its frames": Mistake(
        as_c3d(cut("hips.c3d", 0.7)),
        "hips.c3d",
        ("cut off: 50 frames are stated, and it ends after 33", "Copy or export"),
    ),
    "text in a C3D": Mistake(
        as_c3d(holding("hips.c3d", b"my notes of today\n" * 50)), "hips.c3d", ("not a C3D file", "Export")
    ),
    "a TRC named C3D": Mistake(
        as_c3d(lambda folder: shutil.copy(folder / "walk.trc", folder / "hips.c3d") and None),
        "hips.c3d",
        ("not a C3D file", "Export"),
    ),
    "a C3D named TRC": Mistake(
        lambda folder: write_c3d(folder / "hips.trc", recorded("hips")),
        "hips.trc",
        ("C3D file", "Name it .c3d"),
    ),
    "centimetres called millimetres": Mistake(
        in_recordings(lambda t: t.with_markers(0.1 * t.markers), "hips"),
        "hips.trc",
        ("Units", NO_UNIT, "unit"),
    ),
    "inches": Mistake(
        replaced("hips.trc", "\tmm\t", "\tin\t"), "hips.trc", ("unit 'in' is not known", "mm or m")
    ),
    "no frame": Mistake(
        lambda folder: (
            (folder / "hips.trc").write_text(
                "".join((folder / "hips.trc").read_text().splitlines(keepends=True)[:6])
            )
            and None
        ),
        "hips.trc",
        ("no frame", "Record or export"),
    ),
    "nothing seen in any frame": Mistake(
        in_recordings(unseen(), "walk"), "walk.trc", ("no marker is seen", "Check")
    ),
    "nothing seen in any recording": Mistake(
        in_recordings(unseen()), "standing.trc", ("no marker is seen", "Check the recording")
    ),
    "two model markers with one label": Mistake(
        subject(markers={"RFH": "RTHI", "LFH": "RTHI"}),
        "S01.yaml",
        ("markers.LFH", "'RTHI' already stands", "Map each"),
    ),
    "a label with and without prefix": Mistake(
        in_recordings(lambda t: t.relabel({"LFH": "B:RFH"}), "walk"),
        "walk.trc",
        ("markers.RFH", "'RFH' or 'B:RFH'", "Say under `markers:`"),
    ),
    "a marker that the model does not have": Mistake(
        subject(markers={"RFHB": "RFH"}),
        "S01.yaml",
        ("markers.RFHB", "no marker 'RFHB'", "Did you mean 'RFH'?"),
    ),
    "all markers on one spot": Mistake(
        in_recordings(lambda t: at(t, np.full(3, 0.5))),
        "standing.trc",
        ("lie on one spot", "Correct the labels"),
    ),
    "a knee without width": Mistake(
        in_recordings(on("RLFE", "RMFE")), "standing.trc", ("'RLFE' and 'RMFE' lie on one spot",)
    ),
    "a shank without length": Mistake(
        in_recordings(
            lambda t: at(at(t, t.position("RLFE") + 0.004, "RLM"), t.position("RMFE") + 0.004, "RMM")
        ),
        "standing.trc",
        ("RLFE and RLM are", "Correct the labels"),
    ),
    "labels exchanged": Mistake(
        in_recordings(lambda t: t.relabel({"RLM": "RMM", "RMM": "RLM"}), "walk"),
        "walk.trc",
        ("the labels RLM and RMM look exchanged throughout", "Correct the labels in the recording"),
    ),
    "another person's standing trial": Mistake(
        in_recordings(lambda t: t.with_markers(0.6 * t.markers), "standing"),
        "standing.trc",
        ("standard deviations off", "the person's height"),
    ),
    "a mirrored recording": Mistake(
        in_recordings(lambda t: t.with_markers(t.markers * [1.0, 1.0, -1.0]), "walk"),
        "walk.trc",
        ("mirror image", "under `mirrored:`"),
    ),
    "a trial to fit that is to be held out": Mistake(
        trials(evaluation=["hips.trc"]), "S01.yaml", ("trials.evaluation", "also used to fit", "Remove it")
    ),
    "a copy of it under another name": Mistake(
        copied("hips.trc", "other.trc", trials(evaluation=["other.trc"])),
        "S01.yaml",
        (HELD_OUT, "Remove one"),
    ),
    "the static trial as a list": Mistake(
        trials(static=["standing.trc", "standing.trc"]), "S01.yaml", ("trials.static", "text is needed")
    ),
    "a height in centimetres": Mistake(
        subject(subject={"id": "S01", "height_m": 170}), "S01.yaml", ("subject.height_m", "Give it in metres")
    ),
    "a folder as a recording": Mistake(
        lambda folder: (folder / "walk.trc").unlink() or (folder / "walk.trc").mkdir(),
        "S01.yaml",
        ("trials.evaluation.0", "is a folder", "correct the path"),
    ),
    "text in a cell": Mistake(
        replaced("walk.trc", "\t0.100000000\t", "\tsoon\t"),
        "walk.trc",
        ("Time", "line 17", "Correct the cell"),
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_named_with_its_remedy(
    name: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mistake = MISTAKES[name]
    mistake.spoil(folder)
    before = set(folder.rglob("*"))
    code = main(["scale", str(folder / "S01.yaml"), "--method", "MB", "--out", str(folder / "out")])
    shown = capsys.readouterr()
    assert (code, shown.out) == (2, ""), shown
    assert_refused(folder, shown.err, mistake.file, mistake.says, before)


REPAIRED: dict[str, tuple[Spoil, str]] = {
    "two markers with one label": (
        in_recordings(lambda t: t.relabel({"LFH": "RFH"}), "walk"),
        "2 points have this name; called RFH#2 from the second on",
    ),
    "millimetres called metres": (replaced("hips.trc", "\tmm\t", "\tm\t"), "hips: the body would measure"),
    "metres called millimetres": (
        lambda folder: (
            write_recording(folder / "hips.trc", recorded("hips"), units="m"),
            replaced("hips.trc", "\tm\t", "\tmm\t")(folder),
        ),
        "positions said to be in mm are in m, so they were multiplied by 1000",
    ),
    "a marker absent in all frames": (in_recordings(unseen("RFH")), "no recording shows RFH of the model"),
    "a marker absent in all frames of one trial": (
        in_recordings(unseen("RFH"), "walk"),
        "walk: RFH labelled, but never seen",
    ),
    "a position beyond any body": (
        in_recordings(lambda t: at(t, t.position("RFH") + 1e3 * (t.times == 0.1)[:, None], "RFH"), "hips"),
        "hips: RFH: over 20 times farther",
    ),
    "fewer frames than counted": (
        replaced("hips.trc", "\t50\t14\t", "\t99\t14\t"),
        "hips: the header says 99, the file holds 50 frames",
    ),
    "one leg": (
        in_recordings(without("LLFE", "LMFE", "LFH", "LLM", "LMM")),
        "left femur, left tibia: not measured",
    ),
}


@pytest.mark.parametrize("name", REPAIRED)
def test_what_is_repaired_or_doubtful_is_said(
    name: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spoil, says = REPAIRED[name]
    spoil(folder)
    assert main(["scale", str(folder / "S01.yaml"), "--method", "MB", "--out", str(folder / "out")]) == 0
    shown = capsys.readouterr()
    assert says in shown.out
    assert shown.err == ""


def test_a_sound_laboratory_hears_none_of_it(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scale", str(folder / "S01.yaml"), "--method", "MB", "--out", str(folder / "out")]) == 0
    assert "Note" not in capsys.readouterr().out


OPTIONS = [
    (["--method", "XB"], "no method 'XB'"),
    (["--up", "sideways"], "up: 'sideways' is no axis. Give x, y or z"),
    (["--up", "z", "--forward", "-z"], "forward: up and forward name the same axis"),
    (["--frames", "-5"], "--frames"),
    (["--smooth-hz", "500"], "Choose one between 0 and 50 Hz"),
    (["--out", ""], "--out: no folder is given"),
    (["--out", "x" * 300], "--out"),
    (["--out", "S01.yaml"], "it is a file"),
    (["--out", "S01.yaml/out"], "S01.yaml' is a file"),
]


@pytest.mark.parametrize(("options", "says"), OPTIONS)
def test_options_that_cannot_be(
    options: list[str],
    says: str,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(folder)
    before = set(folder.rglob("*"))
    assert main(["scale", "S01.yaml", "--out", "out", *options]) == 2
    shown = capsys.readouterr()
    assert shown.err.count("\n") == 1
    assert says in shown.err
    assert set(folder.rglob("*")) == before


@pytest.mark.parametrize("name", ["hips.trc", "."])
def test_something_else_than_a_subject_file(
    name: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["compare", str(folder / name), "--out", str(folder / "out")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "this is a recording" in said or "Is a directory" in said
    assert not (folder / "out").exists()
