"""What persons share is told where none of them alone would tell it, and only that."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.discovery.laws.candidates import Candidate
from scaling_service.capabilities.discovery.recurring import pool_leanings
from scaling_service.capabilities.discovery.search.leanings import Leaning
from scaling_service.cli import main

SD, TRUE, NOISE = 0.1, 0.2, 0.08  # of a segment's mass, a share
TILT = Candidate(kind="segment_mass", where=("torso",), columns=())


def lean(measured: float) -> Leaning:
    """Of a person whose recordings say a number with the same deviation."""
    posterior = 1.0 / (1.0 / SD**2 + 1.0 / NOISE**2)
    return Leaning.of(
        TILT, np.array([posterior * measured / NOISE**2]), np.array([[posterior]]), np.array([SD])
    )


def test_many_persons_tell_what_one_does_not() -> None:
    measured = TRUE + NOISE * np.random.default_rng(1).normal(size=12)
    alone = [pool_leanings([lean(value)]).bayes for value in measured]
    together = pool_leanings([lean(value) for value in measured])
    assert max(alone) < 6.0
    assert together.bayes > 6.0
    assert together.size[0] == pytest.approx(TRUE, abs=3.0 * NOISE / np.sqrt(12))
    sd = float(np.sqrt(together.covariance[0, 0]))
    assert sd == pytest.approx(1.0 / np.sqrt(1.0 / SD**2 + 12 / NOISE**2))


def test_a_person_speaks_for_a_size_or_against_it() -> None:
    assert lean(TRUE).weigh(np.array([TRUE])) > 0.0 > lean(0.0).weigh(np.array([TRUE]))
    scaled = lean(TRUE).rescale(2.0)
    assert scaled.weigh(np.array([TRUE / 2.0])) == pytest.approx(lean(TRUE).weigh(np.array([TRUE])))


def test_a_folder_of_persons_is_searched_for_what_recurs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["example", "--persons", "2", "--out", str(tmp_path / "persons")]) == 0
    names = sorted(path.name for path in (tmp_path / "persons").iterdir() if path.is_dir())
    out = tmp_path / "found"
    assert main(["discover", str(tmp_path / "persons"), "--no-report", "--out", str(out)]) == 0
    assert "recurs" in capsys.readouterr().out
    found = json.loads((out / "recurring.json").read_text(encoding="utf-8"))
    assert len(found["subjects"]) == len(names) == 2
    assert found["schema_version"] == 1
    assert found["code_version"]
    assert not any(effect["named"] for effect in found["effects"])  # their bodies are the model's, scaled
    assert all((out / who / "discovery.json").is_file() for who in found["subjects"])


def test_one_person_shares_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "persons" / "P1"
    assert main(["example", "--out", str(folder)]) == 0
    assert main(["discover", str(tmp_path / "persons"), "--no-report", "--out", str(tmp_path / "found")]) == 2
    assert "needs 2 persons" in capsys.readouterr().err
