"""What the report of one person is made from: the documents that were written, and the curves behind them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from scaling_service.capabilities.scaling.comparison.verdict_evidence import Verdict
from scaling_service.documents.results import ComparisonDocument
from scaling_service.model.results import Array
from scaling_service.numerics.statistics.waveform_clusters import CurveTest
from scaling_service.report.scene import Scene


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """One quantity of one trial, by each method.

    Parameters
    ----------
    name, trial : str
    held_out : bool
    x : (n,)
        s
    values : mapping
        Method to (n,), mm or degrees; NaN where it is not known.
    """

    name: str
    trial: str
    held_out: bool
    x: Array
    values: Mapping[str, Array]


@dataclass(frozen=True, slots=True, eq=False)
class CycleCurves:
    """A joint angle over the gait cycle, by each method.

    Parameters
    ----------
    name : str
    mean, sd : mapping
        Method to (n_nodes,), degrees, over the cycles; 0 to 100 % of the cycle.
    n_cycles : int
    anova : CurveTest, optional
        Between the methods over these cycles; None where it could not be computed.
    pairs : mapping
        Method to its test against ``reference``; empty unless ``anova`` is significant.
    """

    name: str
    mean: Mapping[str, Array]
    sd: Mapping[str, Array]
    n_cycles: int
    anova: CurveTest | None = None
    pairs: Mapping[str, CurveTest] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class Gait:
    """Joint angles over the gait cycles of one person.

    Parameters
    ----------
    curves : tuple of CycleCurves
    reference : str
        The method that the others are tested against.
    trials : tuple of str
        Where the cycles are from.
    held_out : bool
        Whether none of these trials was fitted.
    reason : str
        Why there are no curves; empty where there are.
    """

    curves: tuple[CycleCurves, ...] = ()
    reference: str = ""
    trials: tuple[str, ...] = ()
    held_out: bool = True
    reason: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class SubjectData:
    """Everything that a report of one person shows.

    Parameters
    ----------
    document : ComparisonDocument
        Every number in a table is from here.
    verdict : Verdict
    titles : mapping
        Method to what it fits, in plain words.
    imaged_lengths : tuple of str
        Segment lengths between imaged joint centres.
    reference : str, optional
        The method whose lengths and joint centres are the image's.
    scene : Scene, optional
        The overlay; None where nothing was followed.
    errors : tuple of Curves
        Mean distance over markers, mm, of each trial.
    angles : tuple of Curves
        Joint angles, degrees, of one trial.
    gait : Gait
    """

    document: ComparisonDocument
    verdict: Verdict
    titles: Mapping[str, str]
    imaged_lengths: tuple[str, ...] = ()
    reference: str | None = None
    scene: Scene | None = None
    errors: tuple[Curves, ...] = ()
    angles: tuple[Curves, ...] = ()
    gait: Gait = field(default_factory=Gait)
