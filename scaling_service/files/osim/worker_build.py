"""Make an OpenSim model from a plan of bodies and custom joints (worker side)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from scaling_service.core.errors import ModelRefused
from scaling_service.files.osim.library import opensim
from scaling_service.files.osim.worker_amend import euler_xyz, set_coordinates, set_markers, written
from scaling_service.files.osim.worker_describe import short


def build(request: dict[str, Any]) -> dict[str, Any]:
    """Build the model; answer with its text and its description read back."""
    library = opensim()
    model = library.Model()
    for item in request["bodies"]:
        body = library.Body()
        body.setName(item["name"])
        body.set_mass(item["mass"])
        body.set_mass_center(library.Vec3(*item["com"]))
        body.set_inertia(library.Vec6(*item["inertia"]))
        model.addBody(body)
        body.thisown = False  # the model deletes it
    for item in request["joints"]:
        joint = _joint(model, item)
        model.addJoint(joint)
        joint.thisown = False
    for item in request["couplers"]:
        coupler = _coupler(item)
        model.addConstraint(coupler)
        coupler.thisown = False
    try:
        model.finalizeConnections()
    except RuntimeError as error:
        raise ModelRefused(
            f"OpenSim does not accept the model ({short(error)})",
            remedy="Check masses, inertias and joint axes",
        ) from error
    set_coordinates(model, request["coordinates"])
    set_markers(model, request["markers"])
    return written(model, request["name"])


def _coupler(item: Mapping[str, Any]) -> Any:
    """Keeps one coordinate equal to another."""
    library = opensim()
    coupler = library.CoordinateCouplerConstraint()
    coupler.setName(item["name"])
    independent = library.ArrayStr()
    independent.append(item["independent"])
    coupler.setIndependentCoordinateNames(independent)
    coupler.setDependentCoordinateName(item["dependent"])
    coupler.setFunction(library.LinearFunction(1.0, 0.0))
    return coupler


def _joint(model: Any, item: Mapping[str, Any]) -> Any:
    library = opensim()
    bodies = model.getBodySet()
    parent = model.getGround() if item["parent"] == "ground" else bodies.get(item["parent"])
    frames: list[Any] = []
    for body, offset in ((parent, item["parent_offset"]), (bodies.get(item["child"]), item["child_offset"])):
        frames += [body, library.Vec3(*offset["translation"]), library.Vec3(*euler_xyz(offset["rotation"]))]
    if not item["axes"]:
        return library.WeldJoint(item["name"], *frames)
    return library.CustomJoint(item["name"], *frames, _transform(item["axes"]))


def _transform(axes: Sequence[Mapping[str, Any]]) -> Any:
    library = opensim()
    transform = library.SpatialTransform()
    for k, item in enumerate(axes):
        axis = transform.updTransformAxis(k)
        axis.setAxis(library.Vec3(*item["axis"]))
        if item["coordinate"] is not None:
            names = library.ArrayStr()
            names.append(item["coordinate"])
            axis.setCoordinateNames(names)
        axis.set_function(_function(item["function"]))
    return transform


def _function(item: Mapping[str, Any]) -> Any:
    library = opensim()
    kind = item["kind"]
    if kind == "Constant":
        return library.Constant(item["value"])
    if kind == "LinearFunction":
        return library.LinearFunction(item["slope"], item["intercept"])
    if kind == "PolynomialFunction":
        coefficients = library.Vector(len(item["coefficients"]), 0.0)
        for k, value in enumerate(item["coefficients"]):
            coefficients.set(k, value)
        return library.PolynomialFunction(coefficients)
    spline = getattr(library, kind)()
    for x, y in zip(item["x"], item["y"], strict=True):
        spline.addPoint(x, y)
    return spline
