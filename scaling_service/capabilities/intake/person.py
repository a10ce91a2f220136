"""What a folder's files say of the person: height, mass, sex, and sizes measured by hand."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from scaling_service.capabilities.intake.document import ProblemEntry, SizesProof
from scaling_service.capabilities.intake.recordings import Seen
from scaling_service.documents.sizes import SIZE_UNIT
from scaling_service.model.trial import MeasuredSizes, merge

_DECIMALS = 3
"""Of m and kg: files hold them as 32-bit numbers."""


def sizes_proof(known: Mapping[str, Any], recordings: Sequence[Seen]) -> SizesProof:
    """Sizes as the document states them, else as the recordings do.

    Parameters
    ----------
    known : mapping
        The subject's document, which need not be whole.
    recordings : sequence of Seen
    """
    person = known.get("subject") or {}
    own = MeasuredSizes(
        person.get("height_m"),
        person.get("mass_kg"),
        {name.removesuffix(SIZE_UNIT): value * 1e-3 for name, value in (known.get("sizes") or {}).items()},
    )
    found = own.or_else(merge(item.trial.sizes for item in recordings))
    stating = [item.file for item in recordings if item.trial.sizes]
    return SizesProof(
        height_m=_rounded(found.height_m),
        mass_kg=_rounded(found.mass_kg),
        sex=person.get("sex"),
        sizes_mm={name: round(1e3 * length, 1) for name, length in found.lengths_m.items()},
        source=[*(["the document"] if own else []), *stating],
    )


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, _DECIMALS)


def with_sizes(proposed: Mapping[str, Any], sizes: SizesProof) -> dict[str, Any]:
    """A subject document with what is known of the person; what it states already stays."""
    stated = {"height_m": sizes.height_m, "mass_kg": sizes.mass_kg}
    person = {key: value for key, value in stated.items() if value is not None}
    by_hand = {f"{name}{SIZE_UNIT}": value for name, value in sizes.sizes_mm.items()}
    whole = {
        **proposed,
        "subject": {
            **dict(proposed["subject"]),
            **{key: value for key, value in person.items() if proposed["subject"].get(key) is None},
        },
    }
    return whole | ({"sizes": by_hand | dict(proposed.get("sizes") or {})} if by_hand else {})


def unknown_person(sizes: SizesProof) -> Iterator[ProblemEntry]:
    """One question for all of height, mass and sex that is not known."""
    values = {"height_m": sizes.height_m, "mass_kg": sizes.mass_kg, "sex": sizes.sex}
    missing = [name for name, value in values.items() if value is None]
    if missing:
        are = "is" if len(missing) == 1 else "are"
        words = {"height_m": "height", "mass_kg": "mass", "sex": "sex"}
        example = {"height_m": "1.70", "mass_kg": "62.0", "sex": "F or M"}
        given = ", ".join(f"{name}: {example[name]}" for name in missing)
        yield ProblemEntry(
            severity="warning",
            field="subject",
            problem=f"{_listed([words[name] for name in missing])} of the person {are} not known, "
            "which inertia and all that rests on it need",
            remedy=f"Write `subject: {{{given}}}` with the person's own values",
        )


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
