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
        persons.describe_task(),
        images.describe_marker_task(),
        images.describe_bone_task(),
        living_bone.describe_task(),
        hidden.describe_task(),
        wild_recordings.describe_task(),
        wild_models.describe_task(),
        bones.describe_task(),
        agreement.describe_task(),
    )
}
