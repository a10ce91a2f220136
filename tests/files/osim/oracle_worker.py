"""OpenSim's own answers for the tests, in a process of its own: JSON on standard input and output."""

from __future__ import annotations

import re
from pathlib import Path

import opensim as osim

from tests.peers.worker import serve

AXES = ("x", "y", "z")


def load(request):
    model = osim.Model(request["file"])
    if request.get("marker_set"):
        model.updateMarkerSet(osim.MarkerSet(request["marker_set"]))
    return model, model.initSystem()


def positions(request):
    """Marker positions (poses, markers, 3) in ground; dependent coordinates follow their couplers."""
    model, state = load(request)
    return located(model, state, request)


def located(model, state, request):
    coordinates = model.getCoordinateSet()
    for k in range(coordinates.getSize()):
        coordinates.get(k).setLocked(state, False)
        coordinates.get(k).setClamped(state, False)
    couplers = [
        osim.CoordinateCouplerConstraint.safeDownCast(model.getConstraintSet().get(k))
        for k in range(model.getConstraintSet().getSize())
        if model.getConstraintSet().get(k).get_isEnforced()
    ]
    markers = [model.getMarkerSet().get(name) for name in request["markers"]]
    result = []
    for pose in request["poses"]:
        values = dict(zip(request["coordinates"], pose, strict=True))
        for _ in couplers:  # as often as there are couplers, for those that follow each other
            for c in couplers:
                name = c.getIndependentCoordinateNames().get(0)
                if name in values:
                    factor = osim.PropertyHelper.getValueDouble(c.getPropertyByName("scale_factor"))
                    value = c.getFunction().calcValue(osim.Vector(1, values[name]))
                    values[c.getDependentCoordinateName()] = factor * value
        for name, value in values.items():
            coordinates.get(name).setValue(state, value, False)
        model.realizePosition(state)
        result.append([[m.getLocationInGround(state).get(i) for i in range(3)] for m in markers])
    return {"positions": result}


def listed(names):
    """One name, or several, as OpenSim's array."""
    found = osim.ArrayStr()
    for name in [names] if isinstance(names, str) else names:
        found.append(name)
    return found


def missed(request):
    """By how much the constraints are missed at some poses, (poses, equations)."""
    model, state = load(request)
    coordinates, result = model.getCoordinateSet(), []
    for k in range(coordinates.getSize()):
        coordinates.get(k).setLocked(state, False)
        coordinates.get(k).setClamped(state, False)
    for pose in request["poses"]:
        for name, value in zip(request["coordinates"], pose, strict=True):
            coordinates.get(name).setValue(state, value, False)
        model.realizePosition(state)
        errors = state.getQErr()
        result.append([errors.get(k) for k in range(errors.size())])
    return {"missed": result}


def scaled(request):
    """Positions, masses, centres and inertia after OpenSim's Model.scale."""
    model, state = load(request)
    factors = osim.ScaleSet()
    for segment, xyz in request["factors"].items():
        scale = osim.Scale()
        scale.setSegmentName(segment)
        scale.setScaleFactors(osim.Vec3(*xyz))
        scale.setApply(True)
        factors.cloneAndAppend(scale)
    model.scale(state, factors, request["preserve"], request["mass_kg"] or -1.0)
    state = model.initSystem()
    bodies = {}
    for k in range(model.getBodySet().getSize()):
        body = model.getBodySet().get(k)
        bodies[body.getName()] = {
            "mass": body.get_mass(),
            "com": [body.get_mass_center().get(i) for i in range(3)],
            "inertia": [body.get_inertia().get(i) for i in range(6)],
        }
    return {**located(model, state, request), "bodies": bodies}


