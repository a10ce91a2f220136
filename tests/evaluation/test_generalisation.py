"""Held-out beside fitted: means over trials, and nothing where nothing was held out."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from scaling_service.capabilities.motion.kinematic_error import KinematicError
from scaling_service.capabilities.scaling import saving
from scaling_service.capabilities.scaling.comparison.evidence import average_errors
from scaling_service.capabilities.scaling.run import compare
from scaling_service.capabilities.scaling.saving import make_method_document
from scaling_service.cli import main
from tests.jobs.laboratory import document, laboratory, write_subject


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Writing .osim files takes a second each, and is tested elsewhere."""
    monkeypatch.setattr(saving, "render_scaled", lambda found, _: ["<model/>"] * len(found))


def error(mean: float, frames: int = 10) -> KinematicError:
    return KinematicError(
        mean=mean,
        sd=0.0,
        rms=mean,
        max=mean,
        per_marker={},
        anatomical_mean=mean,
        tracking_mean=mean,
        n_frames=frames,
    )


def test_every_trial_counts_once() -> None:
    errors = {"hip": error(0.002, 1000), "knee": error(0.006, 10), "walk": error(0.005), "run": error(0.011)}
    fitted, held_out = average_errors(errors, ["hip", "knee"]), average_errors(errors, ["walk", "run"])
    assert fitted is not None
    assert held_out is not None
    assert (fitted.mean, held_out.mean) == pytest.approx((0.004, 0.008))


def test_a_trial_that_shows_no_marker_does_not_count() -> None:
    errors = {"hip": error(0.002), "knee": error(float("nan"))}
    found = average_errors(errors, ["hip", "knee"])
    assert found is not None
    assert found.mean == 0.002
    assert average_errors(errors, ["knee"]) is None


def test_the_document_holds_both_means(tmp_path: Path) -> None:
    results = compare(laboratory(tmp_path), ("MB", "MB_am"))
    for scaling in results.scalings.values():
        written = make_method_document(scaling, results, results.gait[scaling.calibration.method])
        errors = written.kinematic_error_mm
        assert written.fitted_mean_mm == errors["hips"].mean
        assert written.held_out_mean_mm == errors["walk"].mean
        assert written.held_out_ratio == pytest.approx(errors["walk"].mean / errors["hips"].mean, abs=1e-3)
    alone = replace(results, loaded=replace(results.loaded, session=replace(results.session, calibration=())))
    scaling = results.scalings["MB"]
    written = make_method_document(scaling, alone, alone.gait[scaling.calibration.method])
    assert (written.fitted_mean_mm, written.held_out_ratio) == (None, None)


def test_what_is_missing_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    laboratory(tmp_path)
    file = write_subject(tmp_path, document(trials={"static": "standing.trc", "calibration": ["hips.trc"]}))
    assert main(["compare", str(file), "--methods", "MB,MB_am", "--out", str(tmp_path / "out")]) == 0
    shown = capsys.readouterr().out
    assert "there is no evaluation trial" in shown
    (row,) = (line for line in shown.splitlines() if "mean, held out" in line)
    assert row.split()[-2:] == ["none", "none"]
    written = json.loads((tmp_path / "out" / "comparison.json").read_text(encoding="utf-8"))
    assert written["methods"]["MB_am"]["held_out_mean_mm"] is None
    assert any("no evaluation trial" in warning for warning in written["warnings"])
