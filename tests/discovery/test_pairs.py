"""Two effects at one marker that hide behind each other are both named."""

from __future__ import annotations

from scaling_service.capabilities.discovery.laws.apply import with_effects
from scaling_service.capabilities.discovery.search.discover import discover
from tests.discovery.hidden import person, recorded, sized


def test_skin_that_takes_a_marker_back_does_not_make_it_go_its_own_way() -> None:
    """Where the knee bends the marker is nearly where the model has it; elsewhere it is not."""
    offset = sized("marker_offset", "RFH", numbers=(10.0, 14.0, 4.0))
    artefact = sized("soft_tissue_artefact", "RFH", driver="knee_angle_r", numbers=(-0.25, -0.35, -0.1))
    truth = with_effects(person().model, [offset, artefact], "")
    result = discover(person().model, recorded(person(), truth))
    names = {n.effect.candidate.name for n in result.findings.named}
    assert names == {offset.candidate.name, artefact.candidate.name}
    assert not result.findings.unexplained
