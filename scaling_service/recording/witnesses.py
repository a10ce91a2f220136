"""Labels of a recording by place and side: lines from left to right, and what shows a body's front."""

from __future__ import annotations

import dataclasses
import re
from collections import abc
from itertools import combinations

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.model.anatomy import markers
from scaling_service.model.trial import Trial, is_unlabelled
from scaling_service.numerics.least_squares.problem import find_shown
from scaling_service.recording.exchanged import MOST_COMPARED
from scaling_service.recording.repeated import list_repeated

WRONG = 0.01
"""Prior probability that a witness of the front misleads (chosen: two labels of it are exchanged, or a
posture that nobody thought of), and that a line does not follow those beside it."""

BACKWARDS = 0.1  # chosen: share of displacements in which somebody walks backwards or sideways

_BENT = 0.1
"""Of the leg's length: how far a knee must stand off the line from hip to ankle to show its front (chosen: 25
deg of flexion; a hip taken 50 mm off moves it by 0.03)."""

_FEWEST_BENT = 5  # frames, of up to FRAMES (chosen)
_WALKED_M = 0.7  # chosen: displacement of the pelvis that shows a direction
FRAMES = 200  # of a recording, evenly: a median needs no more (chosen)

_SHORT_M = 0.05  # chosen: markers of two sides that are nearer are where palpation and feet put them

_SEGMENTS = {
    "pelvis": "pelvis", "femur": "thigh", "tibia": "shank", "calcn": "foot", "toes": "foot", "talus": "foot",
    "torso": "trunk", "head": "head", "humerus": "arm", "ulna": "arm", "radius": "arm", "hand": "arm",
}  # fmt: skip
_WORDS = (
    ("foot", r"HEEL|TOE|FOOT|META|MT\d|HLX"), ("shank", r"SHANK|SHIN|TIB|ANK|MALL|^.SH\d|^.SK\d"),
    ("thigh", r"THIGH|KNEE|FEM|^.TH\d|TROCH|^.GT"), ("pelvis", r"ASIS|PSIS|ILIAC|CREST|HIP"),
    ("arm", r"ARM|ELBOW|WRIST|BICEP|HUMER|HAND|FINGER"), ("head", r"HEAD|TEMP|EAR"),
    ("trunk", r"SHOULD|ACROM|CLAV|STERN|SCAP"),
)  # fmt: skip
_INNER: abc.Mapping[str, str] = {"MFE": "LFE", "MM": "LM", "MT1": "MT5"}
"""Inner places of the legs to the outer ones beside them: knees and feet touch there, so that no line between
the two sides says anything."""

_HEEL, _TOE = (
    re.compile(r"^[RL](HEE|CAL|FCC|PCA)"),
    re.compile(r"^[RL](TOE|MT\d|\dMETA|MTH|[FSV]MH|FM\d|D\dM|HLX|TT2)"),
)
_CHEST = frozenset({"CLAV", "STRN", "STERNUM", "SJN", "SXS", "SUP", "STR", "IJ", "PX"})
_SPINE = frozenset({"C7", "CV7", "T2", "T6", "T8", "T10", "T12"})


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class SidePair:
    """A right and a left label of one place, and the line from left to right."""

    right: str
    left: str
    region: str
    line: Array  # (n_frames, 3), m


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Witness:
    """What shows the front of a part of the body, whatever its sides are called."""

    name: str  # in words
    labels: tuple[str, ...]  # that it rests on
    regions: frozenset[str]  # of the lines that it is compared with
    right: Array  # (n_frames, 3): front x up; NaN where it shows nothing
    _: dataclasses.KW_ONLY
    wrong: float = WRONG  # probability that it misleads


