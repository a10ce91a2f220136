"""What a cohort shows, in sentences: for terminal, report and page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import islice

from scaling_service.capabilities.cohort.document import QuantityEntry, StatisticsDocument
from scaling_service.capabilities.cohort.summary import IMAGED, TRUTH
from scaling_service.core.text import format_p
from scaling_service.report.methods import spell_name


def write_headline(found: StatisticsDocument) -> str:
    """Which method follows the markers most closely, and whether that is more than chance."""
    role, entry = next(_list_compared_errors(found), (None, None))
    if role is None or entry is None:
        return "The methods cannot be compared: no two of them were done on the same persons"
    best = min(entry.mean, key=entry.mean.__getitem__)
    count = len(entry.compared.subjects)
    people = "1 person" if count == 1 else f"{count} persons"
    said = f"{best} follows the markers of {people} most closely, to {entry.mean[best]:.1f} mm {role}"
    if entry.friedman is None:
        return f"{said}; too few persons to tell that from chance"
    return said if entry.friedman.significant else f"{said}, but the methods may differ by chance"


def write_reasons(found: StatisticsDocument, groups: Mapping[str, Mapping[str, str]]) -> list[str]:
    """What the headline rests on, and what it does not say; ``groups``: the labels of each subject."""
    return [
        *_describe_errors(found),
        *_describe_groups(found, groups),
        *_describe_lengths(found),
        *_describe_nearest(found),
        *_describe_angles(found),
        "A small error alone is no proof of a right model: look at the agreement with images, too.",
    ]


def _list_compared_errors(found: StatisticsDocument) -> Iterator[tuple[str, QuantityEntry]]:
    """Errors of two methods or more, in words where: held out first."""
    entries = {entry.quantity: entry for entry in found.kinematic_error_mm if len(entry.mean) > 1}
    for role, said in (("evaluation", "on held-out trials"), ("calibration", "on trials used to fit")):
        if role in entries:
            yield said, entries[role]


def _rank(values: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {values[name]:.1f}" for name in sorted(values, key=values.__getitem__))


def _describe_errors(found: StatisticsDocument) -> Iterator[str]:
    for said, entry in _list_compared_errors(found):
        ranked = f"Kinematic error {said}, mm, smallest first: {_rank(entry.mean)}."
        yield f"{ranked} {_describe_test(entry)}"


def _describe_groups(found: StatisticsDocument, groups: Mapping[str, Mapping[str, str]]) -> Iterator[str]:
    """The errors of the first role in each group of each label."""
    for said, entry in islice(_list_compared_errors(found), 1):
        for label in sorted({label for given in groups.values() for label in given}):
            members: dict[str, list[Mapping[str, float]]] = {}
            for subject in entry.compared.subjects:
                members.setdefault(groups[subject].get(label) or "not given", []).append(
                    entry.values[subject]
                )
            if len(members) > 1:
                ranks = "; ".join(
                    f"{group} ({len(of)}): {_rank(_average_by_method(of))}" for group, of in members.items()
                )
                yield f"By {label}, kinematic error {said}, mm: {ranks}. Groups are described, not tested."


def _average_by_method(values: Sequence[Mapping[str, float]]) -> dict[str, float]:
    return {method: sum(one[method] for one in values) / len(values) for method in values[0]}


def _describe_test(entry: QuantityEntry) -> str:
    if entry.friedman is None:
        return f"Not tested: {entry.note}."
    said = "The methods differ" if entry.friedman.significant else "No difference between methods is found"
    return f"{said} (Friedman p {format_p(entry.friedman.p)})."


def _describe_lengths(found: StatisticsDocument) -> Iterator[str]:
    tests = [(spell_name(e.quantity), e.friedman) for e in found.segment_lengths_mm if e.friedman is not None]
    differ = dict.fromkeys(name for name, test in tests if test.significant)
    yield from _tell_differences(len(tests), ", ".join(differ), "segment length", "")


def _describe_nearest(found: StatisticsDocument) -> Iterator[str]:
    """Which method's lengths lie nearest to each reference, by the RMS over lengths and subjects."""
    for reference, said in ((IMAGED, "the image"), (TRUTH, "the truth")):
        squares: dict[str, list[float]] = {}
        for item in found.agreement:
            if item.reference == reference and "." not in item.quantity:
                squares.setdefault(item.method, []).append(item.rmse_mm**2)
        if squares:
            rms = {m: (sum(v) / len(v)) ** 0.5 for m, v in squares.items()}
            yield f"Lengths against {said}, RMS in mm, nearest first: {_rank(rms)}."


def _describe_angles(found: StatisticsDocument) -> Iterator[str]:
    tests = [(spell_name(c.coordinate), c.anova) for c in found.joint_angles if c.anova is not None]
    differ = dict.fromkeys(name for name, test in tests if test.significant)
    yield from _tell_differences(len(tests), "; ".join(differ), "joint angle", " in the gait cycle")


def _tell_differences(tested: int, differ: str, quantity: str, where: str) -> Iterator[str]:
    if differ:
        yield f"{quantity.capitalize()}s differ between methods{where} for {differ}."
    elif tested:
        yield f"No {quantity} is found to differ between methods{where}."
