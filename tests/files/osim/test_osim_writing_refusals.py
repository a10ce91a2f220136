"""What OpenSim's format cannot hold is refused by name, and the old file stays."""

from __future__ import annotations

from dataclasses import replace

import pytest

from scaling_service.core.errors import InputError, ModelRefused
from scaling_service.files.osim.models import read_osim, write_osim
from scaling_service.model.body import BodyModel, Coordinate, Joint, Law, Marker, Segment, Shape, Term
from tests.files.osim.hand_made import X, Y, Z, hand_made


@pytest.mark.parametrize(
    "joints",
    [
        (
            Joint("rotation", Z, Law.of("a")),
            Joint("translation", X, Law.of("b")),
            Joint("rotation", X, Law.of("c")),
        ),
        (
            Joint("rotation", Z, Law.of("a")),
            Joint("rotation", X, Law.of("b")),
            Joint("rotation", Z, Law.of("c")),
        ),
        (Joint("rotation", Z, Law.of("a") + Law.of("b")),),
        tuple(Joint("rotation", axis, Law.of(n)) for axis, n in zip((X, Y, Z, X), "abcd", strict=True)),
        # a cubic without zero curvature at its ends is no SimmSpline
        (
            Joint(
                "rotation",
                Z,
                Law(
                    (
                        Term(
                            1.0,
                            coordinate="a",
                            shape=Shape((-1.0, 0.0, 1.0), ((1.0, 0, 0, 0), (0.2, 0, 3.0, 1.0))),
                        ),
                    )
                ),
            ),
        ),
    ],
)
def test_chains_that_do_not_fit_are_refused(oracle, tmp_path, joints):
    coordinates = tuple(Coordinate(name=n, lower=-1.0, upper=1.0) for n in "abcd")
    model = BodyModel(
        name="odd",
        segments=(Segment(name="s", parent="ground", joint_name="odd_joint", joints=joints, mass=1.0),),
        coordinates=coordinates,
    )
    with pytest.raises(ModelRefused) as caught:
        write_osim(tmp_path / "odd.osim", model)
    assert caught.value.field == "odd_joint"
    assert not list(tmp_path.iterdir())


def test_what_a_source_cannot_hold_is_refused_and_the_old_file_stays(oracle, tmp_path):
    source, path = tmp_path / "source.osim", tmp_path / "written.osim"
    pin = {"kind": "PinJoint", "name": "j", "parent": "ground", "child": "a"}
    oracle({"operation": "build", "file": str(source), "joints": [pin]})
    path.write_text("before")
    model = read_osim(source)
    longer = replace(
        model,
        segments=tuple(
            replace(s, joints=(*s.joints, Joint("translation", X, Law.constant(0.001))))
            for s in model.segments
        ),
    )
    with pytest.raises(ModelRefused, match="mm away") as caught:
        write_osim(path, longer, source=source)
    assert caught.value.field == "j"
    freer = replace(
        model,
        segments=tuple(
            replace(s, joints=(*s.joints, Joint("rotation", X, Law.of("new")))) for s in model.segments
        ),
        coordinates=(*model.coordinates, Coordinate(name="new")),
    )
    with pytest.raises(ModelRefused) as caught:
        write_osim(path, freer, source=source)
    assert caught.value.field == "new"
    wobbling = model.with_markers(
        (replace(model.markers[0], laws=(Law.of(model.coordinate_names[0]), Law(), Law())),)
    )
    with pytest.raises(ModelRefused) as caught:
        write_osim(path, wobbling, source=source)
    assert caught.value.field == model.marker_names[0]
    with pytest.raises(ModelRefused) as caught:
        write_osim(path, model, source=source, factors={"nobody": (1.0, 1.0, 1.0)})
    assert caught.value.field == "nobody"
    assert path.read_text() == "before"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["source.osim", "written.osim"]


def test_names_that_opensim_refuses_are_named(tmp_path):
    model = hand_made()
    spaced = model.with_markers((Marker.at("R ASI", "pelvis", (0.0, 0.0, 0.0)),))
    with pytest.raises(ModelRefused) as caught:
        write_osim(tmp_path / "a.osim", spaced)
    assert caught.value.field == "R ASI"


def test_a_folder_that_does_not_exist(oracle, tmp_path):
    with pytest.raises(InputError) as caught:
        write_osim(tmp_path / "none" / "a.osim", hand_made())
    assert caught.value.file == str(tmp_path / "none" / "a.osim")
