"""OpenSim tables: round trips, header versions, ambiguity of degrees, refusals."""

from __future__ import annotations

import importlib.util
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scaling_service.core.errors import FileUnreadable, InputError, TrialUnusable
from scaling_service.files.sto import Table, read_sto, tabulate_motion, write_sto
from tests.files.made import SHARED_FOLDER, outcome


def _read(tmp_path, text):
    (tmp_path / "a.sto").write_bytes(text.encode())
    return read_sto(tmp_path / "a.sto")


@given(
    n=st.integers(1, 20),
    k=st.integers(0, 5),
    degrees=st.sampled_from([True, False, None]),
    seed=st.integers(0, 999),
)
@SHARED_FOLDER
def test_round_trip(tmp_path, n, k, degrees, seed):
    rng = np.random.default_rng(seed)
    data = rng.normal(size=(n, k + 1)) * 10.0 ** rng.integers(-6, 7, size=(n, k + 1))
    data[rng.random(data.shape) < 0.2] = np.nan
    data[:, 0] = np.cumsum(rng.uniform(0.001, 1, n))
    table = Table(
        name="my table", columns=("time", *(f"c{i}" for i in range(k))), data=data, in_degrees=degrees
    )
    write_sto(tmp_path / "a.sto", table)
    back = read_sto(tmp_path / "a.sto")
    assert (back.columns, back.in_degrees) == (table.columns, degrees)
    np.testing.assert_allclose(back.data, data, rtol=1e-11)
    assert {r.what for r in back.repairs} == ({"in_degrees"} if degrees is None else set())


def test_versions_spaces_line_ends_and_missing_cells(tmp_path):
    one = "name\nversion=1\nnRows=2\nnColumns=3\ninDegrees=yes\nendheader\ntime\ta\tb\n0\t1\t\n0.1\tNaN\t4\n"
    table = _read(tmp_path, one)
    np.testing.assert_array_equal(table.data, [[0, 1, np.nan], [0.1, np.nan, 4]])
    assert table.in_degrees is True
    assert [r.what for r in table.repairs] == ["blank_cells"]
    two = "nColumns=3\nnRows=2\nDataType=double\nversion=3\nendheader\ntime a b\n0 1 2\n.1 3 4\n"
    table = _read(tmp_path, two.replace("\n", "\r\n"))
    np.testing.assert_array_equal(table.data, [[0, 1, 2], [0.1, 3, 4]])
    assert table.in_degrees is None
    assert [r.what for r in table.repairs] == ["in_degrees"]
    simm = "motion\ndatacolumns 2\ndatarows 1\nrange 0 1\nendheader\ntime\ta\n0\t1\n"
    table = _read(tmp_path, simm)
    assert table.header == {"nColumns": "2", "nRows": "1"}


def test_wrong_counts_short_rows_and_trailing_tabs(tmp_path):
    table = _read(
        tmp_path,
        "n\t\t\nversion=1\t\t\nnRows=9\t\t\nnColumns=3\ninDegrees=no\t\nendheader\t\t\ntime\ta\tb\t\n0\t1\t2\t\n1\t3\n",
    )
    np.testing.assert_array_equal(table.data, [[0, 1, 2], [1, 3, np.nan]])
    assert table.in_degrees is False
    assert {r.what for r in table.repairs} == {"header", "short_rows"}


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "empty"),
        ("time\ta\n0\t1\n", "endheader"),
        ("x\nendheader\n", "ends after its header"),
        ("x\nendheader\ntime\ta\n", "no row"),
        ("x\nendheader\na\tb\n0\t1\n", "first column is 'a'"),
        ("x\nendheader\ntime\ta\tb\ta\n0\t1\t2\t3\n", "'a': in columns 2 and 4"),
        ("x\nendheader\ntime\ta\t\tb\n0\t1\t2\t3\n", "column 3 has no name"),
        ("x\nendheader\ntime\ta\n0\tok\n", "'ok'"),
        ("x\nendheader\ntime\ta\n0\t1\n0\t2\n", "not later"),
        ("x\nDataType=Vec3\nendheader\ntime\ta\n0\t1,2,3\n", "Vec3"),
        ("\x00\x00", "binary"),
    ],
)
def test_wrong_tables_are_refused(tmp_path, text, problem):
    with pytest.raises(InputError, match=problem) as caught:
        _read(tmp_path, text)
    assert isinstance(caught.value, FileUnreadable | TrialUnusable)
    assert caught.value.remedy


