"""Equivalence classes as they are once everything that is named is known."""

from __future__ import annotations

from dataclasses import replace

import pytest

from scaling_service.capabilities.discovery.evidence.fit import SearchContext, fit_recordings
from scaling_service.capabilities.discovery.search.naming import tell_classes
from tests.discovery.hidden import candidate, passed, person, recorded, sized


def test_what_is_named_itself_is_in_nobodys_class() -> None:
    offset, other = (sized("marker_offset", name, numbers=(6.0, 0.0, 6.0)) for name in ("RFH", "LFH"))
    alike = candidate("marker_offset", "RLFE")
    model = person().model
    fit = fit_recordings(SearchContext(model=model, recordings=recorded(person(), model)))
    first = replace(passed(offset), equivalents={other.candidate: 0.5, alike: 0.2})
    assert first.member == pytest.approx(1.0 / (1.0 + 1.0 + 0.25))
    alone, beside = tell_classes([first], fit), tell_classes([first, passed(other)], fit)
    assert list(alone[0].equivalents) == [other.candidate, alike]
    assert list(beside[0].equivalents) == [alike]
    assert beside[0].member == pytest.approx(1.0 / 1.25)
