"""Everything that can be chosen for the search."""

from __future__ import annotations

from scaling_service.capabilities.dynamics.settings import ForceSettings
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.recording.settings import ProcessingSettings

AS_MEASURED = Settings(processing=ProcessingSettings(smoothing="none", longest_spline_s=0.0, solidify=False))
"""Neither smoothed nor filled: the noise of the recording tells what counts as a disagreement, and what was
filled in was not measured."""


class DiscoverSettings(ForceSettings):
    """What can be chosen for the search.

    Examples
    --------
    >>> import scaling_service as ss
    >>> ss.DiscoverSettings(start="none").start  # the model as it is
    'none'
    """


PLAIN = DiscoverSettings()
"""Nothing chosen."""
