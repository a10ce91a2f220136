"""A model made by hand, with the kinds of chain of a built-in model."""

from __future__ import annotations

from scaling_service.model.body import BodyModel, Coordinate, Joint, Law, Marker, Segment, Shape, Term

X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def hand_made() -> BodyModel:
    """The kinds of chain of a built-in model."""
    bend = Shape((-0.5, 0.5, 2.0), ((0.1, 0.0), (0.3, 0.1)))
    arch = Shape((-0.5, 2.0), ((0.02, -0.01, 0.3),))
    pelvis = (
        *(Joint("translation", a, Law.of(f"pelvis_t{n}")) for n, a in zip("xyz", (X, Y, Z), strict=True)),
        Joint("rotation", Z, Law.of("tilt")),
        Joint("rotation", X, Law.of("list")),
        Joint("rotation", Y, Law.of("rotation", 1.0, 0.1)),
    )
    hip = (
        Joint("translation", X, Law.constant(-0.07), "pelvis"),
        Joint("translation", Z, Law.constant(0.08), "pelvis"),
        Joint("rotation", (0.6, 0.0, 0.8), Law.constant(0.3)),
        Joint("rotation", Z, Law.of("flexion")),
        Joint("rotation", X, Law.of("adduction")),
    )
    knee = (
        Joint("translation", Y, Law.constant(-0.4), "femur_r"),
        Joint("translation", X, Law((Term(0.05, coordinate="knee", shape=bend),)), "femur_r"),
        Joint("translation", Y, Law.constant(0.01), "femur_r"),
        Joint("translation", Y, Law((Term(0.05, coordinate="knee", shape=arch), Term(0.01))), "femur_r"),
        Joint("rotation", Y, Law.constant(0.05)),
        Joint("rotation", X, Law.constant(-0.03)),
        Joint("rotation", Z, Law.of("knee", -1.0)),
        Joint("rotation", X, Law.constant(0.03)),
        Joint("rotation", Y, Law.constant(-0.05)),
        Joint("rotation", X, Law.constant(0.02)),
        Joint("translation", Y, Law.constant(-0.02), "tibia_r"),
    )
    patella = (Joint("rotation", Z, Law.of("knee", 0.5)), Joint("rotation", Z, Law.of("knee", 0.1)))
    weld = (Joint("translation", Y, Law.constant(-0.4), "tibia_r"), Joint("rotation", X, Law.constant(0.2)))
    inertia = (0.1, 0.05, 0.12, 0.001, 0.002, -0.001)
    segments = (
        Segment(
            name="pelvis",
            parent="ground",
            joint_name="root",
            joints=pelvis,
            mass=10.0,
            com=(0.0, 0.01, 0.0),
            inertia=inertia,
        ),
        Segment(
            name="femur_r",
            parent="pelvis",
            joint_name="hip_r",
            joints=hip,
            mass=8.0,
            com=(0.0, -0.2, 0.0),
            inertia=inertia,
        ),
        Segment(
            name="tibia_r",
            parent="femur_r",
            joint_name="knee_r",
            joints=knee,
            mass=3.0,
            com=(0.0, -0.2, 0.0),
            inertia=inertia,
        ),
        Segment(
            name="patella_r",
            parent="femur_r",
            joint_name="patella_r",
            joints=patella,
            mass=0.1,
            inertia=(0.001, 0.001, 0.001, 0.0, 0.0, 0.0),
        ),
        Segment(name="foot_r", parent="tibia_r", joint_name="weld_r", joints=weld),
    )
    names = ("pelvis_tx", "pelvis_ty", "pelvis_tz", "tilt", "list", "rotation", "flexion", "adduction")
    coordinates = (
        *(
            Coordinate(
                name=n, kind="translation" if "_t" in n else "rotation", default=0.1, lower=-1.0, upper=1.0
            )
            for n in names
        ),
        Coordinate(name="knee", default=0.2, lower=-0.4, upper=1.9, clamped=True),
    )
    markers = tuple(Marker.at(f"m_{s.name}", s.name, (0.1, 0.05, 0.02)) for s in segments)
    return BodyModel(name="hand made", segments=segments, coordinates=coordinates, markers=markers)
