"""Every segment's size as one weighted estimate: measured distances, and anthropometry as prior.

In logarithms the person's size over the model's is Gaussian beforehand (what persons of this sex, stature and
mass are like, ``anthropometry``), and every measured distance is that size with an
error. The posterior weighs both, and what one segment says of another: a leg that was not marked follows the
marked one as far as legs resemble each other.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from scaling_service.capabilities.scaling.sizes.measured import Ratios
from scaling_service.model.anatomy.anthropometry import DimensionPrior, predict_dimensions
from scaling_service.model.anatomy.centres import size_sd
from scaling_service.model.anatomy.lengths import segment_lengths
from scaling_service.model.body import GROUND, BodyModel
from scaling_service.model.results import SegmentSize
from scaling_service.model.subject import Subject
from scaling_service.numerics.multibody.laws import Array

_WORDS: Mapping[str, str] = MappingProxyType(
    {
        "inter_hip": "pelvis sacrum",
        "femur": "femur thigh patella",
        "shank": "tibia shank fibula",
        "foot": "talus calcn calcaneus foot midfoot toes",
        "trunk": "torso trunk thorax abdomen lumbar spine rib ribs",
        "head_length": "head skull neck cervical",
        "upper_arm": "humerus upperarm arm scapula clavicle clavicula",
        "forearm": "ulna radius forearm lunate",
        "hand": "hand fingers",
    }
)
"""Dimension, and the words in a segment's name that say that its size follows it."""

_DIMENSION_OF: Mapping[str, str] = MappingProxyType(
    {word: dimension for dimension, words in _WORDS.items() for word in words.split()}
)
DECLARED_SD: Mapping[str, float] = MappingProxyType({"stature": 0.02, "mass": 0.05})
"""Relative standard deviation of what files declare. Mass is often 2 to 5 % off (shoes, clothes, an older
value); stature, chosen: shoes, and a child grows by 4 % in a year."""

_PRIOR_NAMES: Mapping[str, str] = MappingProxyType({"asis_width": "pelvis_width"})
"""Sizes measured by hand that anthropometry has under another name."""

_MIDLINE = frozenset({"inter_hip", "trunk", "head_length"})
_NO_PERSONS = 0.5
"""Chosen: logarithm of a model's length over an adult's beyond which it is defined otherwise."""

_EXACT = 1e-4
"""Chosen: relative standard deviation of a model's own length, which is known but must not be zero."""


def dimension_of(segment: str) -> str | None:
    """The person's dimension that a segment's size follows, None where its name says nothing.

    Examples
    --------
    >>> dimension_of("tibia_r"), dimension_of("l_humerus"), dimension_of("lumbar3"), dimension_of("crate")
    ('shank_r', 'upper_arm_l', 'trunk', None)
    """
    words = re.findall(r"[a-z]+", re.sub(r"(?<=[a-z])(?=[A-Z])", "_", segment).lower())
    dimension = next(
        (_DIMENSION_OF[w] for word in words for w in (word, word.removesuffix("s")) if w in _DIMENSION_OF),
        None,
    )
    if "trunk" in words:
        dimension = "trunk"
    if dimension is None or dimension in _MIDLINE:
        return dimension
    left = any(word in ("l", "left") for word in words)
    return f"{dimension}_{'l' if left else 'r'}"


def expect_dimensions(subject: Subject) -> DimensionPrior:
    """What is known of a person's dimensions before markers are looked at: declared and measured by hand."""
    blank = predict_dimensions(sex=None, height_m=None, mass_kg=None).names
    sizes = {
        _PRIOR_NAMES.get(name, name): (value, size_sd(name, value)) for name, value in subject.sizes_m.items()
    }
    return predict_dimensions(
        sex=subject.sex,
        height_m=subject.height_m,
        mass_kg=subject.mass_kg,
        sizes={name: size for name, size in sizes.items() if name in blank},
        stated_sd=DECLARED_SD,
    )


def estimate_sizes(
    model: BodyModel, ratios: Ratios, prior: DimensionPrior, *, weighted: bool = True
) -> dict[str, SegmentSize]:
    """The size of every segment over the model's, with its standard deviation and what it rests on.

    Parameters
    ----------
    model : BodyModel
        The generic model.
    ratios : Ratios
        What was measured.
    prior : DimensionPrior
        Of the person.
    weighted : bool
        Whether prior and distances are weighed; else a measured segment takes the mean of its distances as it
        is, and the prior serves the others.

    Returns
    -------
    dict
        Segment to its size. Segments whose names say nothing take their parent's.
    """
    dimensions = {name: found for name in model.segment_names if (found := dimension_of(name)) is not None}
    names = tuple(dict.fromkeys(dimensions.values()))
    if not names:
        return {}
    expected = prior.select(names)
    ratios = ratios if weighted else ratios.averaged()
    mean = expected.mean - _own_dimensions(model, names)
    rows = [_dimension_measured(m.segments, dimensions) for m in ratios.measurements]
    pick = np.eye(len(names))[[names.index(row) for row in rows]].reshape(len(rows), len(names))
    before = expected.covariance
    noise = ratios.covariance if weighted else np.zeros_like(ratios.covariance)
    gain = np.linalg.solve(pick @ before @ pick.T + noise, pick @ before).T
    logs = mean + gain @ (ratios.logs - pick @ mean)
    kept = np.eye(len(names)) - gain @ pick
    covariance = kept @ before @ kept.T + gain @ ratios.covariance @ gain.T
    sizes = {}
    for segment, dimension in dimensions.items():
        k = names.index(dimension)
        mine = [j for j, row in enumerate(rows) if row == dimension]
        share = float(gain[k, mine].sum())
        sizes[segment] = SegmentSize(
            dimension,
            float(np.exp(logs[k])),
            float(np.sqrt(covariance[k, k])),
            share,
            float(gain[k].sum()) - share,
            bool(mine),
        )
    return _with_followers(model, sizes)


def _dimension_measured(segments: Sequence[str], dimensions: Mapping[str, str]) -> str:
    return next(dimensions[s] for s in segments if s in dimensions)


def _own_dimensions(model: BodyModel, names: Sequence[str]) -> Array:
    """Logarithms of the model's own dimensions: its lengths, the rest as of a person with these lengths."""
    blank = predict_dimensions(sex=None, height_m=None, mass_kg=None, age_years=30.0)
    lengths = {}
    for name, length in segment_lengths(model).items():
        sided = name if name in blank.names else f"{name}_r"
        if sided in blank.names and abs(np.log(length / blank.value(sided))) < _NO_PERSONS:
            lengths[sided] = (length, _EXACT * length)
    alike = blank.condition(lengths)
    return np.array([np.log(alike.value(name)) for name in names])


def _with_followers(model: BodyModel, sizes: Mapping[str, SegmentSize]) -> dict[str, SegmentSize]:
    """Segments whose names say nothing take the size of the nearest one above, else of the first."""
    found = dict(sizes)
    parents = {segment.name: segment.parent for segment in model.segments}
    for segment in model.segments:
        above = segment.name
        while above not in found and above != GROUND:
            above = parents[above]
        found.setdefault(segment.name, found.get(above) or next(iter(sizes.values())))
    return {name: found[name] for name in model.segment_names}