def joint(kind, name, parent, child):
    frames = (
        parent,
        osim.Vec3(0.1, -0.2, 0.05),
        osim.Vec3(0.3, -0.2, 0.5),
        child,
        osim.Vec3(-0.04, 0.15, 0.02),
        osim.Vec3(-0.1, 0.4, 0.25),
    )
    if kind == "EllipsoidJoint":
        return osim.EllipsoidJoint(name, *frames, osim.Vec3(0.1, 0.2, 0.3))
    if kind == "ScapulothoracicJoint":
        radii, origin = osim.Vec3(0.1, 0.2, 0.15), osim.Vec2(0.03, -0.05)
        return osim.ScapulothoracicJoint(name, *frames, radii, origin, 0.4)
    if kind == "ConstantCurvatureJoint":
        return osim.ConstantCurvatureJoint(name, *frames, osim.Vec3(0.1, -0.2, 0.3), 0.25)
    if kind != "CustomJoint":
        return getattr(osim, kind)(name, *frames)
    return osim.CustomJoint(name, *frames, osim.SpatialTransform())


def function(spec):
    kind = spec["kind"]
    if kind == "LinearFunction":
        return osim.LinearFunction(*spec["values"])
    if kind == "Constant":
        return osim.Constant(*spec["values"])
    if kind == "PolynomialFunction":
        values = osim.Vector(len(spec["values"]), 0.0)
        for k, value in enumerate(spec["values"]):
            values.set(k, value)
        return osim.PolynomialFunction(values)
    if kind == "MultiplierFunction":
        inner = function(spec["inner"])
        inner.thisown = False  # the multiplier deletes it
        scaled_function = osim.MultiplierFunction(inner)
        scaled_function.setScale(spec["scale"])
        return scaled_function
    if kind == "Sine":
        return osim.Sine(*spec["values"])
    if kind == "StepFunction":
        return osim.StepFunction(*spec["values"])
    if kind == "MultivariatePolynomialFunction":
        values = osim.Vector(len(spec["values"]), 0.0)
        for k, value in enumerate(spec["values"]):
            values.set(k, value)
        return osim.MultivariatePolynomialFunction(values, spec["dimension"], spec["order"])
    spline = getattr(osim, kind)()
    if "degree" in spec:
        spline.setDegree(spec["degree"])
    for x, y in spec["points"]:
        spline.addPoint(x, y)
    return spline


def close(kind, a, b):
    """A constraint between two bodies."""
    at, to = osim.Vec3(0.03, -0.02, 0.05), osim.Vec3(-0.04, 0.01, 0.02)
    if kind == "WeldConstraint":
        return osim.WeldConstraint("c", a, at, osim.Vec3(0.1, 0.5, -0.3), b, to, osim.Vec3(-0.2, 0.3, 0.6))
    if kind == "PointOnLineConstraint":
        return osim.PointOnLineConstraint(a, osim.Vec3(0.3, 0.9, -0.2), at, b, to)
    more = (0.2,) if kind == "ConstantDistanceConstraint" else ()
    return getattr(osim, kind)(a, at, b, to, *more)


