"""Whose marker is it: labels told by place and movement alone, on virtual persons and real recordings."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scaling_service.files.recording import read_recording
from scaling_service.model.anatomy.markers import find_canonical, is_computed, strip_prefix
from scaling_service.model.trial import Trial
from scaling_service.recording.identity.body import propose_standing_bodies
from scaling_service.recording.identity.identify import Identification, identify
from scaling_service.recording.identity.landmarks import list_landmarks
from scaling_service.recording.orientation import apply, decide
from scaling_service.studies.benchmark.persons import RATE_HZ, Person, draw_person

CORE = {side + name for side in "RL" for name in ("ASIS", "PSIS", "LFE", "MFE", "LM", "MM")}


def record(person: Person, name: str, labels: dict[str, str], *, turn_deg: float = 0.0) -> Trial:
    times, markers = person.trials[name]
    turn = Rotation.from_euler("Y", turn_deg, degrees=True).as_matrix()
    at = np.stack([markers[old] for old in labels], axis=1) @ turn.T + [1.0, 0.0, -2.0]
    return Trial(name=name, times=times, labels=tuple(labels.values()), markers=at, rate_hz=RATE_HZ)


def hide(person: Person, seed: int) -> dict[str, str]:
    """The true names to numbers, in random order."""
    order = np.random.default_rng(seed).permutation(list(person.places))
    return {str(name): f"M{k:02d}" for k, name in enumerate(order)}


def look(person: Person, labels: dict[str, str], turn_deg: float = 0.0) -> Identification:
    moving = [record(person, name, labels, turn_deg=turn_deg) for name in ("functional_r", "functional_l")]
    static = record(person, "static", labels, turn_deg=turn_deg)
    return identify(static, moving, stature=person.height)


def test_virtual_persons_without_names():
    """Legs without feet, markers in random order and turned at random: landmarks and segments by geometry."""
    told = right = core = landmarks = sure = mistaken = 0
    for seed in range(3):
        person = draw_person(seed)
        labels = hide(person, seed)
        found = look(person, labels, turn_deg=67.0 * seed)
        for old, new in labels.items():
            one = found.labels[new]
            told += 1
            right += one.segment == person.segments[old]
            sure += one.confidence > 0.9
            mistaken += one.confidence > 0.9 and one.segment != person.segments[old]
            core += old in CORE
            landmarks += old in CORE and one.landmark == old
    assert right >= 0.95 * told, (right, told)
    assert mistaken <= 0.03 * sure, (mistaken, sure)
    assert landmarks >= 0.9 * core, (landmarks, core)


def test_order_does_not_matter():
    person = draw_person(1)
    first, second = (look(person, hide(person, seed)) for seed in (1, 2))
    names = (hide(person, seed) for seed in (1, 2))
    one, two = (
        {old: found.labels[new].landmark for old, new in labels.items()}
        for found, labels in zip((first, second), names, strict=True)
    )
    assert one == two


def test_a_name_that_is_given_is_kept():
    person = draw_person(2)
    labels = hide(person, 2)
    static = record(person, "static", labels)
    found = identify(static, [], landmarks={labels["RTH1"]: "RLFE"})
    assert found.labels[labels["RTH1"]].landmark == "RLFE"
    assert found.labels[labels["RLFE"]].landmark != "RLFE"


def test_without_a_standing_trial_nothing_is_told():
    person = draw_person(3)
    assert identify(None, [record(person, "walk", hide(person, 3))]).labels == {}


def test_too_few_points_are_no_body():
    assert propose_standing_bodies(np.zeros((3, 3))) == []


RUNNER = {
    "Thigh": "femur",
    "Shank": "tibia",
    "Knee": "femur",
    "Ankle": "tibia",
    "Heel": "calcn",
    "MT": "calcn",
}


@pytest.mark.parametrize(
    "who", ["RBDS001", *(pytest.param(f"RBDS{k}", marks=pytest.mark.costly) for k in ("002", "010", "011"))]
)
def test_runners_clusters_without_names(shared_data, who):
    """Anatomical markers in the standing trial only; the clusters' names are the truth, not looked at."""
    folder = shared_data / "runners" / who
    static, run = (read_recording(folder / name).trial for name in ("static.c3d", "runT35.c3d"))
    static, run = (apply(decide(trial), trial) for trial in (static, run))
    labels = {label: f"M{k:02d}" for k, label in enumerate(static.labels)}
    found = identify(static.relabel(labels), [run.relabel(labels)])
    for label, number in labels.items():
        side, _, word = label.partition(".")
        segment = next((s for part, s in RUNNER.items() if word.startswith(part)), None)
        if segment is not None:
            assert found.labels[number].segment == f"{segment}_{side.lower()}", label


@pytest.mark.parametrize("number", [1, pytest.param(None, marks=pytest.mark.costly, id="all")])
@pytest.mark.parametrize("hidden", [(), ("MMA", "LCA", "PCA", "STL")], ids=["whole", "without inner ankles"])
def test_children_of_a_clinic_without_names(shared_data, number, hidden):
    """The whole body with feet of fourteen markers; truth: the laboratory's names.

    Neither is a landmark another label's, nor is it made of a label that is none, such as a navicular.
    """
    wrong = []
    count = 0
    for folder in sorted((shared_data / "clinic").iterdir())[:number]:
        first, second, *_ = sorted(folder.glob("*.c3d"))
        static, walk = (read_recording(file).trial for file in (first, second))
        static, walk = (apply(decide(trial), trial) for trial in (static, walk))
        kept = [
            label
            for label in static.labels
            if not is_computed(strip_prefix(label)) and not strip_prefix(label).endswith(hidden)
        ]
        labels = {label: f"M{k:02d}" for k, label in enumerate(kept)}
        found = identify(
            static.select(kept).relabel(labels),
            [walk.select([label for label in kept if label in walk.labels]).relabel(labels)],
        )
        for label in kept:
            name = find_canonical(strip_prefix(label))
            got = found.labels[labels[label]].landmark
            if {name, got} & CORE:
                count += 1
                wrong += [] if got == name else [(folder.name, label, got)]
    assert {"RASIS", "RLFE", "LLM"} <= set(list_landmarks())
    assert len(wrong) <= 0.05 * count, wrong
