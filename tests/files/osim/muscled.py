"""A thigh and a shank with a muscle over each kind of surface and each kind of path point, for OpenSim."""

from __future__ import annotations

BODY = """<Body name="{name}"><mass>{mass}</mass><mass_center>0 -0.2 0</mass_center>
<inertia>0.1 0.01 0.1 0 0 0</inertia>
<WrapObjectSet name="wrapobjectset"><objects>{wraps}</objects></WrapObjectSet></Body>"""

JOINT = """<PinJoint name="{name}"><socket_parent_frame>a</socket_parent_frame>
<socket_child_frame>b</socket_child_frame>
<coordinates><Coordinate name="{coordinate}"><range>{range}</range><clamped>true</clamped></Coordinate>
</coordinates><frames>
<PhysicalOffsetFrame name="a"><socket_parent>{parent}</socket_parent><translation>{at}</translation>
</PhysicalOffsetFrame>
<PhysicalOffsetFrame name="b"><socket_parent>/bodyset/{child}</socket_parent></PhysicalOffsetFrame>
</frames></PinJoint>"""

WRAPS = {
    "cylinder": ("0.0 -0.4 0", "0 0 0", "<radius>0.03</radius><length>0.2</length>", "x"),
    "sphere": ("0.005 -0.41 0", "0 0 0", "<radius>0.035</radius>", "all"),
    "ellipsoid": ("0.0 -0.4 0", "0 0 0", "<dimensions>0.035 0.035 0.06</dimensions>", "x"),
    "torus": (
        "0.035 -0.38 0",
        "1.5707963 0 0",
        "<inner_radius>0.012</inner_radius><outer_radius>0.03</outer_radius>",
        "all",
    ),
}

POINT = """<{kind} name="{name}"><socket_parent_frame>/bodyset/{body}</socket_parent_frame>
<location>{at}</location>{more}</{kind}>"""

SPLINE = """<{axis}_location><SimmSpline><x>-1.2 -0.9 -0.6 -0.3 0.1</x><y>{values}</y></SimmSpline>
</{axis}_location>
<socket_{axis}_coordinate>/jointset/knee/bend</socket_{axis}_coordinate>"""

MUSCLE = """<{kind} name="{name}"><GeometryPath name="path">
<PathPointSet><objects>{points}</objects></PathPointSet>
<PathWrapSet><objects>{wraps}</objects></PathWrapSet></GeometryPath>
<max_isometric_force>800</max_isometric_force><optimal_fiber_length>0.1</optimal_fiber_length>
<tendon_slack_length>0.14</tendon_slack_length>
<pennation_angle_at_optimal>0.2</pennation_angle_at_optimal></{kind}>"""


def make_muscled() -> str:
    """The model's text: muscles named like their surfaces, ``fixed``, ``conditional`` and ``moving``."""
    wraps = "".join(
        f'<Wrap{kind.title()} name="{kind}_surface"><translation>{at}</translation>'
        f"<xyz_body_rotation>{turn}</xyz_body_rotation><quadrant>{side}</quadrant>{sizes}</Wrap{kind.title()}>"
        for kind, (at, turn, sizes, side) in WRAPS.items()
    )
    top, low = (
        _write_point("top", "thigh", "0.035 -0.25 0.005"),
        _write_point("low", "shank", "0.035 -0.08 -0.005"),
    )
    muscles = [_write_muscle(kind, top + low, f"{kind}_surface") for kind in WRAPS]
    limits = "<socket_coordinate>/jointset/knee/bend</socket_coordinate><range>-2.2 -0.6</range>"
    via = _write_point("via", "thigh", "0.045 -0.4 0", "ConditionalPathPoint", limits)
    gliding = "".join(
        SPLINE.format(axis=axis, values=values)
        for axis, values in {
            "x": "0.03 0.045 0.05 0.045 0.04",
            "y": "-0.02 -0.015 0.0 0.015 0.03",
            "z": "0 0 0 0 0",
        }.items()
    )
    glider = _write_point("glider", "shank", "0 0 0", "MovingPathPoint", gliding)
    muscles += [
        _write_muscle("fixed", top + low),
        _write_muscle("conditional", top + via + low),
        _write_muscle("moving", top + glider, kind="Thelen2003Muscle"),
    ]
    joints = JOINT.format(
        name="hip", coordinate="swing", range="-1 1", parent="/ground", child="thigh", at="0 1 0"
    ) + JOINT.format(
        name="knee",
        coordinate="bend",
        range="-1.2 0.1",
        parent="/bodyset/thigh",
        child="shank",
        at="0 -0.4 0",
    )
    bodies = BODY.format(name="thigh", mass=8, wraps=wraps) + BODY.format(name="shank", mass=3, wraps="")
    return (
        '<?xml version="1.0" encoding="UTF-8"?><OpenSimDocument Version="40000"><Model name="leg">'
        f'<BodySet name="bodyset"><objects>{bodies}</objects></BodySet>'
        f'<JointSet name="jointset"><objects>{joints}</objects></JointSet>'
        f'<ForceSet name="forceset"><objects>{"".join(muscles)}</objects></ForceSet>'
        "</Model></OpenSimDocument>"
    )


def _write_point(name: str, body: str, at: str, kind: str = "PathPoint", more: str = "") -> str:
    return POINT.format(name=name, body=body, at=at, kind=kind, more=more)


def _write_muscle(name: str, points: str, wrap: str = "", kind: str = "Millard2012EquilibriumMuscle") -> str:
    wraps = f'<PathWrap name="wrap"><wrap_object>{wrap}</wrap_object></PathWrap>' if wrap else ""
    return MUSCLE.format(name=name, points=points, wraps=wraps, kind=kind)
