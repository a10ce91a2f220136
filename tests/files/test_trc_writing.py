"""TRC: what is written comes back, here and in OpenSim."""

from __future__ import annotations

import importlib.util
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scaling_service.core.errors import TrialUnusable
from scaling_service.files.trc import read_trc, write_trc
from scaling_service.model.trial import Trial
from tests.files.made import SHARED_FOLDER, random_trial


@given(
    n=st.integers(1, 30),
    m=st.integers(1, 6),
    seed=st.integers(0, 999),
    rate=st.sampled_from([50.0, 59.94, 60.0, 100.0, 120.0, 333.3, 1000.0]),
    start=st.sampled_from([0.0, 0.5, 17.25]),
    units=st.sampled_from(["m", "mm"]),
)
@SHARED_FOLDER
def test_round_trip(tmp_path, n, m, seed, rate, start, units):
    trial = random_trial(n, [f"M{k}" for k in range(m)], rate=rate, seed=seed, missing=0.2)
    trial = Trial(
        name=trial.name, times=start + trial.times, labels=trial.labels, markers=trial.markers, rate_hz=rate
    )
    write_trc(tmp_path / "walk.trc", trial, units)
    back = read_trc(tmp_path / "walk.trc")
    assert back.repairs == ()
    assert (back.name, back.labels, back.rate_hz) == (trial.name, trial.labels, pytest.approx(rate))
    np.testing.assert_allclose(back.markers, trial.markers, atol=5.1e-9)  # m: 5 decimals of a millimetre
    np.testing.assert_allclose(back.times, trial.times, atol=1e-9)


def test_a_marker_at_the_origin_survives_writing(tmp_path):
    trial = Trial(
        name="origin", times=np.array([0.0]), labels=("A",), markers=np.zeros((1, 1, 3)), rate_hz=100.0
    )
    write_trc(tmp_path / "o.trc", trial)
    np.testing.assert_allclose(read_trc(tmp_path / "o.trc").markers, 0, atol=1.1e-8)


def test_labels_that_would_break_the_table_are_refused(tmp_path):
    for label in ("A\tB", "", " A"):
        with pytest.raises(TrialUnusable, match="label"):
            write_trc(tmp_path / "a.trc", random_trial(1, (label,)))


@pytest.mark.skipif(importlib.util.find_spec("opensim") is None, reason="opensim is not installed")
def test_opensim_reads_what_is_written(tmp_path):
    trial = random_trial(5, ("RASI", "LASI", "SACR"), missing=0.3)
    write_trc(tmp_path / "w.trc", trial)
    script = (
        "import opensim, sys, numpy as np\n"
        "opensim.Logger.setLevelString('Off')\n"
        "t = opensim.TimeSeriesTableVec3(sys.argv[1])\n"
        "d = t.flatten()\n"
        "np.save(sys.argv[2], d.getMatrix().to_numpy())\n"
        "print(','.join(t.getColumnLabels()), t.getNumRows(), t.getTableMetaDataAsString('Units'))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, "w.trc", "w.npy"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == ["RASI,LASI,SACR", "5", "mm"]
    np.testing.assert_allclose(np.load(tmp_path / "w.npy").reshape(5, 3, 3), 1e3 * trial.markers, atol=1e-5)
