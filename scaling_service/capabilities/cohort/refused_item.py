"""A member of a cohort whose subject file cannot be used: it fails without any work."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from scaling_service.capabilities.cohort.scaling_items import Done
from scaling_service.capabilities.subject.settings import Settings
from scaling_service.core.errors import InputError
from scaling_service.core.progress import Progress


@dataclass(frozen=True, slots=True)
class RefusedItem:
    """A subject that fails for a reason known already."""

    name: str
    error: InputError
    groups: Mapping[str, str] = field(default_factory=dict)

    def work(
        self,
        methods: Sequence[str] | None,  # noqa: ARG002 (every item's one signature; nothing is computed)
        settings: Settings,  # noqa: ARG002
        progress: Progress,  # noqa: ARG002
    ) -> Done:
        """Raise the reason."""
        raise self.error
