"""Literal texts in figures: names of robots may contain characters that a plotting library takes for
formulas."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def literal(drawn: Figure) -> None:
    """Shows all texts of a figure literally, names with dollars included; labels of logarithmic axes keep
    their powers."""
    from matplotlib.text import Text
    from matplotlib.ticker import LogFormatter

    powers = {
        id(label)
        for ax in drawn.axes
        for axis in (ax.xaxis, ax.yaxis)
        if isinstance(axis.get_major_formatter(), LogFormatter)
        for label in axis.get_ticklabels(which="both")
    }
    for text in drawn.findobj(Text):
        if isinstance(text, Text) and id(text) not in powers:
            text.set_parse_math(False)
