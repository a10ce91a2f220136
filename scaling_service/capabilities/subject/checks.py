"""Whether recordings suit each other and the model, asked before anything is fitted; what to tell of them."""

from __future__ import annotations

from collections import abc
from itertools import combinations
from pathlib import Path

import numpy as np

from scaling_service.capabilities.subject.understanding import Understood
from scaling_service.core import errors, notes
from scaling_service.core.names import say_plates
from scaling_service.core.text import list_few
from scaling_service.model import body
from scaling_service.model import subject as subjects
from scaling_service.model.anatomy.key_points import tell_key_points
from scaling_service.model.anatomy.markers import find_canonical
from scaling_service.model.trial import Trial
from scaling_service.recording import findings, person
from scaling_service.recording.faults import FAULTS

SAME_M = 1e-5
"""Positions closer than this in every frame are one recording (chosen: TRC files keep this much, and no two
recordings of a person agree so well)."""

ONE_SPOT_M = 1e-3
"""Two markers nearer than this are one marker with two labels (chosen: the smallest balls measure 3 mm)."""

NEEDED_TOGETHER = (("RLFE", "RMFE"), ("LLFE", "LMFE"), ("RLM", "RMM"), ("LLM", "LMM"))
"""Where the second is labelled and the first is not, the first has an unknown name; no laboratory marks the
inner side of a joint alone. The other way round is common."""

_TOLD = (
    "stray",
    "impossible_position",
    "cut_row",
    "duplicate",
    "persons",
    "mirrored",
    "rate",
    "header",
    *FAULTS,
)
"""Repairs that a person should know of without opening the results."""

_REMEDIES: abc.Mapping[str, str] = {
    "jitter": "Look at the marker in the recording; its gaps are filled as others are",
    "merged": "Correct the trajectories; until then both are filled there as other gaps are",
    "shaking": "Mount the cameras firmly and record again; a filter saves the angles only",
    "uneven": "Export it anew without repeated frames, or record again; until then speeds are wrong there",
}
_LOOK_THERE = "Look at these frames; correct the recording if they matter"
_NOTHING = "Nothing is to be done"

_STANDS_IN: abc.Mapping[str, tuple[str, ...]] = {
    "RPSIS": ("SACR", "LPSIS"),
    "LPSIS": ("SACR", "RPSIS"),
    **{
        f"{side}{inner}": (f"{side}{outer}",)
        for side in "RL"
        for inner, outer in (("MFE", "LFE"), ("MM", "LM"))
    },
}
"""Landmark, and those from which scaling constructs what it needs of it, the best first."""

_FRAME_COUNTS = ("NumFrames", "frames")
"""Where a header's count of frames differs from what the file holds, it may be the half of a recording."""


def question(understood: Understood, model: body.BodyModel) -> tuple[notes.Note, ...]:
    """What to tell of the recordings, and what they show that those of one sound person do not.

    Raises SubjectInvalid: two are one recording. Raises TrialUnusable: two labels of one ball. Raises
    NotAPerson: a finding beyond doubt.
    """
    subject = understood.subject
    trials = {path: trial for path, trial in understood.trials.items() if trial.labels}
    if not trials:
        return ()
    marked = list(trials.values())
    given = findings.Recordings(
        trials=marked,
        clusters=understood.clusters,
        static=trials[subject.static].name if subject.static in trials else None,
        stated=findings.Stated(sex=subject.sex, height_m=subject.height_m, mass_kg=subject.mass_kg),
        model=model,
    )
    for trial in marked:
        refuse_one_spot(model, trial)
    refuse_repeated(trials, subject)
    found = findings.refuse(person.ask(given))
    summary = summarise_recordings(model, subject, marked)
    of_video = tell_key_points(model, [label for trial in marked for label in trial.shown_labels])
    return (*(of_video or summary), *found)


def refuse_repeated(trials: abc.Mapping[Path, Trial], subject: subjects.Subject) -> None:
    """One recording under two names would count twice, or pass for one that was never fitted.

    ``trials``: file to what it holds, in m. Raises SubjectInvalid: naming both files.
    """
    fields = {path: f"trials.evaluation.{k}" for k, path in enumerate(subject.evaluation)}
    fields |= {path: f"trials.calibration.{k}" for k, path in enumerate(subject.calibration)}
    for first, second in combinations(trials, 2):
        if _is_same(trials[first], trials[second]):
            raise errors.SubjectInvalid(
                f"'{second.name}' holds the same recording as '{first.name}'",
                field=fields.get(second, "trials.static"),
                remedy="Remove one of them, or name the recording that was meant",
            )


def _is_same(one: Trial, other: Trial) -> bool:
    if one.n_frames != other.n_frames or set(one.labels) != set(other.labels):
        return False
    theirs = other.select(one.labels).markers
    both = np.isfinite(one.markers) & np.isfinite(theirs)
    if not both.any() or not np.array_equal(np.isfinite(one.markers), np.isfinite(theirs)):
        return False
    return bool(np.abs(one.markers - theirs)[both].max() < SAME_M)


def refuse_one_spot(model: body.BodyModel, trial: Trial) -> None:
    """Two markers of one segment with the same positions give it no size.

    ``trial``: in m, with the model's names. Raises TrialUnusable: naming both.
    """
    carried: dict[str, list[body.Marker]] = {}
    for marker in model.markers:
        if marker.name in trial.labels and marker.weight > 0.0:
            carried.setdefault(marker.segment, []).append(marker)
    for one, other in (pair for markers in carried.values() for pair in combinations(markers, 2)):
        # Median over the frames that show both (m); infinite where none does.
        distance = np.linalg.norm(trial.position(one.name) - trial.position(other.name), axis=1)
        known = distance[np.isfinite(distance)]
        apart = float(np.median(known)) if len(known) else float("inf")
        if apart < ONE_SPOT_M < float(np.linalg.norm(np.subtract(one.nominal, other.nominal))):
            raise errors.TrialUnusable(
                f"markers '{one.name}' and '{other.name}' lie on one spot in trial '{trial.name}'",
                file=trial.name,
                field=f"{one.name}, {other.name}",
                remedy="Correct the labels in the recording, or leave one of them out of it",
            )


