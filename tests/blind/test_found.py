"""A few cases of the bank through the command line, as an outsider would run them."""

from __future__ import annotations

import json
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.blind.cases import PAIRS, Case
from tests.blind.making import make
from tests.blind.run import run_one
from tests.blind.scoring.outcomes import Outcome

pytestmark = pytest.mark.skipif(find_spec("opensim") is None, reason="the opensim library is not installed")

HIDDEN = [
    Case("effect", ("soft_tissue_artefact",), "middle", "gait", False, 0),
    Case("effect", ("joint_centre_offset",), "small", "gait", False, 0),
    Case("effect", ("force_delay",), "middle", "gait", True, 0),
    Case("effect", ("segment_com",), "large", "gait", True, 0),
    Case("pair", PAIRS[0], "large", "gait", False, 0),
]
NOTHING = [Case("null", (noise,), "none", "gait", False, 0) for noise in ("autocorrelated", "heavy_tailed")]
STRANGE = [
    Case("stranger", ("marker_restuck",), "large", "gait", False, 0),
    Case("stranger", ("clock_drift",), "large", "gait", True, 0),
    Case("stranger", ("plate_saturation",), "large", "gait", True, 0),
]


def outcome(case: Case, folder: Path) -> Outcome:
    """What the command line says of a case."""
    subject = make(case, folder / "subjects", folder / "labels")
    said = run_one([sys.executable, "-m", "scaling_service", "discover"], subject, folder / "out", "none")
    assert said.startswith("done"), (folder / "out" / "failed.txt").read_text(encoding="utf-8")
    truth = json.loads((folder / "labels" / f"{case.id}.json").read_text(encoding="utf-8"))
    result = json.loads((folder / "out" / "discovery.json").read_text(encoding="utf-8"))
    return Outcome(truth, result, None)


def title(case: Case) -> str:
    """What is in it."""
    return "_and_".join(case.kinds)


@pytest.mark.parametrize("case", HIDDEN, ids=title)
def test_what_is_hidden_is_named_and_the_gap_closes(case: Case, tmp_path: Path) -> None:
    found = outcome(case, tmp_path)
    assert found.right, found.effects
    assert not found.superfluous, found.effects
    closed = found.closed()
    assert closed is not None
    assert closed > 0.9


@pytest.mark.parametrize("case", NOTHING, ids=title)
def test_where_nothing_is_hidden_nothing_is_named(case: Case, tmp_path: Path) -> None:
    assert not outcome(case, tmp_path).effects


@pytest.mark.parametrize("case", STRANGE, ids=title)
def test_what_the_catalogue_does_not_have_is_told_as_unexplained(case: Case, tmp_path: Path) -> None:
    found = outcome(case, tmp_path)
    assert found.stranger_seen, found.first_name
    assert found.result is not None
    assert found.result["verdict"] == "unexplained"
