"""The names that requests and results use: models, markers, methods, bones."""

from __future__ import annotations

from functools import cache

from scaling_service.bones.whole import BONES
from scaling_service.capabilities.scaling.methods.table import METHODS
from scaling_service.documents.service import CoordinateWord, MarkerWord, MethodWord, ModelWord, Vocabulary
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import BUILTIN_NAMES, builtin

_FEET = {"calcn_r", "calcn_l"}
"""Segments that the ground's forces act on."""


@cache
def vocabulary() -> Vocabulary:
    """All names that come with the product.

    Examples
    --------
    >>> [method.name for method in vocabulary().methods]
    ['MB', 'MB_lam', 'MB_am', 'EB', 'EB_am']
    """
    return Vocabulary(
        models=[_model(builtin(name)) for name in BUILTIN_NAMES],
        methods=[
            MethodWord(name=name, meaning=m.title, starts_from=m.needs, needs_images=m.needs_images)
            for name, m in METHODS.items()
        ],
        bones=list(BONES),
    )


def _model(model: BodyModel) -> ModelWord:
    return ModelWord(
        name=model.name,
        segments=list(model.segment_names),
        markers=[
            MarkerWord(name=m.name, segment=m.segment, anatomical=m.anatomical)
            for m in model.markers
            if m.weight > 0.0
        ],
        coordinates=[
            CoordinateWord(name=c.name, unit="deg" if c.kind == "rotation" else "m")
            for c in model.coordinates
        ],
        feet=set(model.segment_names) >= _FEET,
    )