def require_landmarks(session: subjects.Session) -> None:
    """Refuse recordings in which a landmark has a name that nothing here knows.

    Pelvis landmarks are needed for the hip centres as soon as one is there (both ASIS; a PSIS or the sacrum),
    the outer landmark of a knee or ankle as soon as the inner one is. A leg that was not marked at all
    is nobody's mistake. Landmarks of which the model has no marker are not needed.

    Raises MarkerMissing.
    """
    trials = [*([session.static] if session.static is not None else []), *session.dynamic]
    ours = {
        landmark: m.name for m in session.model.markers if (landmark := find_canonical(m.name)) is not None
    }
    theirs = {find_canonical(label) for trial in trials for label in trial.labels}
    needed = [outer for outer, inner in NEEDED_TOGETHER if inner in theirs]
    if theirs & {"RASIS", "LASIS", "RPSIS", "LPSIS", "SACR"}:
        back = theirs & {"SACR", "RPSIS", "LPSIS"}
        needed += ["RASIS", "LASIS", *(() if back else ("RPSIS", "LPSIS"))]
    for landmark in needed:
        if landmark in ours and landmark not in theirs:
            known = set(session.model.marker_names)
            # Those that mean nothing to the model first: the one that is looked for is among them.
            present = sorted(trials[0].labels, key=lambda label: label in known)
            raise errors.MarkerMissing(ours[landmark], trials[0].name, present)


def summarise_recordings(
    model: body.BodyModel, subject: subjects.Subject, trials: abc.Sequence[Trial]
) -> abc.Iterator[notes.Note]:
    """One plain sentence for each thing.

    ``trials``: with the model's names, before gaps are filled and positions smoothed.
    """
    if subject.calibration and not subject.evaluation:
        yield notes.Note(
            code="no_evaluation",
            problem="there is no evaluation trial: nothing says how well the models follow recordings that "
            "were not used to fit",
            remedy="Name a recording under `trials.evaluation` that is not used to fit; if there is none, "
            "record one",
        )
    yield from _tell_unseen(model, subject, trials)
    for trial in trials:
        for repair in trial.repairs:
            if repair.what == "header" and repair.where in _FRAME_COUNTS:
                yield notes.Note(
                    code="part",
                    place=trial.name,
                    problem=f"{repair.detail} frames: it may be a part of a recording",
                    remedy="Export the recording again if frames are missing",
                )
            elif repair.what in _TOLD:
                count = (
                    f" ({repair.frames} frame{'s' if repair.frames != 1 else ''})" if repair.frames else ""
                )
                yield notes.Note(
                    code=repair.what,
                    place=trial.name,
                    problem=f"{say_plates(repair.where)}: {repair.detail}{count}",
                    remedy=_REMEDIES.get(repair.what, _LOOK_THERE if repair.frames else notes.LOOK),
                )


def _tell_unseen(
    model: body.BodyModel, subject: subjects.Subject, trials: abc.Sequence[Trial]
) -> abc.Iterator[notes.Note]:
    shown = {label for trial in trials for label in trial.shown_labels}
    followed = [m.name for m in model.markers if m.weight > 0.0]
    missing = [name for name in followed if name not in shown]
    landmarks = {find_canonical(name) for name in shown}
    computed = [m.name for m in model.markers if m.weight == 0.0 and m.name in shown]
    if computed:
        yield notes.Note(
            code="computed",
            severity="note",
            problem=f"{list_few(computed)} are points that software computed from markers: they are not "
            "followed",
            remedy=f"{_NOTHING}; to follow them all the same, map them under `markers:`",
            hint="map them under `markers:` to use them",
        )
    absent = [name for name in missing if find_canonical(name) not in landmarks]
    replaced: dict[str, str] = {}
    for name in absent:
        others = [other for other in _STANDS_IN.get(find_canonical(name) or "", ()) if other in landmarks]
        if others:
            replaced[name] = others[0]
    if replaced:
        stand_ins = list_few(list(dict.fromkeys(replaced.values())))
        yield notes.Note(
            code="stand_in",
            severity="note",
            problem=f"{list_few(list(replaced))} not recorded: {stand_ins} and sizes stand in for them",
            remedy=f"{_NOTHING}; measured widths make it more certain",
        )
    missing = [name for name in missing if name not in replaced]
    if missing:
        yield notes.Note(
            code="missing",
            problem=f"no recording shows {list_few(missing)} of the model",
            remedy="If they were recorded under other names, map those under `markers:`; without them "
            "results are less certain",
        )
    for label in subject.extra_markers:
        if label not in shown:
            yield notes.Note(
                code="extra_missing",
                problem=f"extra marker '{label}' is in no recording: it is left out",
                remedy="Correct the label under `extra_markers:`, or remove it there",
            )
    for trial in trials:
        here = set(trial.shown_labels)
        empty = [n for n in (*followed, *subject.extra_markers) if n in trial.labels and n in shown - here]
        if empty:
            yield notes.Note(
                code="unseen",
                place=trial.name,
                problem=f"{list_few(empty)} labelled, but never seen",
                remedy="Label them in the recording if they matter; they are not used",
            )
