"""Everything that can be chosen for the search."""

from __future__ import annotations

from dataclasses import dataclass

from scaling_service.capabilities.dynamics.settings import DynamicsSettings
from scaling_service.capabilities.subject.settings import Settings
from scaling_service.recording.pipeline import ProcessingSettings

AS_MEASURED = Settings(processing=ProcessingSettings(smoothing="none", longest_spline_s=0.0, solidify=False))
"""Neither smoothed nor filled: the noise of the recording tells what counts as a disagreement, and what was
filled in was not measured."""


@dataclass(frozen=True, slots=True)
class DiscoverSettings:
    """What can be chosen for the search.

    Parameters
    ----------
    start : str, optional
        A scaling method, or ``none`` for the given model as it is. Unless given: EB_am where there are bones,
        else MB_am.
    inertia : str, optional
        A table's name or ``model``; see ``with_inertia``.
    cutoff_hz : float
        Of the filter that motion and forces pass.
    """

    start: str | None = None
    inertia: str | None = None
    cutoff_hz: float = DynamicsSettings().cutoff_hz

    def check(self) -> None:
        """Refuse what there is not; see :meth:`DynamicsSettings.check`, which knows the same names."""
        DynamicsSettings(self.start, self.inertia, self.cutoff_hz).check()


PLAIN = DiscoverSettings()
"""Nothing chosen."""
