"""OpenSim's own scale and inverse kinematics tools, and its forward kinematics: operations of the worker."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from scaling_service.core.errors import FileUnreadable
from scaling_service.files.osim.library import import_opensim, list_items, list_numbers, list_rows

_UNASSIGNED = "Unassigned"
_TRANSLATIONAL = 2  # OpenSim's Coordinate::MotionType


def scale(request: dict[str, Any]) -> dict[str, Any]:
    """Run the scale tool; paths of its set-up (``file``) are replaced by the request's.

    ``model``, ``static``, ``output``: files. ``marker_set``: a file or None.
    """
    osim, scratch = import_opensim(), Path.cwd()
    setup = scratch / "setup.xml"  # the tool reads everything relative to its set-up
    setup.write_bytes(Path(request["file"]).read_bytes())
    tool = osim.ScaleTool(str(setup))
    tool.setPathToSubject("")
    maker, scaler, placer = tool.getGenericModelMaker(), tool.getModelScaler(), tool.getMarkerPlacer()
    maker.setModelFileName(request["model"])
    maker.setMarkerSetFileName(request.get("marker_set") or _UNASSIGNED)
    for part, name in ((scaler, "scaled.osim"), (placer, "placed.osim")):
        part.setMarkerFileName(request["static"])
        part.setOutputModelFileName(str(scratch / name))
    scaler.setOutputScaleFileName(_UNASSIGNED)
    placer.setOutputMotionFileName(str(scratch / "pose.mot"))
    placer.setOutputMarkerFileName(_UNASSIGNED)
    tool.run()  # its answer is not to be trusted: what it wrote is
    written = [p for p in (scratch / "placed.osim", scratch / "scaled.osim") if p.is_file()]
    if not written:
        raise FileUnreadable("OpenSim's scale tool wrote no model", file=request["file"])
    Path(request["output"]).write_bytes(written[0].read_bytes())
    return {}


def track(request: dict[str, Any]) -> dict[str, Any]:
    """Run the inverse kinematics tool over a whole recording.

    ``file``: the model. ``recording``: TRC. ``weights``: by marker; every marker of both counts 1 where it is
    empty. ``coordinates``: weights that draw coordinates to their defaults. ``output``: the motion.
    """
    osim = import_opensim()
    model = osim.Model(request["file"])
    model.initSystem()
    seen = osim.MarkerData(request["recording"])
    labels = [seen.getMarkerNames().get(k) for k in range(seen.getNumMarkers())]
    own = [marker.getName() for marker in list_items(model.getMarkerSet())]
    weights = request.get("weights") or dict.fromkeys((n for n in own if n in labels), 1.0)
    tool = osim.InverseKinematicsTool()
    for kind, each in ((osim.IKMarkerTask, weights), (osim.IKCoordinateTask, request.get("coordinates", {}))):
        for name, weight in each.items():
            task = kind()
            task.setName(name)
            task.setApply(True)
            task.setWeight(weight)
            tool.getIKTaskSet().cloneAndAppend(task)
    tool.setModel(model)
    tool.setMarkerDataFileName(request["recording"])
    tool.setStartTime(seen.getStartFrameTime())  # without them it stops at 2 s
    tool.setEndTime(seen.getLastFrameTime())
    tool.setOutputMotionFileName(request["output"])
    tool.run()
    if not Path(request["output"]).is_file():
        raise FileUnreadable("OpenSim's inverse kinematics tool wrote no motion", file=request["file"])
    return {}


def trace(request: dict[str, Any]) -> dict[str, Any]:
    """Where a motion takes a model, as OpenSim reads both; columns that are absent are at their defaults.

    ``file``: the model. ``motion``: a MOT or STO file, or None: the default pose. Returns ``times`` (n,), s;
    ``coordinates`` by name (n,), rad or m; ``slides``: names of those in m; ``joints`` by name: places of
    their frames on the parent (n, 3), ``markers`` by name (n, 3), m; ``turns`` by body (n, 3, 3), body to
    ground.
    """
    osim = import_opensim()
    model = osim.Model(request["file"])
    state = model.initSystem()
    times, columns = [0.0], {}
    if request["motion"]:  # OpenSim's older Storage would stop at the first row with a NaN
        table = osim.TimeSeriesTable(request["motion"])
        if table.hasTableMetaDataKey("inDegrees") and table.getTableMetaDataString("inDegrees") == "yes":
            model.getSimbodyEngine().convertDegreesToRadians(table)
        times = list(table.getIndependentColumn())
        for label in table.getColumnLabels():
            name = label.split("/")[-2] if label.endswith("/value") else label
            columns[name] = table.getDependentColumn(label).to_numpy().tolist()
    every, joints = list_items(model.getCoordinateSet()), list_items(model.getJointSet())
    bodies, markers = list_items(model.getBodySet()), list_items(model.getMarkerSet())
    slides = [c.getName() for c in every if c.getMotionType() == _TRANSLATIONAL]
    found: dict[str, dict[str, Any]] = {"coordinates": {}, "joints": {}, "markers": {}, "turns": {}}

    def add(kind: str, name: str, value: Any) -> None:
        found[kind].setdefault(name, []).append(value)

    for row in range(len(times)):
        for c in every:
            value = columns[c.getName()][row] if c.getName() in columns else math.nan
            c.setValue(state, c.getDefaultValue() if math.isnan(value) else value, False)
            add("coordinates", c.getName(), c.getValue(state))
        model.realizePosition(state)
        for j in joints:
            add("joints", j.getName(), list_numbers(j.getParentFrame().getPositionInGround(state)))
        for m in markers:
            add("markers", m.getName(), list_numbers(m.getLocationInGround(state)))
        for b in bodies:
            add("turns", b.getName(), list_rows(b.getTransformInGround(state).R().asMat33()))
    return {"times": times, "slides": slides, **found}
