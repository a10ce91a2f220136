"""Marker names: which labels of a recording mean which markers of a model.

Laboratories call one landmark by many names. Those known to mean the same place (see
``marker_sets``) form a class, named after the built-in models' marker; two names
match when they are of one class, so that a model of any origin can meet a recording of any origin. Tracking
markers, whose place is each laboratory's own choice (``RTHI``, ``R.TH1``), are in no class: they match by
name only.
"""

from __future__ import annotations

import re
from collections import abc, defaultdict
from dataclasses import dataclass
from functools import cache, lru_cache
from types import MappingProxyType

from scaling_service.core.errors import InputError
from scaling_service.model import marker_sets

_SEPARATORS = re.compile(r"[\s._\-]+")
_SUFFIX = "STUDY"  # r_knee_study: how OpenCap's video pipeline writes the markers of a physical set
_COMPUTED = re.compile(
    r"[HKASEW]JC|(JOINT|GROUND)$|^MID(?!FOOT)"  # OpenSim's examples and Stanford's files
    r"|^[RL]?CENT(RE|ER)OFMASS(FLOOR)?$"
    r"|^(PEL|HED|TRX|[RL](FE|TI|FO|TO|CL|HU|RA|HN))[OALP]$"  # origin and axes of Plug-in Gait's segments
    r"|(ANGLE|MOMENT|FORCE|POWER)S?$|GROUNDREACTION|NORMALI[SZ]EDGRF"  # its results
)
"""Joint centres, projections, midpoints, axes and results, as the files of public recordings name them and
Vicon's Plug-in Gait Reference Guide does."""

_LEFT_OUT = ("", "prefix left out", "capitals ignored", "known alias")
"""What a comparison of names leaves out, from strict to lenient: what a stricter one has matched is settled
before the next one looks."""

SACRUM = "SACR"
"""One marker that stands for both PSIS."""

PLANAR_SOURCES: abc.Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "TOE": ("RTOE", "LTOE"),
        "ANK": ("RLM", "LLM"),
        "TIB": ("RTIB", "LTIB"),
        "KNE": ("RLFE", "LLFE"),
        "THI": ("RTHI", "LTHI"),
        "ASI": ("RASIS", "LASIS"),
        "PSI": ("RPSIS", "LPSIS"),
        "T10": ("T10",),
        "STRN": ("STRN",),
        "C7": ("C7",),
        "CLAV": ("CLAV",),
        "SHO": ("RSHO", "LSHO"),
        "ELB": ("RELB", "LELB"),
    }
)
"""Markers of ``squat_4dof`` and the markers of a body in space whose mean in the sagittal plane they are."""


@dataclass(frozen=True, slots=True)
class Meaning:
    """What a label is known to stand for, whatever the recording."""

    landmark: str | None  # the built-in models' name of the landmark; None of tracking markers
    segment: str  # what carries it, without side, as the built-in models call it
    side: marker_sets.Side


@dataclass(frozen=True, slots=True)
class LabelMap:
    """Which label of the recordings was taken for which marker of the model."""

    mapped: abc.Mapping[str, str]  # model marker to label, in the order asked for
    unused_labels: tuple[str, ...]  # labels that no marker took
    notes: tuple[str, ...]  # what was decided and why, one plain sentence each, for a person

    @property
    def renames(self) -> dict[str, str]:
        """Label to model marker: what :meth:`Trial.relabelled` takes."""
        return {label: marker for marker, label in self.mapped.items()}


def strip_prefix(label: str) -> str:
    """A label without the ``Subject:`` before it.

    Examples
    --------
    >>> strip_prefix("S01:RASI")
    'RASI'
    """
    return label.rsplit(":", 1)[-1].strip()


def make_plain_key(name: str) -> str:
    """A name in capitals, without prefix, separators and the suffix ``_study``, for comparison.

    Examples
    --------
    >>> make_plain_key("S01:r_knee_study"), make_plain_key("R.Knee")
    ('RKNEE', 'RKNEE')
    """
    return _SEPARATORS.sub("", strip_prefix(name).upper()).removesuffix(_SUFFIX)


@lru_cache(maxsize=4096)  # chosen: more names than a batch of laboratories uses
def look_up_meaning(name: str) -> Meaning | None:
    """What a name stands for in the marker sets that are known; None if in none, or in two differently.

    Examples
    --------
    >>> look_up_meaning("RTIB"), look_up_meaning("S01:r.ASIS")
    (Meaning(landmark=None, segment='tibia', side='r'), Meaning(landmark='RASIS', segment='pelvis', side='r'))
    """
    return _list_meanings().get(make_plain_key(name))


@cache
def _list_meanings() -> abc.Mapping[str, Meaning]:
    """Plain key to what it means, from landmarks, their aliases and all labels of marker sets."""
    found: dict[str, Meaning | None] = {}

    def add(names: abc.Iterable[str], meant: Meaning) -> None:
        for name in names:
            key = make_plain_key(name)
            found[key] = meant if found.get(key, meant) == meant else None

    for landmark in marker_sets.list_landmarks().values():
        add((landmark.name, *landmark.aliases), Meaning(landmark.name, landmark.segment, landmark.side))
    for marker_set in marker_sets.list_marker_sets().values():
        for label in () if marker_set.key_points else marker_set.labels:
            add(label.names, Meaning(label.landmark, label.segment, label.side))
    return {key: meant for key, meant in found.items() if meant is not None}


