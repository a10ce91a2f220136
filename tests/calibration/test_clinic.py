"""Children as a clinic records them: lengths beside those of the laboratory's own software."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.scaling.methods.marker_based import scale_linearly
from scaling_service.capabilities.shared.settings import CalibrationSettings
from scaling_service.capabilities.subject.loading import load, read_files
from scaling_service.model.anatomy.lengths import measure_segment_lengths
from scaling_service.model.subject import Subject

pytestmark = pytest.mark.costly  # reads and scales every child of the clinic
THEIRS = {"femur": "FemurLength", "shank": "TibiaLength"}


@pytest.fixture(scope="module")
def differences(shared_data: Path) -> dict[str, dict[str, float]]:
    """Child to length to ours over theirs, minus one; sizes come from the C3D files alone."""
    if not (shared_data / "clinic").is_dir():
        pytest.skip("no recordings of a clinic here")
    found = {}
    for child in sorted((shared_data / "clinic").iterdir()):
        static, moving, *_ = sorted(child.glob("*.c3d"))
        subject = Subject(id=child.name, model="lower_limb_14dof", static=static, calibration=(moving,))
        session = load(subject, read_files(subject)).session
        ours = measure_segment_lengths(scale_linearly(session, CalibrationSettings()).model)
        sizes = next(iter(json.loads((child / "sizes.json").read_text(encoding="utf-8")).values()))
        found[child.name] = {
            f"{name}_{side}": 1e3 * ours[f"{name}_{side}"] / sizes[f"{side.upper()}{theirs}"] - 1.0
            for name, theirs in THEIRS.items()
            for side in "rl"
        }
    return found


def test_lengths_agree_with_the_laboratorys(differences: dict[str, dict[str, float]]) -> None:
    worst = [max(map(abs, child.values())) for child in differences.values()]
    assert max(worst) <= 0.06, differences
    assert np.median(worst) <= 0.03, differences


def test_sides_do_not_differ_in_kind(differences: dict[str, dict[str, float]]) -> None:
    for name in THEIRS:
        right, left = (np.mean([child[f"{name}_{s}"] for child in differences.values()]) for s in "rl")
        assert abs(right - left) < 0.01
