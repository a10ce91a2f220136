"""Everything that can be chosen for dynamics."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from scaling_service.capabilities.shared import names
from scaling_service.core import options
from scaling_service.recording.settings import DYNAMICS_CUTOFF_HZ

DEFAULT_TABLE = "dumas2007"
"""For built-in models that were scaled to a person: the table of Muller et al. 2017, sec. 2.3."""


class ForceSettings(options.Options):
    """What can be chosen wherever a model meets the ground's forces."""

    start: names.Start = Field(
        default=None,
        description="Scaling to start from; 'none' takes the given model as it is: already scaled. MAP "
        "unless given; `consistent` and `discover` take EB_am where there are bones, else MB_am.",
        examples=["none"],
    )
    inertia: names.Inertia = Field(
        default=None,
        description="Inertial table; 'model' keeps the model's own. dumas2007 for built-in models that were "
        "scaled, else the model's own, unless given.",
    )
    cutoff_hz: Annotated[float, options.Flag(metavar="HZ")] = Field(
        default=DYNAMICS_CUTOFF_HZ,
        gt=0.0,
        le=1000.0,
        description="Of the filter that motion and forces pass.",
    )


class DynamicsSettings(ForceSettings):
    """What can be chosen for dynamics.

    Examples
    --------
    >>> import scaling_service as ss
    >>> ss.DynamicsSettings(start="MB", inertia="dumas2007").cutoff_hz
    5.0
    """

    identify: Annotated[bool, options.Flag(name="--identify")] = Field(
        default=False, description="Identify the inertia from the calibration trials with forces."
    )
    free_mass: Annotated[bool, options.Flag(name="--free-mass")] = Field(
        default=False, description="Let identification change the total mass."
    )
    sides_apart: Annotated[bool, options.Flag(name="--sides-apart")] = Field(
        default=False, description="Let identification change left and right apart."
    )
    despite_verdict: Annotated[bool, options.Flag(name="--despite-verdict")] = Field(
        default=False, description="Identify even where the verdict is that it would fit noise."
    )
