"""What stands out of what is ordinary and is like no effect of the catalogue."""

from __future__ import annotations

import math

import numpy as np

from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.laws.candidates import Candidate
from scaling_service.capabilities.discovery.observations.wrench import COMPONENTS
from scaling_service.capabilities.discovery.ordinary.forces import ForceEvidence, WrenchTable
from scaling_service.capabilities.discovery.result import UnexplainedDocument
from scaling_service.capabilities.discovery.search.findings import UNITS, classify_place
from scaling_service.capabilities.discovery.search.forces import Search
from scaling_service.capabilities.discovery.search.gaps import describe_course, list_shown, rms_by_place
from scaling_service.capabilities.discovery.search.markers import BodyTable
from scaling_service.capabilities.discovery.search.naming import is_of_markers
from scaling_service.capabilities.discovery.search.yardstick import Yardstick
from scaling_service.recording.faults import OF_CAMERAS, OF_PLATES

_UNTOLD = "; of the body and the forces nothing is told until that is mended"
_REFUSED = "most like {}, but of a size that nobody meets, or worse on recordings that did not fit it"


def list_unexplained(
    search: Search, body: BodyTable, forces: tuple[WrenchTable, ForceEvidence] | None, yardstick: Yardstick
) -> tuple[UnexplainedDocument, ...]:
    """Places that are livelier than others of the person, and those of what has the odds but no name."""
    limit, fit = search.settings.unexplained, search.fit
    names = [item.name for item in fit.tracked]
    rms = rms_by_place(fit, names, forces=False) | rms_by_place(fit, names, forces=True)
    floors = {
        place: math.sqrt(
            np.mean([known[place][0] ** 2 for known in yardstick.levels.values() if place in known])
        )
        for place in rms
    }
    # Where the cameras are at fault, all else rests on them: only what is likelier is told
    sound = search.distorted == -math.inf
    jumps = [jump for jump in search.jumps if jump[0] > search.distorted]
    jumped = {j[1]: j for j in reversed(jumps)}
    astray = body.list_astray(limit) - jumped.keys() if sound else ()
    found: list[tuple[float, tuple[str, ...], str, str]] = [
        (math.log(body.strays[m]), (m,), m, "") for m in astray
    ]
    for odds, marker, trial, at, size in jumped.values():
        others = sum(j[1] == marker for j in jumps) - 1
        law = f"in {trial} it jumps by {1e3 * size:.0f} mm at {at:.2f} s and stays there"
        found.append((odds, (marker,), marker, f"{law}{f'; so it does in {others} more' if others else ''}"))
    said = {where: reason.format(_call(c)) for c, where, reason in search.withdrawn.values()}
    if forces is not None and sound:
        table, evidence = forces
        for k, component in enumerate(COMPONENTS):
            lively = table.rate_levels(evidence)[:, k]
            row = int(lively.argmax())
            if lively[row] > limit:
                trial, level = fit.wrenches[row].name, float(evidence.levels[row, k])
                rms[component] = rms_by_place(fit, [trial], forces=True)[component]
                floors[component] = yardstick.levels[trial][component][0] / level
                found.append((math.log(level), (component,), component, said.get((component,), "")))
    off: dict[tuple[str, ...], float] = {}  # of faults whose size the readings tell
    for where, places, law, size in _list_faults(fit):
        if shown := [p for p in places if p in floors]:
            most = max(shown, key=lambda p: rms[p] / floors[p])
            found.append((0.0, where, most, law))
            off |= {where: size} if size else {}
    told = {w for e in fit.effects for w in e.candidate.where} | {w for _, where, *_ in found for w in where}
    standing = list(search.withdrawn.values())
    refused = [one for one in search.list_standing() if one.odds > search.distorted]
    standing += [(one.candidate, one.candidate.where, _REFUSED) for one in refused]
    # What joints and markers seem to do beside markers that are not explained is told with these
    scene = fit.scene
    standing.sort(key=lambda one: not scene.list_bearing(one[1]))
    borne = scene.list_bearing([w for _, where, *_ in found for w in where], beside=True)
    for c, where, reason in standing:
        beside = is_of_markers(c) and borne & {*where, *scene.list_bearing(where)}
        if not beside and not told & set(where):
            told |= set(where)
            borne |= scene.list_bearing(where, beside=True)
            every = COMPONENTS if c.seen_in == "wrench" else list_shown(where, fit)
            if shown := [p for p in every if p in rms]:
                most = max(shown, key=lambda p: rms[p] / floors[p])
                found.append((0.0, where, most, reason.format(_call(c))))
    made = []
    for _, where, place, law in sorted(found, reverse=True):
        observable = classify_place(place)
        unit, factor = UNITS[observable]
        made.append(
            UnexplainedDocument(
                where=list(where),
                observable=observable,
                unit=unit,
                law=law or describe_course(fit, place) or "it follows no coordinate",
                rms=factor * off.get(tuple(where), rms.get(place, 0.0)),
                floor=factor * floors[place],
            )
        )
    return tuple(made)


def _call(candidate: Candidate) -> str:
    return candidate.kind.replace("_", " ")


def _list_faults(fit: Fit) -> list[tuple[tuple[str, ...], tuple[str, ...], str, float]]:
    """Faults of cameras and plates that the readings alone show and nothing repairs.

    Each with whose it is, the places where it would show, in words, in the first recording that has it, and
    how far it is off (RMS, SI), 0 where that is not known.
    """
    found: dict[str, tuple[tuple[str, ...], tuple[str, ...], str, float]] = {}
    for item in fit.tracked:
        for repair in item.trial.repairs:
            if repair.what in OF_CAMERAS:
                law = f"in {item.trial.name} they {repair.detail}{_UNTOLD}"
                found.setdefault(repair.what, (("markers",), item.markers, law, repair.off))
    for forces in fit.wrenches:
        for repair in forces.contacts.ground.repairs:
            if repair.what in OF_PLATES:
                plate, component = repair.where.split()
                law = f"in {forces.name} it {repair.detail}"
                found.setdefault(repair.where, ((plate,), (component,), law, repair.off))
    return list(found.values())
