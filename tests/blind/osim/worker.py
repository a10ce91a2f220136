"""OpenSim changes a model and moves it. A worker of ``tests.peers``."""

from __future__ import annotations

from functools import cache
from typing import Any

from tests.peers.worker import serve


@cache
def _opensim() -> Any:
    import opensim

    opensim.Logger.setLevelString("Error")
    return opensim


def _loaded(file: str) -> Any:
    """A model without muscles and without couplings: what moves it is given coordinate by coordinate."""
    model = _opensim().Model(file)
    model.updForceSet().clearAndDestroy()
    model.updConstraintSet().clearAndDestroy()
    model.finalizeConnections()
    return model


def answer(request: dict[str, Any]) -> dict[str, Any]:
    """What a model holds, another person's model, or how a changed model moves."""
    return {"read": _read, "person": _person, "move": _move}[request["task"]](request)


def _read(request: dict[str, Any]) -> dict[str, Any]:
    model = _loaded(request["model"])
    model.initSystem()
    bodies = []
    for joint in _each(model.getJointSet()):
        frame, body = joint.getParentFrame(), model.getBodySet().get(_base(joint.getChildFrame()))
        inertia = body.getInertia()
        diagonal, products = inertia.getMoments(), inertia.getProducts()
        bodies.append({
            "name": body.getName(), "parent": _base(frame), "joint": joint.getName(),
            "centre": _list(frame.findTransformInBaseFrame().p()), "mass": body.getMass(),
            "com": _list(body.getMassCenter()), "inertia": [*_list(diagonal), *_list(products)],
            "coordinates": [joint.get_coordinates(k).getName() for k in range(joint.numCoordinates())],
        })  # fmt: skip
    every = _each(model.getMarkerSet())
    markers = {m.getName(): (_base(m.getParentFrame()), _list(m.get_location())) for m in every}
    return {"bodies": bodies, "markers": markers, "gravity": _list(model.getGravity())}


def _person(request: dict[str, Any]) -> dict[str, Any]:
    """The model of another person of the same shape, ``factor`` times as tall and of ``mass_kg``."""
    model = _opensim().Model(request["model"])
    model.updForceSet().clearAndDestroy()
    _scale(model, {b.getName(): request["factor"] for b in _each(model.getBodySet())}, request["mass_kg"])
    model.printToXML(request["out"])
    return {}


def _move(request: dict[str, Any]) -> dict[str, Any]:
    """Poses of all bodies, centre of mass and momentum (linear, then angular) about the ground's origin."""
    model = _loaded(request["model"])
    _change(model, request["changes"])
    state = model.initSystem()
    coordinates = [model.getCoordinateSet().get(name) for name in request["coordinates"]]
    bodies = [model.getBodySet().get(name) for name in request["bodies"]]
    matter = model.getMatterSubsystem()
    found: dict[str, Any] = {k: [] for k in ("R", "origin", "centre", "momentum")}
    for q, qd in zip(request["q"], request["qd"], strict=True):
        for coordinate, value, speed in zip(coordinates, q, qd, strict=True):
            coordinate.setValue(state, value, False)
            coordinate.setSpeedValue(state, speed)
        model.realizeVelocity(state)
        poses = [body.getTransformInGround(state) for body in bodies]
        found["R"].append([[[p.R().get(i, j) for j in range(3)] for i in range(3)] for p in poses])
        found["origin"].append([_list(p.p()) for p in poses])
        found["centre"].append(_list(model.calcMassCenterPosition(state)))
        momentum = matter.calcSystemMomentumAboutGroundOrigin(state)
        found["momentum"].append([*_list(momentum.get(1)), *_list(momentum.get(0))])
    return {**found, "mass": model.getTotalMass(state)}