def find_canonical(name: str) -> str | None:
    """The built-in models' name of the landmark that a name is known to mean; None if it is not known.

    Examples
    --------
    >>> [find_canonical(name) for name in ("r.ASIS", "L_mknee", "S01:RMMA", "RTHI")]
    ['RASIS', 'LMFE', 'RMM', None]
    """
    meant = look_up_meaning(name)
    return None if meant is None else meant.landmark


def is_computed(label: str) -> bool:
    """Whether a label reads like a point that software computed (a joint centre, a midpoint).

    Examples
    --------
    >>> [is_computed(name) for name in ("R_HJC_reg", "L.KneeJoint", "MidASIS", "RFEO", "RASIS", "R.Ankle")]
    [True, True, True, True, False, False]
    """
    return bool(_COMPUTED.search(make_plain_key(label)))


def _list_keys(name: str) -> tuple[str | None, ...]:
    """What names are compared by, in the order of ``_LEFT_OUT``; None where that says nothing."""
    plain = strip_prefix(name)
    return name, plain, plain.casefold(), find_canonical(name)


def describe_likeness(label: str, marker: str) -> str | None:
    """What must be left out of account for a label to be a marker's name; None where that is not enough.

    Examples
    --------
    >>> [describe_likeness(name, "RASIS") for name in ("RASIS", "S01:RASI", "RTHI")]
    ['', 'known alias', None]
    """
    compared = zip(_LEFT_OUT, _list_keys(marker), _list_keys(label), strict=True)
    return next((why for why, one, other in compared if one is not None and one == other), None)


def match_labels(
    labels: abc.Iterable[str], wanted: abc.Sequence[str], explicit: abc.Mapping[str, str] | None = None
) -> LabelMap:
    """Find the label of every wanted marker.

    A marker takes the label that the user named; else the one of the same name; else without prefix;
    else ignoring capitals; else a known alias. What is settled at one of these steps is not reopened
    at the next, and no label is used twice.

    ``labels``: the labels of the recordings (of all of them together, or of one).
    ``wanted``: names of the model's markers to look for.
    ``explicit``: model marker to label, as the user wrote under ``markers:``.
    Raises InputError: two labels fit one marker, or two markers one label, equally well; an explicit marker
        is not in the model, its label in no recording, or one label is given to two markers.

    Examples
    --------
    >>> match_labels(["S01:RASI", "S01:RKNE", "S01:RTHI"], ["RASIS", "RLFE", "RMFE"]).mapped
    {'RASIS': 'S01:RASI', 'RLFE': 'S01:RKNE'}
    """
    present = tuple(dict.fromkeys(labels))
    mapped, notes = _match_explicit(present, wanted, explicit or {})
    for level, why in enumerate(_LEFT_OUT):
        free = [label for label in present if label not in mapped.values()]
        open_markers = [name for name in wanted if name not in mapped]
        labels_of, markers_of = _group_labels(level, free), _group_labels(level, open_markers)
        matches = {}
        for key, names in markers_of.items():
            found = labels_of.get(key, [])
            if len(found) > 1:
                raise _report_ambiguous(names[0], found)
            if found and len(names) > 1:
                raise InputError(
                    f"label '{found[0]}' fits the markers {' and '.join(names)} equally well",
                    field=f"markers.{names[0]}",
                    remedy="Say under `markers:` which of them it is",
                )
            if found:
                matches[names[0]] = found[0]
        for name, label in matches.items():
            mapped[name] = label
            if why:
                notes.append(f"{name} is '{label}' ({why})")
    notes += [
        f"'{label}' is used as marker {name}, though its name is that of a computed point"
        for name, label in mapped.items()
        if is_computed(label)
    ]
    return LabelMap(
        {name: mapped[name] for name in wanted if name in mapped},
        tuple(label for label in present if label not in mapped.values()),
        tuple(notes),
    )


def _match_explicit(
    present: abc.Sequence[str], wanted: abc.Sequence[str], explicit: abc.Mapping[str, str]
) -> tuple[dict[str, str], list[str]]:
    mapped: dict[str, str] = {}
    for marker, label in explicit.items():
        field = f"markers.{marker}"
        if marker not in wanted:
            raise InputError(
                f"the model has no marker '{marker}'", field=field, remedy=f"It has {', '.join(wanted)}"
            )
        found = [p for p in present if p == label] or [p for p in present if strip_prefix(p) == label]
        if not found:
            raise InputError(
                f"label '{label}' is in no recording", field=field, remedy=f"They have {', '.join(present)}"
            )
        if len(found) > 1:
            raise _report_ambiguous(marker, found)
        if found[0] in mapped.values():
            raise InputError(
                f"label '{label}' is given to two markers",
                field=field,
                remedy="Give each marker a label of its own",
            )
        mapped[marker] = found[0]
    return mapped, [f"{marker} is '{label}' (as the subject file says)" for marker, label in mapped.items()]


def _group_labels(level: int, names: abc.Sequence[str]) -> dict[str, list[str]]:
    groups: dict[str, list[str]] = defaultdict(list)
    for name in names:
        key = _list_keys(name)[level]
        if key is not None:
            groups[key].append(name)
    return groups


def _report_ambiguous(marker: str, found: abc.Sequence[str]) -> InputError:
    return InputError(
        f"marker '{marker}' could be {' or '.join(repr(label) for label in found)}",
        field=f"markers.{marker}",
        remedy="Say under `markers:` which label it is",
    )
