"""OpenSim's IMU placer and IMU inverse kinematics as a peer. A worker of ``tests.peers``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tests.peers.worker import serve


def follow(request: dict[str, Any]) -> dict[str, Any]:
    """Sensors put on in the model's default pose, and a recording followed: coordinates in degrees and m.

    ``model``, ``standing``, ``walking``: files. ``to_opensim``: X-Y-Z angles, rad, from the sensors' world.
    ``base``, ``axis``: the sensor whose axis points forward in the pose.
    """
    import opensim

    opensim.Logger.setLevelString("Error")
    turn = opensim.Vec3(*request["to_opensim"])
    placer = opensim.IMUPlacer()
    placer.set_model_file(request["model"])
    placer.set_orientation_file_for_calibration(request["standing"])
    placer.set_sensor_to_opensim_rotations(turn)
    placer.set_base_imu_label(request["base"])
    placer.set_base_heading_axis(request["axis"])
    placer.set_output_model_file("placed.osim")
    placer.run(False)
    placer.getCalibratedModel().printToXML("placed.osim")
    tool = opensim.IMUInverseKinematicsTool()
    tool.set_model_file("placed.osim")
    tool.set_orientations_file(request["walking"])
    tool.set_sensor_to_opensim_rotations(turn)
    tool.set_results_directory(".")
    tool.set_output_motion_file("followed.mot")
    tool.set_report_errors(False)
    tool.run(False)
    table = opensim.TimeSeriesTable("followed.mot")
    labels = list(table.getColumnLabels())
    return {
        "coordinates": labels,
        "times": list(table.getIndependentColumn()),
        "values": [
            [row[k] for k in range(len(labels))]
            for row in map(table.getRowAtIndex, range(table.getNumRows()))
        ],
        "placed": Path("placed.osim").read_text(encoding="utf-8"),
    }


if __name__ == "__main__":
    serve(follow)