def build(request):
    """Write a model of a list of joints, each a dictionary."""
    model = osim.Model()
    model.setName("synthetic")
    for spec in request["joints"]:
        body = osim.Body(spec["child"], 2.0, osim.Vec3(0.02, -0.1, 0.03), osim.Inertia(0.02, 0.01, 0.03))
        parent = model.getGround()
        if not spec.get("closing"):
            model.addBody(body)
        else:
            body = model.getBodySet().get(spec["child"])
        if spec["parent"] != "ground":
            parent = model.getBodySet().get(spec["parent"])
        first, second = (body, parent) if spec.get("reversed") else (parent, body)
        made = joint(spec["kind"], spec["name"], first, second)
        if spec["kind"] == "CustomJoint":
            transform = made.updSpatialTransform()
            for k, axis in spec["axes"].items():
                target = transform.updTransformAxis(int(k))
                target.setAxis(osim.Vec3(*axis["axis"]))
                if axis.get("coordinate"):
                    target.setCoordinateNames(listed(axis["coordinate"]))
                target.set_function(function(axis["function"]))
        else:
            for k in range(made.numCoordinates()):
                made.upd_coordinates(k).setName(f"{spec['name']}_{k}")
        model.addJoint(made)
        for k in range(3):
            at = osim.Vec3(*(0.1 * (i == k) + 0.01 for i in range(3)))
            if not spec.get("closing"):
                model.addMarker(osim.Marker(f"{spec['child']}_{AXES[k]}", body, at))
    for spec in request.get("couplers", ()):
        coupler = osim.CoordinateCouplerConstraint()
        coupler.setName(spec["name"])
        coupler.setIndependentCoordinateNames(listed(spec["independent"]))
        coupler.setDependentCoordinateName(spec["dependent"])
        coupler.setFunction(function(spec["function"]))
        model.addConstraint(coupler)
    for kind, *ends in request.get("closing", ()):
        a, b = (model.getGround() if n == "ground" else model.getBodySet().get(n) for n in ends)
        made = close(kind, a, b)
        made.setName("closing")
        model.addConstraint(made)
    if request.get("nested"):
        # a marker in a frame within a frame, both turned
        body = model.getBodySet().get(request["nested"])
        outer = osim.PhysicalOffsetFrame(body, osim.Transform(osim.Vec3(0.05, 0.02, -0.01)))
        outer.setName("outer")
        outer.set_orientation(osim.Vec3(0.2, -0.4, 0.6))
        body.addComponent(outer)
        inner = osim.PhysicalOffsetFrame(outer, osim.Transform(osim.Vec3(-0.03, 0.01, 0.04)))
        inner.setName("inner")
        inner.set_orientation(osim.Vec3(-0.7, 0.1, 0.3))
        outer.addComponent(inner)
        model.addMarker(osim.Marker("nested", inner, osim.Vec3(0.01, 0.02, 0.03)))
        tip = osim.Body("tip", 1.0, osim.Vec3(0), osim.Inertia(0.01, 0.01, 0.01))
        model.addBody(tip)
        pin = osim.PinJoint("tip_joint", inner, tip)
        pin.upd_coordinates(0).setName("tip_joint_0")
        model.addJoint(pin)
        model.addMarker(osim.Marker("tip_x", tip, osim.Vec3(0.1, 0.03, 0.02)))
    model.finalizeConnections()
    model.printToXML(request["file"])
    _weigh_evenly(Path(request["file"]))
    return {"version": osim.GetVersion()}


def _weigh_evenly(file):
    """OpenSim writes what memory holds as weights of a spline's added points, and may not read it again."""

    def even(found):
        return f"<weights>{' '.join('1' for _ in found[1].split())}</weights>"

    file.write_text(re.sub("<weights>(.*?)</weights>", even, file.read_text()))


def muscle_analysis(request):
    """Tables of OpenSim's muscle analysis over a motion: column to values."""
    model = osim.Model(request["file"])
    model.initSystem()
    times = osim.Storage(request["motion"])
    analysis = osim.MuscleAnalysis()
    analysis.setModel(model)
    analysis.setComputeMoments(True)
    names = osim.ArrayStr()
    for name in request["coordinates"]:
        names.append(name)
    analysis.setCoordinates(names)
    analysis.setStartTime(times.getFirstTime())
    analysis.setEndTime(times.getLastTime())
    model.addAnalysis(analysis)
    tool = osim.AnalyzeTool(model)
    tool.setName("oracle")
    tool.setCoordinatesFileName(request["motion"])
    tool.setLowpassCutoffFrequency(-1)
    tool.setInitialTime(times.getFirstTime())
    tool.setFinalTime(times.getLastTime())
    tool.setResultsDir(request["folder"])
    tool.setLoadModelAndInput(True)
    tool.setSolveForEquilibrium(False)
    tool.run()
    stem = f"{request['folder']}/oracle_MuscleAnalysis"
    files = {"length": f"{stem}_Length.sto"}
    files |= {name: f"{stem}_MomentArm_{name}.sto" for name in request["coordinates"]}
    return {name: columns(file) for name, file in files.items()}


def columns(file):
    table = osim.TimeSeriesTable(file)
    return {name: table.getDependentColumn(name).to_numpy().tolist() for name in table.getColumnLabels()}


def answer(request):
    osim.Logger.setLevelString("Error")
    operations = (positions, missed, scaled, build, muscle_analysis)
    return {each.__name__: each for each in operations}[request["operation"]](request)


if __name__ == "__main__":
    serve(answer)
