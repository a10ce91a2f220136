"""What each analysis needs, what of it is there, and what to give."""

from __future__ import annotations

from collections import abc
from typing import Any, Literal

from scaling_service.capabilities.dynamics.weight import FAR_OFF
from scaling_service.capabilities.intake import result as documents
from scaling_service.capabilities.intake.markers import WHOLE
from scaling_service.capabilities.kinetics.forces import FEWEST, find_feet
from scaling_service.capabilities.motion.ranges import list_hidden_segments
from scaling_service.core.errors import ModelRefused
from scaling_service.core.names import say_names
from scaling_service.core.text import list_few
from scaling_service.model import builtin
from scaling_service.model.body import BodyModel
from scaling_service.model.inertia import sum_mass


def judge_readiness(
    proposed: abc.Mapping[str, Any] | None,
    recordings: abc.Sequence[documents.RecordingProof],
    markers: abc.Sequence[documents.MarkerProof],
    model: BodyModel,
    sizes: documents.SizesProof,
    problems: abc.Sequence[documents.ProblemEntry],
) -> list[documents.Readiness]:
    """Whether each analysis can run, in the order in which people use them.

    ``proposed``: the subject document as it would be given; None where no recording can be used.
    """
    trials = dict((proposed or {}).get("trials") or {})
    moving = [*trials.get("calibration", ()), *trials.get("evaluation", ())]
    pushed = [r.file for r in recordings if r.file in moving and (r.plates or r.force is not None)]
    errors = [problem.problem for problem in problems if problem.severity == "error"]
    usable = documents.Need(
        name="every problem solved" if errors else "recordings",
        there=proposed is not None and not errors,
        text=errors[0]
        if errors
        else f"{len(recordings)} that can be used"
        if proposed
        else "none that can be used",
        give="recordings",
    )
    static, held_out = trials.get("static"), trials.get("evaluation") or []
    standing = documents.Need(
        name="standing trial",
        there=static is not None,
        required=False,
        text=static or "without one, segments are measured on the movements, where skin slides",
        give="static",
    )
    unseen = documents.Need(
        name="held-out movement",
        there=bool(held_out),
        required=False,
        text=list_few(held_out)
        or "without one, nothing says how well a model follows what it was not fitted to",
        give="evaluation",
    )
    movement = documents.Need(
        name="movement",
        there=bool(moving),
        text=list_few(moving) or "a recording in which the person moves",
        give="recordings",
    )
    bones = (proposed or {}).get("bones")
    imaged = documents.Need(
        name="bones",
        there=bool(bones),
        required=False,
        text=list_few([name for name in bones if name != "units"])
        if bones
        else "with them, two more methods rest on images",
        give="bones",
    )
    forces = documents.Need(
        name="forces",
        there=bool(pushed),
        text=f"with {list_few(pushed)}" if pushed else "no movement has force plates or a file of forces",
        give="forces",
    )
    feet, whole = _check_feet(model, markers), _check_whole_body(model, sizes.mass_kg)
    height = _measure(
        "height", sizes.height_m, "m", "residuals are reported as shares of body weight times height"
    )
    mass = _measure("mass", sizes.mass_kg, "kg", "the plates' weight stands in for it", required=False)
    both = documents.Need(
        name="fitted movement with forces",
        there=any(file in trials.get("calibration", ()) for file in pushed),
        text=list_few([file for file in pushed if file in trials.get("calibration", ())])
        or "no movement that is fitted (calibration) has forces",
        give="forces",
    )
    video = model.shows_key_points_alone([m.marker for m in markers if m.label is not None])
    text = "the recordings hold key points of video, too coarse for it"
    skin = [documents.Need(name="markers on skin", there=False, text=text, give="recordings")] * video
    persons = (*skin, feet, whole, height, mass)
    extra = (proposed or {}).get("extra_markers") or {}
    hidden = tuple(_check_segments(model, markers, extra, moving))
    return [
        _make_entry("comparisons", "Compare scaling methods", usable, *hidden, standing, unseen, imaged),
        _make_entry("discoveries", "Find the missing effect", usable, *skin, *hidden, movement, unseen),
        _make_entry("dynamics", "Check the forces", usable, *hidden, forces, *persons),
        _make_entry(
            "consistent-motions", "Motion that agrees with the forces", usable, *hidden, both, *persons
        ),
    ]


