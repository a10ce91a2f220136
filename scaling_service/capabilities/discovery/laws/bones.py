"""What is known of bones beside the effects, as the model takes it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from scaling_service.model import body


@dataclass(frozen=True, slots=True, eq=False)
class BoneKnowledge:
    """What is known of bones, and added to the model beside the effects."""

    # Marker to what its skin slides along the axes of the segment with flexion, m, beside its place
    skin: dict[str, tuple[body.Law, body.Law, body.Law]] = field(default_factory=dict)
    expectations: tuple[body.Expectation, ...] = ()
    notes: tuple[str, ...] = ()

    def add_to(self, model: body.BodyModel) -> body.BodyModel:
        """A model with it."""
        markers = []
        for marker in model.markers:
            pairs = zip(
                marker.laws, self.skin.get(marker.name, (body.Law(), body.Law(), body.Law())), strict=True
            )
            x, y, z = (law + more for law, more in pairs)
            markers.append(replace(marker, laws=(x, y, z)))
        return replace(model, markers=tuple(markers), expectations=self.expectations)
