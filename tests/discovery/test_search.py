"""What is hidden in a virtual person is found by name, place and size; where nothing is, nothing is named."""

from __future__ import annotations

import re

import numpy as np
import pytest

from scaling_service.capabilities.discovery.evidence.fit import SearchTrial
from scaling_service.capabilities.discovery.laws.candidates import Exchange
from scaling_service.capabilities.discovery.ordinary.sums import FRAMES
from scaling_service.capabilities.discovery.search.discover import Discovery, discover
from scaling_service.model.trial import Trial
from tests.discovery.hidden import NOISE_M, hide, person, recorded

HIDDEN = [
    ("marker_offset", ("RFH",), None, (15.0, 0.0, 15.0)),
    ("soft_tissue_artefact", ("RLFE",), "knee_angle_r", (0.4, 0.4, 0.0)),
    ("segment_length", ("tibia_r",), None, (1.1,)),
    ("joint_axis_tilt", ("knee_r",), None, (8.0, 6.0)),
    ("joint_centre_offset", ("hip_r",), None, (25.0, 0.0, 0.0)),
]
SEARCHED_ELSEWHERE = ("marker_offset", "soft_tissue_artefact")
"""In any case, by test_scopes.py and tests/blind."""


def found(recordings: list[SearchTrial]) -> Discovery:
    """Search the person's model for what is missing in recordings."""
    return discover(person().model, recordings)


@pytest.mark.parametrize(
    ("kind", "where", "driver", "numbers"),
    [
        pytest.param(*one, id=one[0], marks=[pytest.mark.costly] if one[0] in SEARCHED_ELSEWHERE else [])
        for one in HIDDEN
    ],
)
def test_a_hidden_effect_is_named(
    kind: str, where: tuple[str, ...], driver: str | None, numbers: tuple[float, ...]
) -> None:
    candidate, truth = hide(kind, *where, driver=driver, numbers=numbers)
    result = found(recorded(person(), truth))
    (named,) = result.named
    assert result.verdict == "found"
    assert named.effect.candidate.name == candidate.name
    for (column, size), spread, number in zip(
        named.effect.columns, np.sqrt(np.diag(named.covariance)), numbers, strict=True
    ):
        value, sd = column.neutral + column.unit * size, column.unit * spread
        assert abs(value - number) < max(4.0 * sd, 0.02 * abs(number) + 0.1 * abs(column.neutral == 0.0))
    gap = result.held_out
    assert gap.whitened is not None
    assert gap.markers_mm is not None
    assert (gap.whitened.after or 0.0) < (gap.whitened.before or 0.0)
    assert (gap.markers_mm.after or 0.0) < 1.5e3 * NOISE_M  # what the cameras' noise leaves
    before, after = (
        sum(np.nansum(np.square(i.residuals)) for i in a.tracked if i.role == "held_out")
        for a in (result.before, result.after)
    )
    assert after < before


def test_what_is_too_small_to_be_named_is_estimated() -> None:
    _, truth = hide("joint_centre_offset", "hip_r", numbers=(3.0, 0.0, 0.0))
    result = found(recorded(person(), truth))
    assert not result.named
    where = ("joint_centre_offset", ("hip_r",))
    ((_, size, covariance, _),) = (x for x in result.leanings.each() if (x[0].kind, x[0].where) == where)
    sds = np.sqrt(np.diag(covariance))
    assert (sds < 0.002).all()
    assert (np.abs(size - [0.003, 0.0, 0.0]) < 2.0 * sds).all()


def test_nothing_is_named_where_nothing_is() -> None:
    shares: list[float] = []
    recordings = recorded(person(), person().model, seed=3)
    result = discover(person().model, recordings, progress=lambda _, share: shares.append(share))
    assert shares == sorted(shares)
    assert len(set(shares)) > 3
    assert not result.named
    assert result.verdict == "nothing"


