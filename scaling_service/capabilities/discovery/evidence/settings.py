"""How strict the search is: every threshold by which it decides, in one place.

What an effect or a disturbance asks of itself stands in its own file; iterations, filters and memory stand
beside the computation that needs them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

IDENTIFIABLE = 1e-3
"""Share of a direction's square below which the pose or a nuisance is taken to hide it (chosen: at 1e-3 a
change of 10 mm shows as 0.3 mm, no more than the model's curvature leaves)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DiscoverySettings:
    """How strict the search is.

    Parameters
    ----------
    level : float
        Family-wise: of naming anything where nothing is.
    block_s : float
        Length of the blocks of time that count as independent, s.
    most : int
        Effects to name at most, of markers and of forces each.
    shortlist : int
        Candidates that are compared with each other.
    most_masked : int
        Markers at most that are left out because they move independently.
    """

    level: float = 0.05
    block_s: float = 0.5
    most: int = 8
    shortlist: int = 30
    most_masked: int = 3
    # a coordinate that spreads less drives nothing that could be told from a constant (chosen: 2 degrees)
    moving_rad: float = math.radians(2.0)

    # Selection

    companions: int = 3  # named along with the best effect of the motion at most (chosen)
    # of what a companion explains, what it must explain beside the others (chosen)
    companion_beside: float = 0.5
    # of what the best explains, what a companion must (chosen: what the law of a large effect misses, being
    # one of small effects, is less: of 12 degrees 1 %)
    companion_worth: float = 0.1
    # of what an effect in the first trial and not in others explains, what it must explain in these and not
    # in the first so that it is the same said the other way round (chosen)
    reversed_share: float = 0.95
    # chance of so large a lead above which two candidates are in one equivalence class (chosen: the custom)
    equivalence_level: float = 0.05
    # share of the gain that a coefficient other than the natural one must add to be believed (chosen)
    natural_lead: float = 0.02
    power: float = 0.9  # of naming an effect of the smallest size that is called nameable
    # whitened square that a movement must leave to tell effects apart (chosen: five standard deviations of
    # one number)
    separating_square: float = 25.0
    separating_block_s: float = 1.0  # blocks of that movement, s
    separating_nearest: int = 6  # others looked at (chosen: the rest are further off)

    # share of what the forces disagree by from which an effect is taken to be all of its cause (chosen: where
    # the model is right but for one thing, that thing leaves no more than this)
    whole_cause: float = 0.8
    # Of what a wrong mass leaves: what another cause of as much weight may leave; what must stand above the
    # noise for one to be looked for; and what one leaves at most that is not told from the mass (chosen: of a
    # load's weight the mass knows the size, and not the place; a right mass leaves noise)
    mass_left: float = 0.5
    mass_stands: float = 0.5
    mass_alike: float = 1.2

    # share of what stands above the noise that an oscillation must explain at a frequency beside its own to
    # be tuned before it is tested (chosen: a grid's neighbour explains half or more)
    oscillation_main: float = 0.5

    # Testing

    # share of what an effect promised to explain that it must explain when everything is estimated anew with
    # it (chosen: the promise is that of a small change; a law that is only right for small ones keeps little)
    kept_promise: float = 0.3

    # Elimination

    # of the misfit: what may be left without the answer to a question that others answer as well (chosen:
    # about what a round of estimating leaves)
    as_good: float = 1.05
    # of what an effect explains at its place: when the movement or the time predicts more than this of what
    # is left there, the name does not fit (chosen: a law that is right leaves nothing to predict)
    predictable_share: float = 0.3
    # mean square above the floor, in floors, up to which markers count as tracked down to their noise
    # (chosen: markers at 1.2 times their noise)
    tracked_excess: float = 0.5
    # share of the forces' mean square above their floor that their effects may leave (chosen: most that are
    # right leave 0.02, trunks that oscillate 0.19, crosstalk that is taken for a turned plate 0.21)
    wrench_left: float = 0.2
    # mean square above the floor, in floors, that the estimate of the floor itself may miss (chosen)
    wrench_slight: float = 0.5
    # share of the markers' mean square above their noise that effects of the motion must take together
    # (chosen: skin's laws in one angle take a fifth of what real skin does, and more with several of them)
    negligible: float = 0.15
    # vague, vague_share: probability of being the one of its class below which an effect is not told apart,
    # and the share that must be taken where none of them is (chosen: one of ten anywhere in the body that
    # leaves most of what is wrong says nothing)
    vague: float = 0.2
    vague_share: float = 0.6

    # Unmodelled disturbances

    # how much more a free course of one marker must explain than a law (chosen: a law that is right explains
    # all but noise, and the free course takes that too)
    free_marker_lead: float = 1.3
    # how much more an unmodelled disturbance must explain than any effect (chosen: beside one that is there
    # it explains the same at most, having a few numbers more)
    disturbance_lead: float = 1.15
    # share of what a motion or a force of any course explains that a disturbance must explain: such a course
    # follows every law (chosen: what is left to it is what the law's few numbers miss)
    free_course_share: float = 0.8
    # share of what stands above the noise that a disturbance must explain (chosen: the search stops there, so
    # it must be most of what is wrong; where much else is, a few numbers more explain more than the right
    # effect)
    disturbance_main: float = 0.25
    # effects_leave, disturbance_leaves: of what stands above the noise, what the effects must leave, and of
    # that, what the disturbance may leave (chosen: an effect that is there leaves nothing; where one explains
    # most, no law could explain clearly more)
    effects_leave: float = 0.05
    disturbance_leaves: float = 0.25

    # Summary

    unexplained_level: float = 0.05  # family-wise, over all places
    # RMS over floor from which what is left is reported (chosen: a third of its squares is predicted)
    unexplained_ratio: float = 1.25
    law_terms: int = 3  # of a description of what is left (chosen: a law of more is no longer simple)
    # of the variance: what a further term must explain, on the half that did not fit it (chosen)
    law_gain: float = 0.05
    # share of a residual's variance that a coordinate explains, from which it is reported (chosen)
    correlated_share: float = 0.3
    # single columns that the black-box bound is made of (chosen: far more than effects have numbers)
    black_box_columns: int = 60
