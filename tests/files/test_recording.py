"""Every registered reader gives the same trial back; other suffixes are refused with what is supported."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from scaling_service.core.errors import FileUnreadable
from scaling_service.files.recording import READERS, read_recording
from scaling_service.files.trc import write_trc
from scaling_service.model.trial import Trial
from tests.files.c3d_writing import write_c3d

WRITERS = {".trc": write_trc, ".c3d": write_c3d}


@pytest.mark.parametrize("suffix", sorted(WRITERS))
@pytest.mark.parametrize("case", [str.lower, str.upper])
def test_every_reader_gives_the_trial_back(tmp_path, suffix, case):
    markers = np.random.default_rng(0).uniform(0.1, 2, (12, 4, 3))
    markers[3:5, 1] = np.nan
    trial = Trial(
        name="walk.one",
        times=np.arange(12) / 100,
        labels=("S1:RASI", "LASI", "R Knee", "SACR"),
        markers=markers,
        rate_hz=100.0,
    )
    path = tmp_path / f"walk.one{case(suffix)}"
    WRITERS[suffix](path, trial)
    back = read_recording(path)
    assert (back.name, back.labels, back.rate_hz, back.repairs) == ("walk.one", trial.labels, 100.0, ())
    np.testing.assert_allclose(back.markers, markers, atol=2e-7)
    np.testing.assert_allclose(back.times, trial.times, atol=1e-9)
    assert not back.markers.flags.writeable


@pytest.mark.parametrize("name", ["walk.txt", "walk", "walk.mot"])
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


def test_a_format_of_another_distribution_is_read(tmp_path):
    about = tmp_path / "odd_format-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: odd-format\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[scaling_service.formats]\n.odd = odd_format:read_odd\n")
    (tmp_path / "odd_format.py").write_text(
        "import numpy as np\n"
        "from scaling_service.files.recording import Recording\n"
        "def read_odd(path):\n"
        "    values = np.loadtxt(path, ndmin=2)\n"
        "    markers = values[:, None, 1:]\n"
        "    return Recording(name=path.stem, times=values[:, 0], labels=('A',), markers=markers,\n"
        "                     rate_hz=100.0, unit='m')\n"
    )
    (tmp_path / "walk.ODD").write_text("0 1 2 3\n0.01 1 2 4\n")
    code = (
        "import sys, scaling_service\n"
        "found = scaling_service.read_recording(sys.argv[1])\n"
        "print(found.name, found.labels, found.position('A')[1].tolist(), found.plates)"
    )
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            f"import sys; sys.path.append({str(tmp_path)!r})\n{code}",
            str(tmp_path / "walk.ODD"),
        ],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == "walk ('A',) [1.0, 2.0, 4.0] None"


def test_plates_come_with_the_markers_and_what_is_wrong_with_them_does_not_hide_these(shared_data):
    walk = read_recording(shared_data / "jia_mri" / "Walking01.c3d")
    assert [plate.kind for plate in walk.plates.plates] == [1, 1]
    assert len(walk.plates.times) == 1090
    assert read_recording(shared_data / "opencap_squat" / "static1.trc").plates is None
    assert (walk.trial.labels, type(walk.trial)) == (walk.labels, Trial)
