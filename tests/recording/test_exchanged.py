"""Labels that changed places are told with their time span; ordinary movement is not."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from scaling_service.files.recording import read_recording
from scaling_service.model.trial import Trial
from scaling_service.recording.person import ask_exchanged
from scaling_service.virtual.example import make_demo_session

RATE_HZ = 100.0
LABELS = ("RASIS", "LASIS", "RPSIS", "LPSIS", "RLFE", "RMFE", "LLFE", "LMFE", "RLM", "RMM", "LLM", "LMM")
PLACES = np.array(
    [
        *([0.1, 0.95, 0.12], [0.1, 0.95, -0.12], [-0.1, 0.98, 0.05], [-0.1, 0.98, -0.05]),
        *([0.0, 0.5, 0.14], [0.0, 0.5, 0.03], [0.0, 0.5, -0.14], [0.0, 0.5, -0.03]),
        *([0.0, 0.1, 0.12], [0.0, 0.1, 0.04], [0.0, 0.1, -0.12], [0.0, 0.1, -0.04]),
    ]
)


def find_exchanged_sides(trial: Trial) -> tuple[str, ...]:
    return tuple(map(str, ask_exchanged(trial)))


def _turning(seconds: float = 4.0, turn_hz: float = 0.25) -> Trial:
    """A body that turns about the vertical, so that no direction of the room means anything."""
    times = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    angle = 2 * np.pi * turn_hz * times
    zero = np.zeros_like(angle)
    rotation = np.stack(
        (
            np.stack((np.cos(angle), zero, np.sin(angle)), -1),
            np.stack((zero, zero + 1.0, zero), -1),
            np.stack((-np.sin(angle), zero, np.cos(angle)), -1),
        ),
        axis=1,
    )
    markers = np.einsum("fij,mj->fmi", rotation, PLACES)
    markers += np.random.default_rng(0).normal(0.0, 0.001, markers.shape)
    return Trial(name="turn", times=times, labels=LABELS, markers=markers, rate_hz=RATE_HZ)


def _swapped(trial: Trial, one: str, other: str, rows: slice = slice(None)) -> Trial:
    markers = trial.markers.copy()
    a, b = trial.index(one), trial.index(other)
    markers[rows, a], markers[rows, b] = trial.markers[rows, b], trial.markers[rows, a]
    return trial.with_markers(markers)


def _unseen(trial: Trial, labels: tuple[str, ...], rows: slice = slice(None)) -> Trial:
    markers = trial.markers.copy()
    markers[rows, [trial.index(label) for label in labels]] = np.nan
    return trial.with_markers(markers)


def test_a_body_that_turns_round_gives_no_word() -> None:
    assert find_exchanged_sides(_turning()) == ()


@pytest.mark.parametrize(
    ("rows", "span"),
    [
        (slice(100, 250), "from 1.00 s to 2.49 s:"),
        (slice(300, None), "from 3.00 s to 3.99 s, the end:"),
        (slice(0, 350), "from 0.00 s to 3.49 s:"),  # longer than not: the pelvis tells which part is wrong
        (slice(None), "throughout:"),
    ],
)
@pytest.mark.parametrize("pair", [("RLFE", "RMFE"), ("LLM", "LMM")])
def test_an_exchange_is_reported_with_its_time_span(pair: tuple[str, str], rows: slice, span: str) -> None:
    (said,) = find_exchanged_sides(_swapped(_turning(), *pair, rows))
    assert said.startswith("turn: ")
    assert f"{pair[0]} and {pair[1]}" in said
    assert span in said
    assert "correct the labels in the recording" in said


@pytest.mark.parametrize(
    "hidden", [LABELS[:2], LABELS[:4], (*LABELS[:4], "LLFE", "LLM")], ids=["asis", "pelvis", "left"]
)
def test_other_landmarks_tell_the_side_where_the_pelvis_is_hidden(hidden: tuple[str, ...]) -> None:
    trial = _unseen(_turning(), hidden)
    assert find_exchanged_sides(trial) == ()
    (said,) = find_exchanged_sides(_swapped(trial, "RLFE", "RMFE", slice(100, 290)))
    assert "from 1.00 s to 2.89 s" in said


def test_one_pair_alone_accuses_no_other() -> None:
    trial = _unseen(_turning(), (*LABELS[:4], "LLFE", "LLM"))
    assert find_exchanged_sides(_swapped(trial, "RLFE", "RMFE")) == ()


def test_a_flicker_is_not_worth_a_word() -> None:
    assert find_exchanged_sides(_swapped(_turning(), "RLFE", "RMFE", slice(100, 108))) == ()
    assert find_exchanged_sides(_swapped(_turning(), "RLFE", "RMFE", slice(100, 112))) != ()


def test_two_stretches_are_two_sentences() -> None:
    trial = _swapped(_swapped(_turning(), "RLM", "RMM", slice(50, 80)), "RLM", "RMM", slice(200, 260))
    spans = [re.search(r"from (\S+) s to (\S+) s", said) for said in find_exchanged_sides(trial)]
    assert [match.groups() for match in spans if match] == [("0.50", "0.79"), ("2.00", "2.59")]


def test_an_exchange_behind_a_gap_is_found_and_a_turn_behind_a_gap_is_none() -> None:
    """In two seconds unseen this body turns half round: against the pelvis nothing changed."""
    hidden = _unseen(_turning(), ("RLFE",), slice(100, 300))
    assert find_exchanged_sides(hidden) == ()
    (said,) = find_exchanged_sides(_swapped(hidden, "RLFE", "RMFE", slice(300, None)))
    assert "to 3.99 s, the end" in said


def test_arms_are_judged_by_jumps_only() -> None:
    trial = _turning()
    elbows = np.stack(([0.0, 1.1, 0.2], [0.0, 1.1, 0.3]))  # the lateral one inside: the arm is turned
    markers = np.concatenate((trial.markers, np.broadcast_to(elbows, (trial.n_frames, 2, 3))), axis=1)
    turned = Trial(
        name="arm", times=trial.times, labels=(*LABELS, "RELB", "RMEL"), markers=markers, rate_hz=RATE_HZ
    )
    assert find_exchanged_sides(turned) == ()
    (said,) = find_exchanged_sides(_swapped(turned, "RELB", "RMEL", slice(120, 180)))
    assert "RELB and RMEL look exchanged from 1.20 s to 1.79 s" in said


def test_roles_say_what_labels_mean() -> None:
    trial = _swapped(_turning(), "RLFE", "RMFE", slice(100, 250)).relabel(
        {"RLFE": "S:RKNE", "RMFE": "S:RKNI"}
    )
    (said,) = find_exchanged_sides(trial)
    assert "S:RKNE and S:RKNI" in said


def test_nothing_seen_is_nothing_said() -> None:
    assert find_exchanged_sides(_unseen(_turning(), LABELS)) == ()
    assert find_exchanged_sides(_turning().select(["RASIS"])) == ()
    assert find_exchanged_sides(_turning().frames(slice(0, 1))) == ()


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_virtual_persons_move_without_a_word(seed: int) -> None:
    session, _ = make_demo_session(seed)
    assert session.static is not None
    for trial in (session.static, *session.dynamic):
        assert find_exchanged_sides(trial) == (), trial.name


def test_real_recordings(shared_data: Path) -> None:
    """One of them has two labels exchanged from frame 733 on, one those of a foot all along; no others."""
    files = sorted(p for p in shared_data.rglob("*") if p.suffix.lower() in (".c3d", ".trc"))
    said = {}
    for file in files:
        said[file.relative_to(shared_data).as_posix()] = find_exchanged_sides(read_recording(file))
    assert len(said) >= 10
    (foot,) = said.pop("runners/RBDS001/runT35.c3d")
    assert "R.MT5 and R.MT1 look exchanged throughout" in foot
    (warning,) = said.pop("functional/right_hip.c3d")
    assert "RLFE and RMFE look exchanged from 7.32 s to 16.89 s, the end" in warning
    assert not any(said.values()), said
