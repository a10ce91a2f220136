"""Results as tables for people who work with pandas, in notebooks and beyond."""

from __future__ import annotations

import dataclasses
from html import escape
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas
    import plotly.graph_objects as go


@dataclasses.dataclass(frozen=True, slots=True, repr=False)
class ResultTable:
    """Rows under columns whose names hold the units; a notebook shows it as a table.

    Examples
    --------
    >>> table = ResultTable("lengths", ("segment", "length_mm"), (("femur_r", 419.9), ("shank_r", 407.7)))
    >>> float(table.to_frame().set_index("segment")["length_mm"]["femur_r"])
    419.9
    >>> table
    lengths
    segment  length_mm
    femur_r      419.9
    shank_r      407.7
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]

    def to_frame(self) -> pandas.DataFrame:
        """Make a pandas frame of it, a row for a row."""
        import pandas  # only where it is asked for: it takes half a second

        return pandas.DataFrame(list(self.rows), columns=list(self.columns))

    def plot(self) -> go.Figure:
        """Draw it: curves over the first column where that is numbers, else bars of the first number.

        Bars have a colour for each word of the first column where there are more columns of words.
        """
        import plotly.graph_objects as go

        frame = self.to_frame()
        numbers = list(frame.select_dtypes("number").columns)
        figure = go.Figure()
        if numbers and self.columns[0] == numbers[0]:
            for name in numbers[1:]:
                figure.add_scatter(x=frame[numbers[0]], y=frame[name], name=name, mode="lines")
            figure.update_layout(title=self.title, xaxis_title=numbers[0])
        else:
            first, *others = (name for name in self.columns if name not in numbers)
            for word, rows in frame.groupby(first, sort=False) if others else ((None, frame),):
                words = rows[others or [first]].astype(str).agg(" · ".join, axis=1)
                figure.add_bar(x=rows[numbers[0]], y=words, name=word, orientation="h")
            figure.update_layout(title=self.title, xaxis_title=numbers[0], yaxis={"autorange": "reversed"})
        return figure

    def __repr__(self) -> str:
        if not self.rows:
            return f"{self.title}\nnone"
        return f"{self.title}\n{self.to_frame().to_string(index=False, float_format='{:.4g}'.format)}"

    def _repr_html_(self) -> str:
        table = self.to_frame().to_html(index=False, float_format="{:.4g}".format, border=0, na_rep="–")
        return f"<b>{escape(self.title)}</b>{table}"


@dataclasses.dataclass(frozen=True, slots=True, repr=False)
class MotionTable(ResultTable):
    """Coordinates over time; the first column is ``time_s``.

    ``trial``: the recording. ``system``: what the motion is by, such as the method of scaling.
    """

    trial: str = dataclasses.field(kw_only=True)
    system: str = dataclasses.field(kw_only=True)