def _check_segments(
    model: BodyModel,
    markers: abc.Sequence[documents.MarkerProof],
    extra: abc.Mapping[str, str],
    moving: abc.Sequence[str],
) -> abc.Iterator[documents.Need]:
    """What a movement does not show of the model; nothing where every segment is shown.

    Nothing waits for it: what is not shown is not told in the results, and all else is. ``extra``: further
    marker to its segment. Its place is found while scaling; here it counts as showing that.
    """
    if not moving:
        return
    seen = {m.marker for m in markers if m.label is not None and set(moving) <= set(m.recordings)}
    hidden = [name for name in list_hidden_segments(model, seen) if name not in extra.values()]
    lacking = {m.marker: m.segment for m in markers if m.segment in hidden and m.marker not in seen}
    if shown := [name for name in hidden if name in lacking.values()]:
        text = f"no marker shows {say_names(shown)} in the movements: how they turn is not told, all else is"
        text += f"; {list_few(list(lacking))} would show it, or markers under `extra_markers:`"
        yield documents.Need(name="segments", there=False, required=False, text=text, give="model")
    if bare := [name for name in hidden if name not in shown]:
        text = f"the model has no marker on {say_names(bare)}: how they turn is not told"
        yield documents.Need(name="segments", there=False, required=False, text=text, give="model")


def sum_up(
    problems: abc.Sequence[documents.ProblemEntry], readiness: abc.Sequence[documents.Readiness]
) -> str:
    """The state of the files in a sentence: what can run, and how much there is to look at first."""
    errors = sum(problem.severity == "error" for problem in problems)
    warnings = sum(problem.severity == "warning" for problem in problems)
    if errors:
        return f"{_count(errors, 'problem')} to solve before anything can run"
    ready = sum(entry.ready for entry in readiness)
    can = "Everything can run" if ready == len(readiness) else f"{ready} of {len(readiness)} analyses can run"
    return f"{can}; {_count(warnings, 'thing')} to look at first" if warnings else can


def _count(number: int, one: str) -> str:
    return f"{number} {one}{'' if number == 1 else 's'}"


def _make_entry(route: str, title: str, *needs: documents.Need) -> documents.Readiness:
    ready = all(need.there or not need.required for need in needs)
    return documents.Readiness(analysis=route, title=title, ready=ready, needs=list(needs))


def _measure(
    name: Literal["height", "mass"], value: float | None, unit: str, why: str, *, required: bool = True
) -> documents.Need:
    text = why if value is None else f"{value:g} {unit}"
    return documents.Need(name=name, there=value is not None, required=required, text=text, give=name)


def _check_feet(model: BodyModel, markers: abc.Sequence[documents.MarkerProof]) -> documents.Need:
    """That the model has feet, and each shows the markers that tell which plate it stands on."""
    try:
        bare = [
            foot
            for foot, segments in find_feet(model).items()
            if sum(m.label is not None and m.segment in segments for m in markers) < FEWEST
        ]
    except ModelRefused as error:
        return documents.Need(name="feet", there=False, text=error.problem, give="model")
    text = f"{list_few(bare)}: too few markers to tell the plate it stands on" if bare else "with markers"
    return documents.Need(name="feet", there=not bare, text=text, give="model")


def _check_whole_body(model: BodyModel, mass_kg: float | None) -> documents.Need:
    """That the model has about a person's mass: the plates bear the whole person."""
    person = (
        builtin.load_generic_person(model.name).mass_kg if model.name in builtin.BUILTIN_NAMES else mass_kg
    )
    share = sum_mass(model) / person if person else 1.0
    there = share * FAR_OFF >= 1.0
    text = "the model has a person's mass"
    if not there:
        text = f"{model.name} is {share:.0%} of a person, and the plates bear all of it"
        text += f"; to check the forces, choose {WHOLE}" if model.name in builtin.BUILTIN_NAMES else ""
    return documents.Need(name="whole body", there=there, text=text, give="model")
