"""The tasks, in the order of the table."""

from __future__ import annotations

from scaling_service.studies.benchmark.parts import Task
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

TASKS: dict[str, Task] = {
    task.name: task
    for task in (
        persons.TASK,
        images.FROM_MARKERS,
        images.FROM_BONES,
        living_bone.TASK,
        hidden.TASK,
        wild_recordings.TASK,
        wild_models.TASK,
        bones.TASK,
        agreement.TASK,
    )
}
