"""Everything that can be chosen for dynamics."""

from __future__ import annotations

from dataclasses import dataclass

from scaling_service.capabilities.dynamics.inverse_dynamics import CUTOFF_HZ
from scaling_service.capabilities.scaling.methods.table import METHODS
from scaling_service.capabilities.subject.settings import Settings
from scaling_service.core.errors import InputError, SubjectInvalid
from scaling_service.model.inertia import TABLE_NAMES
from scaling_service.recording.pipeline import ProcessingSettings

AS_IT_IS = "none"
"""In place of a method: the given model is used as it is."""

UNSMOOTHED = Settings(processing=ProcessingSettings(smoothing="none"))
"""Markers are not smoothed: motion and forces then pass one filter, and the same one."""

OWN = "model"
"""In place of a table's name: what the model holds."""

DEFAULT_TABLE = "dumas2007"
"""For built-in models that were scaled to a person: the table of Muller et al. 2017, sec. 2.3."""


@dataclass(frozen=True, slots=True)
class DynamicsSettings:
    """What can be chosen for dynamics.

    Parameters
    ----------
    start : str, optional
        A scaling method, or ``AS_IT_IS``. Unless given: EB_am where bones are given, else MB_am.
    inertia : str, optional
        A table's name or ``model``; see ``with_inertia``.
    cutoff_hz : float
        Of the filter of coordinates and forces (Muller et al. 2017, sec. 2.1: 5 Hz).
    identify : bool
        Whether to identify the inertia from the calibration trials.
    mass_known : bool
        Whether the total mass stays in identification.
    symmetric : bool
        Whether left and right change alike in identification.
    despite_verdict : bool
        Identify even where the verdict is that these recordings cannot calibrate inertia.
    samples : int
        Of the uncertainty, per level (Muller et al. 2017 took 1000; chosen: with 200 a standard deviation is
        known to 5 %).
    """

    start: str | None = None
    inertia: str | None = None
    cutoff_hz: float = CUTOFF_HZ
    identify: bool = False
    mass_known: bool = True
    symmetric: bool = True
    despite_verdict: bool = False
    samples: int = 200

    def check(self) -> None:
        """Refuse what there is not.

        Raises
        ------
        InputError
            A method or table has another name, or the cutoff is none.
        """
        if self.start is not None and self.start != AS_IT_IS:
            _check_method(self.start)
        check_inertia(self.inertia)
        if not self.cutoff_hz > 0:
            raise InputError(
                f"a cutoff of {self.cutoff_hz:g} Hz is none", field="cutoff_hz", remedy="Give one above zero"
            )


PLAIN = DynamicsSettings()
"""Nothing chosen."""


def check_inertia(inertia: str | None) -> None:
    """Refuse a name that there is not (SubjectInvalid)."""
    if inertia is not None and inertia not in (*TABLE_NAMES, OWN):
        raise SubjectInvalid(
            f"there is no inertial table '{inertia}'",
            field="inertia",
            remedy=f"Use one of {', '.join(TABLE_NAMES)}, or '{OWN}' for the model's own",
        )


def _check_method(method: str) -> None:
    if method not in METHODS:
        raise SubjectInvalid(
            f"there is no method '{method}'",
            field="start",
            remedy=f"Methods are {', '.join(METHODS)}; '{AS_IT_IS}' takes the model as it is",
        )
