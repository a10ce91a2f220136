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
        Segment("pelvis", "ground", "root", pelvis, 10.0, (0.0, 0.01, 0.0), inertia),
        Segment("femur_r", "pelvis", "hip_r", hip, 8.0, (0.0, -0.2, 0.0), inertia),
        Segment("tibia_r", "femur_r", "knee_r", knee, 3.0, (0.0, -0.2, 0.0), inertia),
        Segment(
            "patella_r", "femur_r", "patella_r", patella, 0.1, inertia=(0.001, 0.001, 0.001, 0.0, 0.0, 0.0)
        ),
        Segment("foot_r", "tibia_r", "weld_r", weld),
    )
    names = ("pelvis_tx", "pelvis_ty", "pelvis_tz", "tilt", "list", "rotation", "flexion", "adduction")
    coordinates = (
        *(Coordinate(n, "translation" if "_t" in n else "rotation", 0.1, -1.0, 1.0) for n in names),
        Coordinate("knee", default=0.2, lower=-0.4, upper=1.9, clamped=True),
    )
    markers = tuple(Marker.at(f"m_{s.name}", s.name, (0.1, 0.05, 0.02)) for s in segments)
    return BodyModel("hand made", segments, coordinates, markers)
