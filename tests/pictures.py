"""What is seen in a picture."""

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.lines import Line2D


def line(ax: Axes, label: str) -> npt.NDArray[np.float64]:
    """Return the points of the line with this label, shape (n, 2)."""
    (found,) = (a for a in ax.get_lines() if a.get_label() == label)
    assert isinstance(found, Line2D)
    return np.asarray(found.get_xydata(), dtype=np.float64)


def lines_of(ax: Axes, label: str) -> list[npt.NDArray[np.float64]]:
    return [np.asarray(a.get_xydata()) for a in ax.get_lines() if a.get_label() == label]


def labels(ax: Axes) -> list[str]:
    legend = ax.get_legend()
    assert legend is not None
    return sorted(text.get_text() for text in legend.get_texts())


def legend_of(ax: Axes) -> list[str]:
    (legend,) = ax.figure.legends
    return [text.get_text() for text in legend.get_texts()]
