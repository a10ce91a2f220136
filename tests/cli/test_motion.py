"""The command `ik`."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from scaling_service.cli import main
from scaling_service.cli.app import EXIT_INPUT
from scaling_service.files.sto import read_sto
from scaling_service.files.trc import read_trc, write_trc
from scaling_service.model.builtin import load_builtin
from scaling_service.model.document import to_document
from scaling_service.model.poses import pose_neutral_markers
from scaling_service.model.trial import Trial


def test_motions_their_uncertainty_and_poses_are_written(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["ik", "lower_limb_14dof", str(folder / "walk.trc"), str(folder / "hips.trc")]
    assert main([*given, "--out", str(folder / "out"), "--poses", "--smooth-hz", "8"]) == 0
    out = capsys.readouterr().out
    assert "Kinematic error, mm" in out
    assert "walk_ik.mot, walk_ik_sd.mot, walk_poses.sto, ik.json" in out
    reported = json.loads((folder / "out/ik.json").read_text(encoding="utf-8"))
    assert reported["settings"]["processing"]["cutoff_hz"] == 8.0
    assert set(reported["trials"]["walk"]["kinematic_error_mm"]) == {"mean", "rms", "max", "per_marker"}
    poses = read_sto(folder / "out/walk_poses.sto")
    assert poses.columns[1:7] == ("pelvis_X", "pelvis_Y", "pelvis_Z", "pelvis_Ox", "pelvis_Oy", "pelvis_Oz")
    motion = read_sto(folder / "out/walk_ik.mot")
    assert np.isfinite(poses.data).all()
    assert poses.column("pelvis_X") == pytest.approx(motion.column("pelvis_tx"), abs=1e-9)
    spread = read_sto(folder / "out/walk_ik_sd.mot")
    assert spread.columns == motion.columns
    assert (spread.data[:, 1:] > 0.0).all()


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--marker", "RLFE"], "--marker: 'RLFE' is not MARKER=LABEL"),
        (["--marker", "RLFE=a", "--marker", "RLFE=b"], "'RLFE' is mapped twice"),
        (["--marker", "RLFE=nothing"], "label 'nothing' is in no recording"),
        (["--up", "sideways"], "sideways"),
        (["--marker-set", "m.xml"], ".osim models only"),
        (["--smooth-hz", "80"], "Choose one between 0 and 50 Hz"),
    ],
)
def test_wrong_options(more: list[str], said: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = ["ik", "lower_limb_14dof", str(folder / "walk.trc"), "--out", str(folder / "out"), *more]
    assert main(given) == EXIT_INPUT
    message = capsys.readouterr().err
    assert said in message
    assert len(message.splitlines()) == 1
    assert not (folder / "out").exists()


def test_conventional_angles_of_a_model_that_has_none_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = load_builtin("squat_4dof")
    markers = np.tile(list(pose_neutral_markers(model).values()), (20, 1, 1))
    trial = Trial(
        name="still", times=np.arange(20) / 100.0, labels=model.marker_names, markers=markers, rate_hz=100.0
    )
    write_trc(tmp_path / "still.trc", trial, "m")
    given = ["ik", "squat_4dof", str(tmp_path / "still.trc"), "--out", str(tmp_path / "out")]
    assert main([*given, "--angles"]) == EXIT_INPUT
    assert "'squat_4dof' has no landmarks from which conventional angles come" in capsys.readouterr().err
    assert main(given) == 0


def test_labels_that_no_model_marker_has_are_mapped_by_an_option(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    walk = read_trc(folder / "walk.trc")
    write_trc(folder / "odd.trc", walk.relabel({name: f"m{k}" for k, name in enumerate(walk.labels)}))
    assert (
        main(["ik", "lower_limb_14dof", str(folder / "odd.trc"), "--out", str(folder / "out")]) == EXIT_INPUT
    )
    message = capsys.readouterr().err
    assert "--marker MARKER=LABEL" in message
    assert str(folder / "odd.trc") in message


def test_a_model_without_markers_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bare = to_document(load_builtin("lower_limb_14dof").with_markers(()))
    (folder / "bare.json").write_text(json.dumps(bare), encoding="utf-8")
    given = ["ik", str(folder / "bare.json"), str(folder / "walk.trc"), "--out", str(folder / "out")]
    assert main(given) == EXIT_INPUT
    assert "has no markers" in capsys.readouterr().err
