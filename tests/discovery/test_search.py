"""What is hidden in a virtual person is found by name, place and size; where nothing is, nothing is named."""

from __future__ import annotations

import numpy as np
import pytest

from scaling_service.capabilities.discovery.evidence.fit import Recording
from scaling_service.capabilities.discovery.laws.apply import with_effects
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Estimate, Exchange, FreeMotion
from scaling_service.capabilities.discovery.laws.spots import At
from scaling_service.capabilities.discovery.search.discover import Discovery, discover
from scaling_service.model.trial import Trial
from tests.discovery.hidden import hide, person, recorded

HIDDEN = [
    ("marker_offset", ("RFH",), None, (15.0, 0.0, 15.0)),
    ("soft_tissue_artefact", ("RLFE",), "knee_angle_r", (0.4, 0.4, 0.0)),
    ("segment_length", ("tibia_r",), None, (1.06,)),
    ("joint_axis_tilt", ("knee_r",), None, (8.0, 6.0)),
    ("joint_centre_offset", ("hip_r",), None, (25.0, 0.0, 0.0)),
]


def found(recordings: list[Recording]) -> Discovery:
    """Search the person's model for what is missing in recordings."""
    return discover(person().model, recordings)


@pytest.mark.parametrize(("kind", "where", "driver", "numbers"), HIDDEN, ids=[h[0] for h in HIDDEN])
def test_a_hidden_effect_is_named(
    kind: str, where: tuple[str, ...], driver: str | None, numbers: tuple[float, ...]
) -> None:
    candidate, truth = hide(kind, *where, driver=driver, numbers=numbers)
    result = found(recorded(person(), truth))
    (named,) = result.findings.named
    assert result.findings.verdict == "found"
    assert named.effect.candidate.name == candidate.name
    for (column, size), spread, number in zip(
        named.effect.columns, np.sqrt(np.diag(named.covariance)), numbers, strict=True
    ):
        value, sd = column.neutral + column.unit * size, column.unit * spread
        assert abs(value - number) < max(4.0 * sd, 0.02 * abs(number) + 0.1 * abs(column.neutral == 0.0))
    whitened = result.findings.held_out.levels["whitened"]
    assert whitened.before - whitened.after > 0.9 * (whitened.before - 1.0)
    before, after = (
        sum(i.square for i in a.tracked if i.role == "held_out") for a in (result.before, result.after)
    )
    assert after < before


def test_nothing_is_named_where_nothing_is() -> None:
    shares: list[float] = []
    recordings = recorded(person(), person().model, seed=3)
    result = discover(person().model, recordings, progress=lambda _, share: shares.append(share))
    assert shares == sorted(shares)
    assert len(set(shares)) > 5  # it moves within a round
    assert not result.findings.named
    assert result.findings.verdict == "nothing"


@pytest.mark.parametrize(
    ("at", "axis", "rms_deg"), [("before", 0, 6.0), ("after", 1, 6.0)]
)
def test_a_locked_motion_is_found_with_its_axis(at: At, axis: int, rms_deg: float) -> None:
    """Noise alone would turn the shank by some 0.3 degrees, which the RMS told is free of."""
    about = [0.0, 0.0, 0.0]
    about[axis] = 1.0
    hidden = FreeMotion("tibia_r", at, "rotation", (about[0], about[1], about[2]))
    free = Candidate(kind="missing_dof", where=("knee_r",), columns=(), note="extra turn", change=hidden)
    truth = with_effects(person().model, [Estimate(free, np.zeros(0))], "")
    course = np.radians(rms_deg) * np.sqrt(2.0) * np.sin(2.0 * np.pi * 0.7 * np.arange(500) / 100.0)
    (named,) = found(recorded(person(), truth, more=course)).findings.named
    change = named.effect.candidate.change
    assert named.effect.candidate.where == ("knee_r",)
    assert isinstance(change, FreeMotion)
    assert change.at == at
    assert abs(change.axis[axis]) > 0.99
    assert named.details["rms_deg"] == pytest.approx(rms_deg, rel=0.05)
    assert 0.0 < named.spreads["rms_deg"] < 0.05


def test_exchanged_labels_are_put_back() -> None:
    recordings = recorded(person(), person().model)
    trial = recordings[1].trial
    pair = [trial.index("RLFE"), trial.index("RMFE")]
    markers = trial.markers.copy()
    markers[50:120, pair] = markers[50:120, pair[::-1]]
    recordings[1] = Recording(trial.with_markers(markers), "fit")
    (named,) = found(recordings).findings.named
    assert named.effect.candidate.change == Exchange("RLFE", "RMFE", 0.5, 1.19)
    assert named.effect.candidate.trials == ("gait_1",)


def test_a_scaled_volume_is_measured() -> None:
    recordings = [
        Recording(r.trial.with_markers(r.trial.markers * 1.03), r.role)
        for r in recorded(person(), person().model)
    ]
    (named,) = found(recordings).findings.named
    assert named.effect.candidate.kind == "capture_scale"
    assert 1.0 + named.effect.size[0] == pytest.approx(1.03, abs=2e-4)


def test_without_a_held_out_trial_blocks_of_time_decide() -> None:
    _, truth = hide("segment_length", "tibia_r", numbers=(1.06,))
    fitting = [Recording(r.trial, "fit") for r in recorded(person(), truth)]
    result = found(fitting)
    assert [n.effect.candidate.kind for n in result.findings.named] == ["segment_length"]
    assert result.findings.folds
    assert any("held out" in note for note in result.findings.notes)


def test_gaps_and_a_marker_never_seen_do_no_harm() -> None:
    recordings = recorded(person(), person().model)
    holed = []
    for r in recordings:
        markers = r.trial.markers.copy()
        markers[20:60, 3] = np.nan
        markers[:, 5] = np.nan
        holed.append(
            Recording(
                Trial(
                    name=r.trial.name,
                    times=r.trial.times,
                    labels=r.trial.labels,
                    markers=markers,
                    rate_hz=100.0,
                ),
                r.role,
            )
        )
    assert found(holed).findings.verdict == "nothing"
