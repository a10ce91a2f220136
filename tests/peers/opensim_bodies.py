"""OpenSim's origins and body-fixed X-Y-Z angles of all bodies. A worker of ``tests.peers``."""

from __future__ import annotations

from typing import Any

from tests.peers.worker import serve


def view(request: dict[str, Any]) -> dict[str, Any]:
    """For each pose and body, m and rad."""
    import opensim

    opensim.Logger.setLevelString("Error")
    model = opensim.Model(request["model"])
    state = model.initSystem()
    coordinates, bodies = model.getCoordinateSet(), model.getBodySet()
    answer: dict[str, Any] = {"origins": {}, "angles": {}}
    for q in request["q"]:
        for name, value in zip(request["coordinates"], q, strict=True):
            coordinates.get(name).setValue(state, value, False)
        model.realizePosition(state)
        for k in range(bodies.getSize()):
            body = bodies.get(k)
            there = body.getTransformInGround(state)
            angles = there.R().convertRotationToBodyFixedXYZ()
            for kind, vector in (("origins", there.p()), ("angles", angles)):
                answer[kind].setdefault(body.getName(), []).append([vector[i] for i in range(3)])
    return answer


if __name__ == "__main__":
    serve(view)