class Body:
    """The labels of a recording by place and side."""

    def __init__(self, trial: Trial, roles: abc.Mapping[str, str]) -> None:
        step = max(1, trial.n_frames // FRAMES)
        self.markers = trial.markers[::step]
        self.columns: dict[str, int] = {}  # landmark or plain name to column
        self.labels = trial.labels
        self.regions: dict[str, str] = {}
        shown = find_shown(self.markers)
        further = {label for labels in list_repeated(trial.labels).values() for label in labels}
        for k, label in enumerate(trial.labels):
            if not shown[k] or markers.is_computed(label) or is_unlabelled(label) or label in further:
                continue
            name = roles.get(label) or markers.make_plain_key(label)
            self.columns.setdefault(name, k)
            meant = markers.look_up_meaning(name) or markers.look_up_meaning(label)
            if meant is not None:
                region = _SEGMENTS.get(meant.segment)
            else:
                region = next((part for part, words in _WORDS if re.search(words, name)), None)
            if region is not None:
                self.regions[name] = region

    def at(self, *names: str) -> Array | None:
        """Mean of the places that are known, NaN where one of them is not seen; None if none is."""
        found = [self.markers[:, self.columns[name]] for name in names if name in self.columns]
        return np.mean(found, axis=0) if found else None

    def both(self, name: str) -> Array | None:
        """The middle of a right and a left place; None unless both are known."""
        sides = (f"R{name}", f"L{name}")
        return self.at(*sides) if all(side in self.columns for side in sides) else None

    def middle(self, region: str) -> Array | None:
        """The middle of the right and left places of a region; None where it has none on both sides."""
        middles = [self.both(n[1:]) for n in self.columns if n[0] == "R" and self.regions.get(n) == region]
        known = [middle for middle in middles if middle is not None]
        return np.mean(known, axis=0) if known else None

    def name(self, *names: str) -> tuple[str, ...]:
        """The labels of those places that are known."""
        return tuple(self.labels[self.columns[name]] for name in names if name in self.columns)

    def list_partners(self) -> dict[str, str]:
        """Every right name whose left one is there, too, with it."""
        found = {}
        for name in self.columns:
            other = f"LEFT{name[5:]}" if name.startswith("RIGHT") else f"L{name[1:]}"
            if name[0] == "R" and other in self.columns:
                found[name] = other
        return found

    def find_pairs(self) -> abc.Iterator[SidePair]:
        """The pairs whose line says something, in the parts of the body that they are on."""
        for name, other in self.list_partners().items():
            if name in self.regions and name[1:] not in _INNER:
                right, left = self.columns[name], self.columns[other]
                line = self.markers[:, right] - self.markers[:, left]
                yield SidePair(self.labels[right], self.labels[left], self.regions[name], line)

    def complete(
        self, exchanged: abc.Sequence[SidePair], *, whole: bool, part: bool
    ) -> tuple[tuple[str, str], ...]:
        """All labels that stand for the other side's: these, all, or the inner ones of a part as well."""
        wrong = {pair.right for pair in exchanged}
        found = []
        for name, other in self.list_partners().items():
            right, left = self.labels[self.columns[name]], self.labels[self.columns[other]]
            outer = self.columns.get(f"R{_INNER.get(name[1:], '')}")
            if whole or right in wrong or (part and outer is not None and self.labels[outer] in wrong):
                found.append((right, left))
        return tuple(found)

    def find_outward_lines(
        self, pairs: abc.Sequence[SidePair], witnesses: abc.Sequence[Witness]
    ) -> abc.Iterator[tuple[int, float]]:
        """Cosines with the body's right of the lines from the inner to the outer side of the legs' joints.

        Each with the number of its outer pair; the left one's is taken the other way round.
        """
        number = {self.labels.index(pair.right): k for k, pair in enumerate(pairs)}
        rights = [normalise(w.right) for w in witnesses if "pelvis" in w.regions]
        for inner, outer in _INNER.items():
            outer_pair = number.get(self.columns.get(f"R{outer}", -1))
            for side, sign in (("R", 1.0), ("L", -1.0)):
                if outer_pair is None or f"{side}{inner}" not in self.columns or not rights:
                    continue
                ends = [self.markers[:, self.columns[f"{side}{name}"]] for name in (outer, inner)]
                line = sign * normalise(ends[0] - ends[1])
                cosines = [take_median(np.einsum("fi,fi->f", line, right)) for right in rights]
                if np.isfinite(cosines).any():
                    yield outer_pair, float(np.nanmedian(cosines))

    def find_witnesses(self) -> abc.Iterator[Witness]:
        """What shows the front of each part of the body."""
        pelvis = self.both("ASIS")
        sacrum = self.both("PSIS") if self.both("PSIS") is not None else self.at("SACR")
        centre = _first(_mean(pelvis, sacrum), pelvis, sacrum)
        head = _first(self.both("FHD"), self.at("HV"))
        shoulders = _first(self.both("SHO"), self.at("C7"), self.at("CLAV"), head)
        low = _first(
            self.both("LM"), self.both("HEE"), self.both("LFE"), self.middle("foot"), self.middle("shank")
        )
        legs, trunk = _minus(centre, low), _minus(shoulders, centre)
        up = _first(trunk, legs)
        if pelvis is not None and sacrum is not None and up is not None:
            labels = self.name("RASIS", "LASIS", "RPSIS", "LPSIS", "SACR")
            yield Witness("the pelvis", labels, frozenset({"pelvis", "thigh"}), np.cross(pelvis - sacrum, up))
        for side, word in (("R", "right"), ("L", "left")):
            yield from self._find_of_leg(side, word, _first(legs, trunk))
        upright = _first(
            trunk,
            _minus(self.at("CLAV"), self.at("STRN")),
            _minus(self.at("C7"), self.at("T10")),
            _minus(head, shoulders),
        )
        chest, spine = self.at(*_CHEST), self.at(*_SPINE)
        sternum = _first(chest, self.both("SC"))
        if sternum is not None and spine is not None and upright is not None:
            labels = self.name(*sorted(_CHEST), "RSC", "LSC", *sorted(_SPINE))
            yield Witness(
                "the chest", labels, frozenset({"trunk", "pelvis"}), np.cross(sternum - spine, upright)
            )
        face, back = _first(self.both("FHD"), self.at("SEL")), _first(self.both("BHD"), self.at("OCC"))
        tall = _first(_minus(head, centre), _minus(head, self.at("C7")), _minus(head, self.both("SHO")))
        if face is not None and back is not None and tall is not None:
            labels = self.name("RFHD", "LFHD", "SEL", "RBHD", "LBHD", "OCC")
            yield Witness("the head", labels, frozenset({"head", "trunk"}), np.cross(face - back, tall))
        shin = _mean(_minus(self.at("RTUB"), self.at("RFH")), _minus(self.at("LTUB"), self.at("LFH")))
        if shin is not None and legs is not None:
            labels = self.name("RTUB", "LTUB", "RFH", "LFH")
            yield Witness("the shins", labels, frozenset({"pelvis", "thigh", "shank"}), np.cross(shin, legs))
        if centre is not None and up is not None:
            seen = centre[np.isfinite(centre).all(axis=1)]
            way = seen[-1] - seen[0] if len(seen) else np.zeros(3)
            if np.linalg.norm(way) > _WALKED_M:
                at = self.name("RASIS", "LASIS")
                yield Witness(
                    "the walk", at, frozenset({"pelvis", "thigh"}), np.cross(way[None], up), wrong=BACKWARDS
                )

    def _find_of_leg(self, side: str, word: str, up: Array | None) -> abc.Iterator[Witness]:
        names = [name for name in self.columns if name[0] == side]
        heel, toes = (
            [n for n in names if n == f"{side}HEE"],
            [n for n in names if n in (f"{side}MT1", f"{side}MT5")],
        )
        heel = heel or [n for n in names if _HEEL.match(n)]
        toes = toes or [n for n in names if _TOE.match(n)]
        knee, ankle = self.at(f"{side}LFE", f"{side}MFE"), self.at(f"{side}LM", f"{side}MM")
        shank = _first(_minus(knee, ankle), up)
        regions = frozenset({"pelvis", "thigh"})
        front = _minus(self.at(*toes), self.at(*heel))
        if front is not None and shank is not None:
            yield Witness(f"the {word} foot", self.name(*heel, *toes), regions, np.cross(front, shank))
        hip = _first(
            _mean(self.at(f"{side}ASIS"), _first(self.at(f"{side}PSIS"), self.at("SACR"))),
            self.at(f"{side}GT"),
        )
        if hip is None or knee is None or ankle is None:
            return
        leg = hip - ankle
        along = np.einsum("fi,fi->f", knee - ankle, leg) / np.einsum("fi,fi->f", leg, leg)
        off = knee - ankle - along[:, None] * leg
        size = np.linalg.norm(knee - ankle, axis=1) + np.linalg.norm(hip - knee, axis=1)
        right = np.cross(off, leg)
        bent = np.linalg.norm(off, axis=1) > _BENT * size
        if bent.sum() >= min(_FEWEST_BENT, len(bent)):
            right[~bent] = np.nan
            labels = self.name(f"{side}LFE", f"{side}LM")
            yield Witness(f"the {word} knee", labels, regions, right)


def _first(*values: Array | None) -> Array | None:
    return next((value for value in values if value is not None), None)


def _minus(one: Array | None, other: Array | None) -> Array | None:
    return None if one is None or other is None else one - other


def _mean(one: Array | None, other: Array | None) -> Array | None:
    return None if one is None or other is None else 0.5 * (one + other)


def normalise(vectors: Array, *, softened: bool = False) -> Array:
    """Directions; ``softened``: of lines, m, those that are short and say little are shorter."""
    least = _SHORT_M if softened else 0.0
    with np.errstate(invalid="ignore", divide="ignore"):
        directions: Array = vectors / np.sqrt(np.square(vectors).sum(axis=-1, keepdims=True) + least**2)
    return directions


def take_median(values: Array) -> float:
    """Median of what is known, NaN if nothing is."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else float("nan")


def measure_within_segments(trial: Trial, roles: abc.Mapping[str, str]) -> dict[tuple[str, str, str], float]:
    """Median distances (m) of any two markers of a segment, by segment, in words, and their labels."""
    body = Body(trial, roles)
    segments: dict[str, list[str]] = {}
    for name, region in body.regions.items():
        side = f" {name[0]}" if region not in ("head", "trunk", "pelvis") else ""
        segments.setdefault(f"{region}{side}", []).append(name)
    found = {}
    for segment, names in segments.items():
        for a, b in combinations(sorted(names)[:MOST_COMPARED], 2):
            distance = np.linalg.norm(
                body.markers[:, body.columns[a]] - body.markers[:, body.columns[b]], axis=1
            )
            median = take_median(distance)
            if np.isfinite(median):
                found[segment, body.labels[body.columns[a]], body.labels[body.columns[b]]] = median
    return found
