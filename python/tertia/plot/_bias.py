"""Pictures of systematic errors."""

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tertia._arrays import instance, radians
from tertia.plot._axes import KEPT, RESULT, add_legend, draw_band, new_axes
from tertia.sensors import Bias

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_POINTS = 361


def bias(
    result: Bias,
    *,
    azimuth: npt.ArrayLike | None = None,
    residual: npt.ArrayLike | None = None,
    ax: "Axes | None" = None,
    legend: bool = True,
) -> "Axes":
    """Draw the azimuth bias of one sensor against the azimuth, with a band of two sigmas.

    Parameters
    ----------
    result : Bias
        Bias of one sensor, as returned by `tertia.registration.calibrate`.
    azimuth, residual : array_like of shape (N,), optional
        Azimuths in radians, and the measured minus the true azimuths in radians; they are drawn as
        points.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; by default the axes of a new figure.
    legend : bool
        Whether to draw a legend.

    Returns
    -------
    matplotlib.axes.Axes
        The axes. They show the bias against the azimuth, both in degrees.

    Raises
    ------
    ValueError
        If `result` has the biases of several sensors, or `azimuth` and `residual` have different
        shapes.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> from tertia import plot
    >>> from tertia.sensors import Bias
    >>> plot.bias(Bias(azimuth_sigma=0.01), ax=Figure().subplots()).get_ylabel()
    'azimuth bias, degrees'
    """
    instance(result, "result", Bias)
    if (azimuth is None) != (residual is None):
        raise ValueError("azimuth and residual belong together; give both or neither")
    ax = new_axes() if ax is None else ax
    direction = np.linspace(0.0, 2 * np.pi, _POINTS)
    value, sigma = result.at(direction)
    degrees, middle, half = np.degrees(direction), np.degrees(value), 2 * np.degrees(sigma)
    draw_band(ax, degrees, middle - half, middle + half, "two sigma", alpha=0.2)
    ax.plot(degrees, middle, color=RESULT, label="bias")
    if azimuth is not None and residual is not None:
        at, off = radians(azimuth, "azimuth"), radians(residual, "residual")
        if at.shape != off.shape:
            raise ValueError(f"azimuth has shape {at.shape}, residual {off.shape}; they must agree")
        turned = (off + np.pi) % (2 * np.pi) - np.pi
        ax.plot(np.degrees(at) % 360.0, np.degrees(turned), ".", color=KEPT, label="measured")
    ax.set(xlabel="azimuth, degrees", ylabel="azimuth bias, degrees", xlim=(0.0, 360.0))
    if legend:
        add_legend(ax)
    return ax
