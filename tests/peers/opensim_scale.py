"""OpenSim's ScaleTool as a peer: its factors, markers, static pose and model, in a process of its own.

For tests and benchmarks only. Run as a module it is the worker; :func:`run_opensim_scale` asks it.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.peers.worker import ask, serve

Vector = tuple[float, float, float]
_UNASSIGNED = "Unassigned"


@dataclass(frozen=True, slots=True)
class OpenSimScale:
    """What OpenSim's ScaleTool made of a model.

    Parameters
    ----------
    factors : dict
        Body to its x, y, z factors, for bodies that have a mesh.
    markers : dict
        Marker to the body it is on and its place there (m).
    masses : dict
        Body to its mass (kg).
    pose : dict
        The static pose that the marker placer found (rad or m); empty where it does not apply.
    cpu_s : float
        Process time of the tool, without import.
    """

    factors: dict[str, Vector]
    markers: dict[str, tuple[str, Vector]]
    masses: dict[str, float]
    pose: dict[str, float]
    cpu_s: float


def run_opensim_scale(
    setup: Path,
    model: Path,
    static: Path,
    *,
    marker_set: Path | None = None,
    accuracy: float | None = None,
    output: Path | None = None,
    time_limit_s: float = 300.0,
) -> OpenSimScale:
    """Scale a model by a set-up whose paths are replaced by these.

    Parameters
    ----------
    accuracy : float, optional
        Of the static pose. The tool leaves OpenSim's solver at 1e-4 and cannot be told otherwise; with
        an accuracy its placer is done again, step by step, by the same parts of OpenSim.
    output : Path, optional
        Where to keep the model that the tool wrote.
    """
    request = {
        "setup": str(setup.resolve()),
        "model": str(model.resolve()),
        "static": str(static.resolve()),
        "marker_set": str(marker_set.resolve()) if marker_set is not None else _UNASSIGNED,
        "accuracy": accuracy,
        "output": str(output.resolve()) if output is not None else None,
    }
    answer = ask("tests.peers.opensim_scale", request, time_limit_s=time_limit_s)
    return OpenSimScale(
        factors={body: _vector(values) for body, values in answer["factors"].items()},
        markers={name: (body, _vector(place)) for name, (body, place) in answer["markers"].items()},
        masses=answer["masses"],
        pose=answer["pose"],
        cpu_s=answer["cpu_s"],
    )


def _vector(values: list[float]) -> Vector:
    x, y, z = values
    return (x, y, z)


def _scaled(request: dict[str, Any]) -> dict[str, Any]:
    import opensim as osim

    osim.Logger.setLevelString("Error")
    scratch = Path.cwd()
    copy = scratch / "setup.xml"  # the tool reads everything relative to its set-up
    copy.write_bytes(Path(request["setup"]).read_bytes())
    tool = osim.ScaleTool(str(copy))
    tool.setPathToSubject("")
    maker, scaler, placer = tool.getGenericModelMaker(), tool.getModelScaler(), tool.getMarkerPlacer()
    maker.setModelFileName(request["model"])
    maker.setMarkerSetFileName(request["marker_set"])
    scaler.setMarkerFileName(request["static"])
    scaler.setOutputModelFileName(str(scratch / "scaled.osim"))
    scaler.setOutputScaleFileName(_UNASSIGNED)
    placer.setMarkerFileName(request["static"])
    placer.setOutputModelFileName(str(scratch / "placed.osim"))
    placer.setOutputMotionFileName(str(scratch / "pose.mot"))
    placer.setOutputMarkerFileName(_UNASSIGNED)
    again = request["accuracy"] is not None and placer.getApply()
    if again:
        placer.setApply(False)
    start = time.process_time()
    tool.run()  # its answer is not to be trusted: what it wrote is
    cpu = time.process_time() - start
    pose = _place_again(osim, request, placer, scratch) if again else _pose(osim, scratch / "pose.mot")
    written = next(p for p in (scratch / "placed.osim", scratch / "scaled.osim") if p.is_file())
    if request["output"] is not None:
        Path(request["output"]).write_bytes(written.read_bytes())
    model = osim.Model(str(written))
    model.initSystem()
    bodies = [model.getBodySet().get(k) for k in range(model.getBodySet().getSize())]
    markers = [model.getMarkerSet().get(k) for k in range(model.getMarkerSet().getSize())]
    return {
        "factors": _factors(osim.Model(request["model"]), bodies),
        "markers": {
            m.getName(): (m.getParentFrame().getName(), [m.get_location()[k] for k in range(3)])
            for m in markers
        },
        "masses": {b.getName(): b.getMass() for b in bodies},
        "pose": pose,
        "cpu_s": cpu,
    }


def _factors(generic: Any, bodies: list[Any]) -> dict[str, list[float]]:
    """Factors by how much each body's first mesh grew: the scale file holds six digits only."""
    found = {}
    for body in bodies:
        if body.getPropertyByName("attached_geometry").size():
            after = body.get_attached_geometry(0).get_scale_factors()
            before = generic.getBodySet().get(body.getName()).get_attached_geometry(0).get_scale_factors()
            found[body.getName()] = [after[k] / before[k] for k in range(3)]
    return found


