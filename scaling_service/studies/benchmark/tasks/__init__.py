"""The tasks, in the order of the table."""

from __future__ import annotations

from importlib import resources

from scaling_service.model.reference import read_reference
from scaling_service.studies.benchmark.parts import Metric, Task
from scaling_service.studies.benchmark.tasks import (
    agreement,
    bones,
    hidden,
    images,
    living_bone,
    persons,
    wild_models,
    wild_recordings,
)

_MAKERS = {
    "persons": persons.make_cases,
    "markers_mri": images.make_marker_cases,
    "images": images.make_bone_cases,
    "living_bone": living_bone.make_cases,
    "hidden": hidden.make_cases,
    "wild_recordings": wild_recordings.make_cases,
    "wild_models": wild_models.make_cases,
    "bones": bones.make_cases,
    "agreement": agreement.make_cases,
}

TASKS: dict[str, Task] = {
    name: Task(
        name=name,
        cases=_MAKERS[name],
        **said | {"metrics": tuple(Metric(**metric) for metric in said["metrics"])},
    )
    for name, said in read_reference(resources.files(__package__) / "tasks.yaml").items()
}
"""What ``tasks.yaml`` says, with the function that makes the cases."""
