"""The prior: it holds what nothing determines, and gives way to what the recording says."""

from __future__ import annotations

import numpy as np
import pytest

from scaling_service.capabilities.motion.inverse_kinematics import inverse_kinematics
from scaling_service.capabilities.scaling.methods.table import calibrate
from scaling_service.capabilities.shared.settings import CalibrationSettings
from scaling_service.model.results import Calibration
from scaling_service.virtual.example import make_demo_session
from tests.calibration.people import person
from tests.calibration.test_optimised import TILTS, start_at


def shifts_mm(found: Calibration) -> np.ndarray:
    """Size of every marker's fitted shift."""
    by_marker: dict[str, list[float]] = {}
    for parameter in found.parameters:
        if parameter.group == "marker":
            by_marker.setdefault(parameter.target, []).append(parameter.value)
    return 1e3 * np.array([np.linalg.norm(v) for v in by_marker.values()])


def test_skin_movement_does_not_carry_markers_to_their_bounds() -> None:
    session, _ = make_demo_session(0)
    held = calibrate(session, "MB_am")
    loose = calibrate(session, "MB_am", CalibrationSettings(prior=False))
    assert not any(p.at_bound for p in held.parameters)
    assert shifts_mm(held).mean() < 0.7 * shifts_mm(loose).mean()
    unseen = [inverse_kinematics(c.model, session.evaluation[0]).distances for c in (held, loose)]
    assert np.nanmean(unseen[0]) < np.nanmean(unseen[1])


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.costly)])
def test_on_skin_movement_too_together_is_never_worse_than_the_papers_loop(seed: int) -> None:
    session, _ = make_demo_session(seed)
    for method in ("MB_lam", "MB_am"):
        joint, paper = (
            calibrate(session, method, CalibrationSettings(strategy=s)) for s in ("joint", "alternating")
        )
        assert joint.cost <= paper.cost, method


def test_the_prior_gives_way_where_the_recording_is_sure() -> None:
    known = person(31, tilts_deg=TILTS, factors={"femur_r": (1.06,) * 3})
    found = calibrate(known.session, "MB_lam", known={"MB": start_at(known)})
    values = {p.name: p.value for p in found.parameters}
    assert abs(values["scale.femur_r"] - 1.06) < 1e-6
    assert found.cost < 1e-14


def test_what_only_the_prior_holds_is_not_called_identifiable() -> None:
    known = person(32, shift_m=0.004, noise_m=0.001, seconds=6.0)
    found = calibrate(known.session, "MB_am")
    by_name = {p.name: p for p in found.parameters}
    assert not by_name["axis.knee_r.y"].identifiable  # the thigh's markers may turn with it
    assert all(np.isfinite(p.sd) for p in found.parameters)
    assert any("not determined" in w for w in found.warnings)
