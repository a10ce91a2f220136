"""A few cases of the bank through the command line, and one in a process of its own, as an outsider would."""

from __future__ import annotations

import json
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import yaml

from scaling_service.cli import main
from scaling_service.files.sto import Table, read_sto, write_sto
from tests.blind.cases import PAIRS, Case
from tests.blind.making import make
from tests.blind.run import run_one
from tests.blind.scoring.outcomes import Outcome
from tests.blind.scoring.records import Record

pytestmark = pytest.mark.skipif(find_spec("opensim") is None, reason="the opensim library is not installed")

COSTLY = pytest.mark.costly  # ten seconds each and more, or in a pair that is run in any case
HIDDEN = [
    pytest.param(Case("effect", ("soft_tissue_artefact",), "middle", "gait", False, 0), marks=COSTLY),
    pytest.param(Case("effect", ("skin_wobble",), "large", "gait", False, 0), marks=COSTLY),
    Case("pair", PAIRS[0], "large", "gait", False, 0),
    pytest.param(Case("pair", PAIRS[10], "large", "gait", True, 0), marks=COSTLY),
]
NOTHING = [
    Case("null", ("autocorrelated",), "none", "gait", False, 0),
    pytest.param(Case("null", ("other_scale",), "none", "varied", True, 399), marks=COSTLY),
]
STRANGE = [
    Case("stranger", ("marker_restuck",), "large", "gait", False, 0),
    pytest.param(Case("stranger", ("vibrating_camera",), "large", "gait", False, 0), marks=COSTLY),
]
STRANGE += [
    pytest.param(Case("stranger", (kind,), "large", "gait", True, 0), marks=COSTLY)
    for kind in ("clock_drift", "slipping_sole")
]


def outcome(case: Case, folder: Path) -> Record:
    """What the command line says of a case."""
    subject = make(case, folder / "subjects", folder / "labels")
    assert main(["discover", str(subject), "--start", "none", "--out", str(folder / "out")]) == 0
    truth = json.loads((folder / "labels" / f"{case.id}.json").read_text(encoding="utf-8"))
    result = json.loads((folder / "out" / "discovery.json").read_text(encoding="utf-8"))
    return Outcome(truth, result, None).record


def title(case: Case) -> str:
    """What is in it."""
    return "_and_".join(case.kinds)


@pytest.mark.parametrize("case", HIDDEN, ids=title)
def test_what_is_hidden_is_named_and_the_gap_closes(case: Case, tmp_path: Path) -> None:
    found = outcome(case, tmp_path)
    assert found.right, found.named
    assert not found.superfluous, found.named
    assert found.closed is not None
    assert found.closed > 0.75


@pytest.mark.parametrize("case", NOTHING, ids=title)
def test_where_nothing_is_hidden_nothing_is_named(case: Case, tmp_path: Path) -> None:
    assert not outcome(case, tmp_path).named


@pytest.mark.parametrize("case", STRANGE, ids=title)
def test_what_the_catalogue_does_not_have_is_reported_as_unexplained(case: Case, tmp_path: Path) -> None:
    found = outcome(case, tmp_path)
    assert found.stranger_seen, found.first_name
    assert found.verdict == "unexplained"


@COSTLY
def test_a_foot_whose_plate_is_nowhere_in_the_recordings_is_named(tmp_path: Path) -> None:
    """No moment of any recording tells what the forces are like where nothing is missing."""
    case = Case("null", ("white",), "none", "varied", True, 0)
    subject = make(case, tmp_path / "subjects", tmp_path / "labels")
    document = yaml.safe_load(subject.read_text(encoding="utf-8"))
    files = ["squat_1.trc", "shift_1.trc", "bounce_2.trc"]
    document["trials"] |= {"calibration": files[:-1], "evaluation": files[-1:]}
    document["forces"] = {file: document["forces"][file] for file in files}
    subject.write_text(yaml.safe_dump(document), encoding="utf-8")
    whole = {file: read_sto(subject.parent / name) for file, name in document["forces"].items()}
    for file, name in document["forces"].items():
        kept = [k for k, column in enumerate(whole[file].columns) if "_2_" not in column]
        columns = tuple(whole[file].columns[k] for k in kept)
        write_sto(
            subject.parent / name,
            Table(name=name, columns=columns, data=whole[file].data[:, kept], in_degrees=False),
        )
    said = run_one([sys.executable, "-m", "scaling_service", "discover"], subject, tmp_path / "out", "none")
    assert said.startswith("done"), (tmp_path / "out" / "failed.txt").read_text(encoding="utf-8")
    result = json.loads((tmp_path / "out" / "discovery.json").read_text(encoding="utf-8"))
    assert {(e["kind"], *e["where"]) for e in result["effects"]} == {("external_contact", "calcn_l")}
    found = read_sto(tmp_path / "out" / "bounce_2_contact.sto").data
    true = whole["bounce_2.trc"]
    vertical = np.interp(found[:, 0], true.data[:, 0], true.data[:, true.columns.index("ground_force_2_vy")])
    weight = 9.81 * document["subject"]["mass_kg"]
    assert np.sqrt(np.mean((found[:, 2] - vertical) ** 2)) < 0.05 * weight
