"""Effects tried in full are added only if markers and forces agree better where they were not fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.discovery.effects.catalogue import propose_candidates
from scaling_service.capabilities.discovery.evidence.fit import Recording, SearchContext, fit_recordings
from scaling_service.capabilities.discovery.laws.apply import with_effects
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Estimate
from scaling_service.capabilities.discovery.options import AS_MEASURED, DiscoverSettings
from scaling_service.capabilities.discovery.search.estimation import estimate
from scaling_service.capabilities.discovery.search.findings import NamedEffect
from scaling_service.capabilities.discovery.search.selection import Outcome, try_in_full
from scaling_service.capabilities.discovery.start import prepare
from scaling_service.capabilities.subject.loading import open_subject
from scaling_service.model.body import BodyModel
from tests.discovery.hidden import passed
from tests.jobs.force_laboratory import force_laboratory

GAIN = 1.1
TRUNK = ("T10", "C7", "CLAV", "STRN", "RSHO", "LSHO")


def named(candidate: Candidate, *numbers: float) -> NamedEffect:
    """As if it had passed, with numbers as in the results."""
    size = [(n - c.neutral) / c.unit for n, c in zip(numbers, candidate.columns, strict=True)]
    return passed(Estimate(candidate, np.array(size)))


class Laboratory:
    """Recordings in which the skin of the trunk moves as it bends, and the same without."""

    def __init__(self, folder: Path) -> None:
        self.model, self.bare = _laboratory(folder, None)
        self.choice = tuple(
            propose_candidates(fit_recordings(SearchContext(model=self.model, recordings=self.bare)).scene)
        )
        self.skin = self.of("soft_tissue_artefact", *TRUNK, driver="thoracic_extension")
        self.moved = self.with_(folder, named(self.skin, 3.0, 0.0, 0.0))

    def with_(self, folder: Path, *found: NamedEffect) -> tuple[Recording, ...]:
        """The recordings with effects in all of them."""
        return _laboratory(folder, with_effects(self.model, [n.effect for n in found], ""))[1]

    def of(self, kind: str, *where: str, driver: str | None = None) -> Candidate:
        """A candidate in all recordings."""
        return next(
            c
            for c in self.choice
            if c.kind == kind and c.where == where and not c.trials and driver in (None, *c.driver)
        )

    def tried(
        self, recordings: Sequence[Recording], *found: NamedEffect, known: Sequence[Estimate] = ()
    ) -> Outcome:
        """Effects in full, where others are known as well as they can be without them."""
        now = estimate(fit_recordings(SearchContext(model=self.model, recordings=recordings)), known)
        return try_in_full(now, found)


def _laboratory(folder: Path, truth: BodyModel | None) -> tuple[BodyModel, tuple[Recording, ...]]:
    file = force_laboratory(folder, truth=truth)
    prepared = prepare(open_subject(file, AS_MEASURED), DiscoverSettings(start="none"), AS_MEASURED, 0.5)
    return prepared.model, tuple(prepared.recordings)


def _stronger(recording: Recording) -> Recording:
    """With a first plate that measures too much."""
    assert recording.contacts is not None
    ground = recording.contacts.ground
    factor = np.where(np.array(ground.plates) == "plate_1", GAIN, 1.0)[:, None]
    ground = replace(ground, force=factor * ground.force, moment=factor * ground.moment)
    footing = replace(recording.contacts, ground=ground)
    return replace(recording, contacts=footing)


def where_fitted(some: Sequence[Recording], others: Sequence[Recording]) -> list[Recording]:
    """Some where they are to fit, and others where they are not."""
    return [one if one.role == "fit" else other for one, other in zip(some, others, strict=True)]


@pytest.fixture(scope="module")
def laboratory(tmp_path_factory: pytest.TempPathFactory) -> Laboratory:
    return Laboratory(tmp_path_factory.mktemp("trying"))


def test_what_all_recordings_show_is_added(laboratory: Laboratory) -> None:
    skin = named(laboratory.skin, 3.0, 0.0, 0.0)
    tried = laboratory.tried(laboratory.moved, skin)
    assert tried.added == [skin]
    assert not tried.refused | tried.early


def test_what_only_the_recording_to_fit_shows_is_not(laboratory: Laboratory) -> None:
    one = where_fitted(laboratory.moved, laboratory.bare)
    tried = laboratory.tried(one, named(laboratory.skin, 3.0, 0.0, 0.0))
    assert tried.added == []
    assert tried.early == {laboratory.skin.key}
    assert not tried.fit.effects


def test_of_several_only_what_does_harm_is_left_out(laboratory: Laboratory, tmp_path: Path) -> None:
    skin = named(laboratory.skin, 3.0, 0.0, 0.0)
    apart = named(laboratory.of("marker_offset", "LWRA"), 0.0, 2.0, 0.0)
    both, one = (laboratory.with_(tmp_path, *found) for found in ((skin, apart), (apart,)))
    tried = laboratory.tried(where_fitted(both, one), skin, apart)
    assert tried.added == [apart]
    assert tried.early == {laboratory.skin.key}


def test_a_load_that_other_recordings_do_not_show_is_left_out_by_itself(laboratory: Laboratory) -> None:
    """The motion stays as it was estimated."""
    skin = named(laboratory.skin, 3.0, 0.0, 0.0)
    gain = named(laboratory.of("plate_gain", "plate_1"), GAIN)
    recordings = where_fitted([_stronger(r) for r in laboratory.moved], laboratory.moved)
    tried, alone = laboratory.tried(recordings, skin, gain), laboratory.tried(recordings, skin)
    assert tried.added == [skin]
    assert tried.early == {gain.effect.candidate.key}
    for one, other in zip(tried.fit.tracked, alone.fit.tracked, strict=True):
        np.testing.assert_allclose(one.q, other.q, atol=1e-6)


def test_what_shares_the_forces_with_a_new_load_is_not_blamed_on_the_motion(laboratory: Laboratory) -> None:
    """A bias stood for part of what a gain does, and is another one beside it."""
    skin = named(laboratory.skin, 3.0, 0.0, 0.0)
    gain = named(laboratory.of("plate_gain", "plate_1"), GAIN)
    bias = laboratory.of("plate_bias", "plate_1")
    recordings = [_stronger(r) for r in laboratory.moved]
    known = [Estimate(bias, np.zeros(len(bias.columns)))]
    assert laboratory.tried(recordings, skin, gain, known=known).added == [skin, gain]
