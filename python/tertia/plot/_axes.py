"""What the pictures share: colours, angles that wrap, numbers as text, new axes."""

import math
from typing import TYPE_CHECKING

import numpy as np

from tertia._arrays import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

KEPT, FLAGGED = "#56B4E9", "#D55E00"
RESULT, BAND = "#000000", "#009E73"
# share of the height that is kept free for the legend
_HEADROOM = 0.2


def new_figure(width: float, height: float) -> "Figure":
    """Return an empty figure of pyplot, so that `pyplot.show` shows it."""
    try:
        from matplotlib import pyplot as plt  # noqa: PLC0415  # only here is Matplotlib needed
    except ImportError as error:
        raise ImportError("tertia.plot needs Matplotlib: pip install 'tertia[plot]'") from error
    return plt.figure(figsize=(width, height), layout="constrained")


def new_axes() -> "Axes":
    """Return the axes of a new figure."""
    return new_figure(8, 4.5).subplots()


def add_legend(ax: "Axes") -> None:
    """Draw a legend in a space of its own above what is drawn."""
    low, high = ax.get_ylim()
    ax.set_ylim(low, high + _HEADROOM * (high - low))
    ax.legend(loc="upper center", ncols=3, fontsize="small")


def near(angles: FloatArray, origin: float | FloatArray, period: float | None) -> FloatArray:
    """Turn angles by whole periods to within half a period of the origin."""
    if period is None:
        return angles
    turned: FloatArray = angles - period * np.round((angles - origin) / period)
    return turned


def angle_unit(period: float | None) -> str:
    """Return the unit to which a period belongs, as it follows the name of an axis."""
    units = {360.0: " (°)", 2 * math.pi: " (rad)"}
    return units.get(period or 0.0, "")


def wrapped_label(angle: float, period: float) -> str:
    """Return an angle in [0, period) as text."""
    # rounded first: -1e-16 is 0, not 360
    return f"{round(angle, 9) % period:.10g}"


def rounded(value: float, sigma: float) -> tuple[str, str]:
    """Return both as text, to two significant digits of sigma."""
    if sigma < 1e-9:
        return f"{value:.9g}", f"{sigma:.2g}"
    # rounded first: 0.0996 is 0.10, not 0.100
    decimals = max(0, 1 - math.floor(math.log10(float(f"{sigma:.1e}"))))
    return f"{value:.{decimals}f}", f"{sigma:.{decimals}f}"
