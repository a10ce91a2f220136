"""The marker sets that come with the product: every file is held to the same rules."""

from __future__ import annotations

from importlib.resources.abc import Traversable

import pytest

from scaling_service.model.anatomy.markers import find_canonical, is_computed, make_plain_key
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import load_builtin
from scaling_service.model.marker_sets import MarkerSet, list_landmarks, list_marker_sets
from scaling_service.model.reference import list_marker_set_files, read_reference

SETS = list(list_marker_sets().values())
OF_SKIN = [s for s in SETS if not s.key_points]
KEYS = {
    "title", "source", "extends", "sided", "midline", "one_of", "adds_to_others", "key_points",
}  # fmt: skip
LABEL_KEYS = {"landmark", "segment", "aliases", "wand", "plane_of", "static_only", "optional"}


@pytest.fixture(scope="module")
def whole_body() -> BodyModel:
    return load_builtin("full_body_35dof")


@pytest.mark.parametrize(
    ("name", "file"), list(list_marker_set_files()), ids=lambda v: v if isinstance(v, str) else ""
)
def test_a_file_holds_what_is_read_and_says_where_it_is_from(name: str, file: Traversable) -> None:
    content = read_reference(file)
    assert set(content) <= KEYS
    assert len(content["title"]) > 5
    assert len(content["source"]) > 30
    for label, entry in {**content.get("sided", {}), **content.get("midline", {})}.items():
        assert set(entry) <= LABEL_KEYS, label
        assert ("landmark" in entry) != ("segment" in entry), f"{label}: a landmark knows its segment"
        assert entry.get("plane_of") in (None, "knee", "ankle")
    assert all(label[0] in "Rr" for label in content.get("sided", {}))


@pytest.mark.parametrize("marker_set", SETS, ids=lambda s: s.name)
def test_both_sides_say_the_same(marker_set: MarkerSet) -> None:
    reported = {label.label: label for label in marker_set.labels}
    assert len(reported) == len(marker_set.labels), "a label stands twice"
    for label in marker_set.labels:
        if label.side != "r":
            continue
        left = reported[f"L{label.label[1:]}"]
        assert (left.side, left.segment, left.wand, left.plane_of) == (
            "l",
            label.segment,
            label.wand,
            label.plane_of,
        )
        assert left.landmark == (label.landmark and f"L{label.landmark[1:]}")
        assert left.aliases == tuple(f"L{alias[1:]}" for alias in label.aliases)
    assert {name for choice in marker_set.one_of for group in choice for name in group} <= set(reported)


@pytest.mark.parametrize("marker_set", SETS, ids=lambda s: s.name)
def test_landmarks_and_segments_are_those_of_the_models(marker_set: MarkerSet, whole_body: BodyModel) -> None:
    plain = {name.removesuffix("_r").removesuffix("_l") for name in whole_body.segment_names}
    for label in marker_set.labels:
        assert label.landmark is None or label.landmark in list_landmarks()
        assert label.segment in plain | {"toes"}, "toes are OpenSim's segment; no built-in model has them"


def test_no_name_means_two_places() -> None:
    meant: dict[str, tuple[str | None, str, str]] = {}
    for marker_set in OF_SKIN:
        for label in marker_set.labels:
            for name in label.names:
                reported = (label.landmark, label.segment, label.side)
                assert meant.setdefault(make_plain_key(name), reported) == reported, (
                    f"{name} of {marker_set.name}"
                )
    for landmark in list_landmarks().values():
        for name in (landmark.name, *landmark.aliases):
            reported = (landmark.name, landmark.segment, landmark.side)
            assert meant.setdefault(make_plain_key(name), reported) == reported, name


def test_aliases_of_landmarks_belong_to_no_set() -> None:
    of_sets = {make_plain_key(name) for s in OF_SKIN for label in s.labels for name in label.names}
    twice = {a for mark in list_landmarks().values() for a in mark.aliases if make_plain_key(a) in of_sets}
    assert not {a for a in twice if a[0] == "R"}, "what a set says need not be said again"


def test_every_landmark_is_canonical_and_no_marker_reads_as_computed() -> None:
    for name in list_landmarks():
        assert find_canonical(name) == name
    for marker_set in OF_SKIN:
        for label in marker_set.labels:
            assert find_canonical(label.label) == label.landmark
            assert not any(map(is_computed, label.names)), label


def test_a_landmark_is_on_the_segment_where_the_models_have_it(whole_body: BodyModel) -> None:
    for marker in whole_body.markers:
        known = list_landmarks().get(marker.name)
        if known is not None:
            midline = known.segment in ("pelvis", "torso", "head")
            assert marker.segment == (known.segment if midline else f"{known.segment}_{known.side}")