def _change(model: Any, changes: dict[str, Any]) -> None:
    """Put an effect into a model by OpenSim's own means."""
    osim = _opensim()
    if changes["scales"]:
        _scale(model, changes["scales"])
    for name, (mass, com, inertia) in changes["bodies"].items():
        body = model.updBodySet().get(name)
        body.setMass(mass)
        body.setMassCenter(osim.Vec3(*com))
        body.setInertia(osim.Inertia(*inertia))
    for name, centre in changes["centres"].items():
        joint = model.updJointSet().get(name)
        _offset(joint.getParentFrame()).set_translation(osim.Vec3(*centre))
    for name, (before, after) in changes["moves"].items():
        _add_moves(model, model.updJointSet().get(name), before, after)
    model.setGravity(osim.Vec3(*changes["gravity"]))
    model.finalizeConnections()


def _scale(model: Any, factors: dict[str, float], mass: float | None = None) -> None:
    """Scale bodies; all masses stay, or come to another total in proportion."""
    osim = _opensim()
    state, scales = model.initSystem(), osim.ScaleSet()
    for name, factor in factors.items():
        scale = osim.Scale()
        scale.setSegmentName(name)
        scale.setScaleFactors(osim.Vec3(factor))
        scale.setApply(True)
        scales.cloneAndAppend(scale)
    model.scale(state, scales, True, model.getTotalMass(state) if mass is None else mass)


def _add_moves(model: Any, joint: Any, before: list[Any], after: list[Any]) -> None:
    """Put joints of one coordinate, with bodies of no mass between, before and behind a joint."""
    parent, child = _offset(joint.getParentFrame()), _offset(joint.getChildFrame())
    base, at, turned = _physical(parent), parent.get_translation(), parent.get_orientation()
    zero = _opensim().Vec3(0)
    for move in before:
        still = zero if move[1] == "slide" else turned  # slides are along the parent's own axes
        base, at, turned = _bridge(model, move, (base, at, still)), zero, turned if still is zero else zero
    if before:
        _place(parent, (base, at, turned))
    if after:
        body = _massless(model, f"{joint.getName()}_moved")
        # copies: what a frame gives is its own, and changes with it
        own = child.get_translation(), child.get_orientation()
        end = _physical(child), *map(_opensim().Vec3, own)
        _place(child, (body, zero, zero))
        for move in after[:-1]:
            body = _bridge(model, move, (body, zero, zero))
        _joint(model, after[-1], (body, zero, zero), end)


def _bridge(model: Any, move: Any, where: Any) -> Any:
    body = _massless(model, f"{move[0]}_body")
    _joint(model, move, where, (body, _opensim().Vec3(0), _opensim().Vec3(0)))
    return body


def _massless(model: Any, name: str) -> Any:
    osim = _opensim()
    body = osim.Body(name, 0.0, osim.Vec3(0), osim.Inertia(0, 0, 0))
    model.addBody(body)
    return model.updBodySet().get(name)


def _joint(model: Any, move: Any, parent: Any, child: Any) -> None:
    """A joint with one coordinate, named ``move[0]``, that turns about or slides along x, y or z."""
    osim = _opensim()
    name, kind, axis = move
    transform = osim.SpatialTransform()  # three turns about, then three slides along, x, y and z
    moving = transform.updTransformAxis(axis.index(1.0) + (0 if kind == "turn" else 3))
    moving.setCoordinateNames(osim.ArrayStr(name, 1))
    moving.set_function(osim.LinearFunction(1.0, 0.0))
    model.addJoint(osim.CustomJoint(f"{name}_joint", *parent, *child, transform))


def _place(frame: Any, where: Any) -> None:
    base, at, turned = where
    frame.connectSocket_parent(base)
    frame.set_translation(at)
    frame.set_orientation(turned)


def _offset(frame: Any) -> Any:
    return _opensim().PhysicalOffsetFrame.safeDownCast(frame)


def _physical(offset: Any) -> Any:
    """The body (or ground) that an offset frame sits on."""
    return _opensim().PhysicalFrame.safeDownCast(offset.findBaseFrame())


def _base(frame: Any) -> str:
    return str(frame.findBaseFrame().getName())


def _each(collection: Any) -> list[Any]:
    return [collection.get(k) for k in range(collection.getSize())]


def _list(vector: Any) -> list[float]:
    return [vector[k] for k in range(3)]


if __name__ == "__main__":
    serve(answer)
