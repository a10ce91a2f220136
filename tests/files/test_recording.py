"""Every registered reader gives the same trial back; other suffixes are refused with what is supported."""

from __future__ import annotations

import numpy as np
import pytest

from scaling_service.core.errors import FileUnreadable
from scaling_service.files.c3d_file import write_c3d
from scaling_service.files.recording import READERS, read_recording
from scaling_service.files.trc import write_trc
from scaling_service.model.trial import Trial

WRITERS = {".trc": write_trc, ".c3d": write_c3d}


@pytest.mark.parametrize("suffix", sorted(READERS))
@pytest.mark.parametrize("case", [str.lower, str.upper])
def test_every_reader_gives_the_trial_back(tmp_path, suffix, case):
    markers = np.random.default_rng(0).uniform(0.1, 2, (12, 4, 3))
    markers[3:5, 1] = np.nan
    trial = Trial("walk.one", np.arange(12) / 100, ("S1:RASI", "LASI", "R Knee", "SACR"), markers, 100.0)
    path = tmp_path / f"walk.one{case(suffix)}"
    WRITERS[suffix](path, trial)
    back = read_recording(path)
    assert (back.name, back.labels, back.rate_hz, back.repairs) == ("walk.one", trial.labels, 100.0, ())
    np.testing.assert_allclose(back.markers, markers, atol=2e-7)
    np.testing.assert_allclose(back.times, trial.times, atol=1e-9)
    assert not back.markers.flags.writeable


@pytest.mark.parametrize("name", ["walk.csv", "walk", "walk.mot"])
def test_other_formats_are_refused_with_what_is_supported(tmp_path, name):
    with pytest.raises(FileUnreadable, match=r"Supported are \.c3d, \.trc"):
        read_recording(tmp_path / name)


@pytest.mark.parametrize("suffix", sorted(READERS))
def test_every_reader_refuses_the_same_wrong_files(tmp_path, suffix):
    path = tmp_path / f"wrong{suffix}"
    with pytest.raises(FileUnreadable, match="no such file"):
        read_recording(path)
    for content in (b"", b"\n", b"plain text\n", b"\x00" * 2000, bytes(range(256)) * 8):
        path.write_bytes(content)
        with pytest.raises(FileUnreadable) as caught:
            read_recording(path)
        assert caught.value.file == str(path)
        assert caught.value.remedy
