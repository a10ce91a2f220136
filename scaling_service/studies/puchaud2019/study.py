"""The study of Puchaud et al. 2019 on virtual persons: who they are, and how this differs from the paper.

Tables are compared in ``puchaud2019_tables``, claims in ``puchaud2019_claims``.
"""

from __future__ import annotations

SUBJECTS = 26
"""Puchaud 2019, section 2.1."""

WALKERS = 6
"""Of them, those whose gait was recorded (section 2.1)."""

_PERSONS = 1000  # chosen: cohorts of different seeds share nobody

DIFFERENCES = (
    "The persons are virtual. Their statures, bone lengths and knee axes are drawn from the paper's own "
    "means and scatter; palpation, skin movement and images have the sizes that the literature gives. None "
    "was adjusted until a table fitted.",
    "The paper does not print its generic model. The built-in one has the mean proportions of the paper's "
    "subjects, and its markers sit where these persons have them on average: MB then errs less than in the "
    "paper, and differences in lengths are too small to be found. --generic custom starts from the legs of "
    "the published toolbox instead, whose markers sit elsewhere: the methods then differ far more.",
    "All persons walk here. Six subjects, averaged over their strides, are too few for a test by permutation "
    "to decide any pair of models; the paper counted twelve cycles of six subjects as twelve observations.",
    "The paper takes EB for the truth, but an image has errors, too. Here the truth is known, and each "
    "model's distance from it is shown beside.",
)
"""How this study is not the paper's, in plain English."""


def person_seeds(seed: int, count: int = SUBJECTS) -> tuple[int, ...]:
    """The seeds of a cohort's persons.

    Examples
    --------
    >>> person_seeds(0, 3)
    (1, 2, 3)
    """
    return tuple(_PERSONS * seed + k for k in range(1, count + 1))
