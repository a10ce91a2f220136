"""OpenSim's view of a written body: markers, mass centre, kinetic energy. A worker of ``tests.peers``."""

from __future__ import annotations

from typing import Any

from tests.peers.worker import serve


def view(request: dict[str, Any]) -> dict[str, Any]:
    """For each pose and its speeds: markers by name, mass centre (m) and kinetic energy (J)."""
    import opensim

    opensim.Logger.setLevelString("Error")
    model = opensim.Model(request["model"])
    state = model.initSystem()
    coordinates = model.getCoordinateSet()
    answer: dict[str, Any] = {"markers": [], "centre": [], "energy": [], "mass": model.getTotalMass(state)}
    for q, qd in zip(request["q"], request["qd"], strict=True):
        for name, value, speed in zip(request["coordinates"], q, qd, strict=True):
            coordinates.get(name).setValue(state, value, False)
            coordinates.get(name).setSpeedValue(state, speed)
        model.realizeVelocity(state)
        markers = model.getMarkerSet()
        places = {m: markers.get(m).getLocationInGround(state) for m in request["markers"]}
        answer["markers"].append({m: [p[k] for k in range(3)] for m, p in places.items()})
        centre = model.calcMassCenterPosition(state)
        answer["centre"].append([centre[k] for k in range(3)])
        answer["energy"].append(model.calcKineticEnergy(state))
    return answer


if __name__ == "__main__":
    serve(view)