def _place_again(osim: Any, request: dict[str, Any], placer: Any, scratch: Path) -> dict[str, float]:
    """What the marker placer does, with a solver of a given accuracy; writes the model.

    Couplings are left out of the solve, for they admit no accuracy beyond 1e-7: in these models they
    move the kneecaps, which carry no marker.
    """
    model = osim.Model(str(scratch / "scaled.osim"))
    placed = osim.Model(str(scratch / "scaled.osim"))
    model.updConstraintSet().clearAndDestroy()
    static = osim.MarkerData(request["static"])
    span = [placer.getTimeRange().get(k) for k in range(2)]
    static.averageFrames(-1.0, *span)
    static.convertToUnits(model.getLengthUnits())
    places = [static.getFrame(0).getMarker(k) for k in range(static.getNumMarkers())]
    seen = {static.getMarkerNames().get(k): place for k, place in enumerate(places)}
    state = model.initSystem()
    weights, coordinates = _tasks(osim, placer.getIKTaskSet(), model)
    table = osim.TimeSeriesTableVec3()
    table.setColumnLabels(list(seen))
    row = osim.RowVectorVec3(len(seen))
    for k, place in enumerate(seen.values()):
        row[k] = place
    table.appendRow(span[0], row)
    table.addTableMetaDataString("DataRate", "1")
    table.addTableMetaDataString("Units", "m")
    solver = osim.InverseKinematicsSolver(
        model, osim.MarkersReference(table, weights), coordinates, float("inf")
    )
    solver.setAccuracy(request["accuracy"])
    state.setTime(span[0])
    solver.assemble(state)
    model.realizePosition(state)
    markers = [model.getMarkerSet().get(k) for k in range(model.getMarkerSet().getSize())]
    for marker in markers:
        if not marker.get_fixed() and marker.getName() in seen:
            frame = marker.getParentFrame()
            place = model.getGround().findStationLocationInAnotherFrame(state, seen[marker.getName()], frame)
            placed.updMarkerSet().get(marker.getName()).set_location(place)
    every = [model.getCoordinateSet().get(k) for k in range(model.getCoordinateSet().getSize())]
    pose = {c.getName(): c.getValue(state) for c in every}
    placed.printToXML(str(scratch / "placed.osim"))
    return pose


def _tasks(osim: Any, tasks: Any, model: Any) -> tuple[Any, Any]:
    weights, coordinates = osim.SetMarkerWeights(), osim.SimTKArrayCoordinateReference()
    for task in (tasks.get(k) for k in range(tasks.getSize())):
        if not task.getApply():
            continue
        if (marker := osim.IKMarkerTask.safeDownCast(task)) is not None:
            weights.cloneAndAppend(osim.MarkerWeight(marker.getName(), marker.getWeight()))
        elif (coordinate := osim.IKCoordinateTask.safeDownCast(task)) is not None:
            by_hand = coordinate.getValueType() == osim.IKCoordinateTask.ManualValue
            default = model.getCoordinateSet().get(coordinate.getName()).getDefaultValue()
            target = osim.Constant(coordinate.getValue() if by_hand else default)
            reference = osim.CoordinateReference(coordinate.getName(), target)
            reference.setWeight(coordinate.getWeight())
            coordinates.push_back(reference)
    return weights, coordinates


def _pose(osim: Any, path: Path) -> dict[str, float]:
    """The pose that the tool wrote, in radians and metres, by coordinate."""
    if not path.is_file():
        return {}
    table = osim.TimeSeriesTable(str(path))
    row = table.getRowAtIndex(0)
    values = {label: row[k] for k, label in enumerate(table.getColumnLabels())}
    return {label.split("/")[-2]: value for label, value in values.items() if label.endswith("/value")}


if __name__ == "__main__":
    serve(_scaled)