def test_exchanged_labels_are_put_back() -> None:
    recordings = recorded(person(), person().model)
    trial = recordings[1].trial
    pair = [trial.index("RLFE"), trial.index("RMFE")]
    markers = trial.markers.copy()
    markers[50:120, pair] = markers[50:120, pair[::-1]]
    recordings[1] = SearchTrial(trial.with_markers(markers), "fit")
    (named,) = found(recordings).named
    assert named.effect.candidate.change == Exchange("RLFE", "RMFE", 0.5, 1.19)
    assert named.effect.candidate.trials == ("gait_1",)


def test_what_is_wrong_with_a_recording_stands_before_what_is_likelier() -> None:
    _, truth = hide("segment_length", "tibia_r", numbers=(1.15,))
    recordings = recorded(person(), truth)
    trial = recordings[0].trial
    markers = trial.markers.copy()
    markers[:, trial.index("LFH"), 1] += 0.02
    recordings[0] = SearchTrial(trial.with_markers(markers), "fit")
    first, second = found(recordings).named
    assert (first.candidate.kind, first.candidate.where) == ("marker_offset", ("LFH",))
    assert second.candidate.kind == "segment_length"
    assert (second.odds, second.gain) > (first.odds, first.gain)


def test_a_marker_that_goes_astray_is_unexplained_where_it_is() -> None:
    recordings = recorded(person(), person().model)
    stream, strayed = np.random.default_rng(2), []
    for r in recordings:
        markers = r.trial.markers.copy()
        markers[:, r.trial.index("RFH")] += 0.03 * stream.normal(size=(len(markers), 3))
        strayed.append(SearchTrial(r.trial.with_markers(markers), r.role))
    findings = found(strayed)
    assert not findings.named
    assert findings.verdict == "unexplained"
    assert [u.where for u in findings.unexplained] == [["RFH"]]


@pytest.mark.parametrize(
    "slow", [pytest.param(False, id="jumps"), pytest.param(True, id="creeps", marks=pytest.mark.costly)]
)
def test_a_marker_that_is_stuck_on_elsewhere_half_way_is_said_to_jump(slow: bool) -> None:
    """When, and how far; one that creeps as far does not."""
    recordings = recorded(person(), person().model)
    trial = recordings[1].trial
    course = np.linspace(0.0, 1.0, len(trial.times))
    markers = trial.markers.copy()
    markers[:, trial.index("LASIS"), 1] += 0.03 * (course if slow else course > 0.6)
    recordings[1] = SearchTrial(trial.with_markers(markers), "fit")
    findings = found(recordings)
    said = [u.law for u in findings.unexplained if u.where == ["LASIS"] and "jumps" in u.law]
    assert bool(said) != slow
    if said:
        size, at = map(float, re.findall(r"by (\d+) mm at ([\d.]+) s", said[0])[0])
        assert size == pytest.approx(30.0, abs=2.0)
        assert at == pytest.approx(0.6 * trial.times[-1], abs=trial.times[-1] / FRAMES)


def test_a_scaled_volume_is_measured() -> None:
    recordings = [
        SearchTrial(r.trial.with_markers(r.trial.markers * 1.05), r.role)
        for r in recorded(person(), person().model)
    ]
    (named,) = found(recordings).named
    assert named.effect.candidate.kind == "capture_scale"
    assert 1.0 + named.effect.size[0] == pytest.approx(1.05, abs=2e-3)


def test_without_a_held_out_trial_all_are_told_to_fit() -> None:
    _, truth = hide("segment_length", "tibia_r", numbers=(1.1,))
    fitting = [SearchTrial(r.trial, "fit") for r in recorded(person(), truth)]
    result = found(fitting)
    assert [n.effect.candidate.kind for n in result.named] == ["segment_length"]
    assert result.held_out is result.fit
    assert any("held out" in note for note in result.notes)


def test_gaps_and_a_marker_never_seen_do_no_harm() -> None:
    recordings = recorded(person(), person().model)
    holed = []
    for r in recordings:
        markers = r.trial.markers.copy()
        markers[20:60, 3] = np.nan
        markers[:, 5] = np.nan
        holed.append(
            SearchTrial(
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
    assert found(holed).verdict == "nothing"