@given(st.data())
@settings(SHARED_FOLDER, max_examples=150)
def test_damage_gives_a_table_or_a_clear_refusal(tmp_path, data):
    write_sto(
        tmp_path / "a.sto",
        Table(name="t", columns=("time", "a", "b"), data=np.arange(12.0).reshape(4, 3), in_degrees=True),
    )
    content = bytearray((tmp_path / "a.sto").read_bytes())
    for _ in range(data.draw(st.integers(1, 5))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(
            st.one_of(st.integers(0, 255), st.sampled_from(b"\t\n ,.e9-_"))
        )
    (tmp_path / "a.sto").write_bytes(content[: data.draw(st.integers(0, len(content)))])
    table = outcome(read_sto, tmp_path / "a.sto")
    if isinstance(table, InputError):
        assert table.file
        assert table.remedy
    else:
        assert (np.diff(table.times) > 0).all()
        assert not np.isinf(table.data).any()


def test_motion_is_in_degrees_and_metres():
    q = np.array([[np.pi / 2, 1.0], [np.pi, -2.0]])
    kinds = {"hip": "rotation", "tx": "translation"}
    table = tabulate_motion("m", [0.0, 0.1], list(kinds), list(kinds.values()), q)
    np.testing.assert_allclose(table.data, [[0, 90, 1], [0.1, 180, -2]])
    assert table.in_degrees is True
    assert table.columns == ("time", "hip", "tx")


def test_columns_by_name():
    table = Table(name="m", columns=("time", "a"), data=np.array([[0.0, 5.0]]))
    assert table.column("a").tolist() == [5]
    with pytest.raises(TrialUnusable, match="no column 'b'; there are time, a"):
        table.column("b")
    with pytest.raises(ValueError, match="columns"):
        Table(name="m", columns=("time",), data=np.zeros((2, 2)))
    with pytest.raises(TrialUnusable, match="column name"):
        write_sto("unused.sto", Table(name="m", columns=("time", "a\tb"), data=np.zeros((1, 2))))


@pytest.mark.skipif(importlib.util.find_spec("opensim") is None, reason="opensim is not installed")
def test_opensim_reads_what_is_written(tmp_path):
    q = np.random.default_rng(0).normal(size=(4, 2))
    holed = q.copy()
    holed[1, 0] = np.nan
    for name, values in (("whole.mot", q), ("holed.mot", holed)):
        write_sto(
            tmp_path / name,
            tabulate_motion("m", np.arange(4) / 100, ["hip", "tx"], ["rotation", "translation"], values),
        )
    script = (
        "import opensim, numpy as np\n"
        "opensim.Logger.setLevelString('Off')\n"
        "s = opensim.Storage('whole.mot')\n"
        "t = opensim.TimeSeriesTable('holed.mot')\n"
        "np.save('a.npy', t.getMatrix().to_numpy())\n"
        "print(','.join(t.getColumnLabels()), s.isInDegrees(), s.getSize())\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["hip,tx", "True", "4"]
    np.testing.assert_allclose(np.load(tmp_path / "a.npy"), holed * [180 / np.pi, 1], rtol=1e-10)


def test_real_tables_are_read_whole(shared_data):
    expected = {
        "gait2354/subject01_walk1_grf.mot": (1501, 19, True),
        "rajagopal_walk/grf_walk.mot": (4778, 19, False),
        "opencap_squat/squats1_grf.mot": (1346, 28, None),
        "jia_mri/Walking01_kinematics.mot": (102, 14, True),
    }
    for name, (rows, columns, degrees) in expected.items():
        table = read_sto(shared_data / name)
        assert (*table.data.shape, table.in_degrees) == (rows, columns, degrees)
        assert np.isfinite(table.data).all()
