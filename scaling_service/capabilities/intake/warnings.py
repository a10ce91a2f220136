"""What loading warns of, each with what to do about it."""

from __future__ import annotations

import re
from collections.abc import Mapping

from scaling_service.capabilities.intake.document import ProblemEntry

_REMEDIES: Mapping[str, str] = {
    r": correct the labels in the recording$": "Correct the labels in the recording",
    r": they are not followed; map them under `markers:` to use them$": (
        "Nothing is to be done; to follow them all the same, map them under `markers:`"
    ),
    r" of the model: not used$": (
        "If they were recorded under other names, map those under `markers:`; else nothing is to be done"
    ),
    r" and sizes stand in for them$": "Nothing is to be done; measured widths make it more certain",
    r" though no extra_markers name them$": (
        "Nothing is to be done; name them under `extra_markers:` to decide it yourself"
    ),
    r": it is left out$": "Correct the label under `extra_markers:`, or remove it there",
    r" labelled, but never seen$": "Label them in the recording if they matter; they are not used",
    r": nothing says how well the models follow recordings that were not used to fit$": (
        "Name a recording under `trials.evaluation` that is not used to fit; if there is none, record one"
    ),
    r": it may be a part of a recording$": "Export the recording again if frames are missing",
    r" \(\d+ frames?\)$": "Look at these frames; correct the recording if they matter",
    r": image-based methods were left out$": "Choose a built-in model of the legs to use the bones",
    r" was not taken: .*$": "Look at the surface of the bone there; without the point, the others are used",
    r": that was left out$": "Correct the scale set-up if it matters",
}
"""How a warning ends, to what can be done. The first that fits counts."""

_SAID_TWICE = re.compile(r"(: correct the labels in the recording|; map them under `markers:` to use them)$")
"""What to do, where the warning itself says it."""

_OTHER = "Look whether it matters to you; scaling takes it as told here"


def warning_entry(text: str) -> ProblemEntry:
    """A warning of loading as a problem with its remedy.

    Examples
    --------
    >>> warning_entry("no recording shows RFH of the model: not used").remedy[:42]
    'If they were recorded under other names, m'
    """
    remedy = next((told for ending, told in _REMEDIES.items() if re.search(ending, text)), _OTHER)
    problem = _SAID_TWICE.sub("", text)
    return ProblemEntry(severity="warning", problem=problem, remedy=remedy)
