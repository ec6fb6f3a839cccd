"""Common parts of pictures: colours, legends, time axes, bands, ellipses, maps and texts."""

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from tertia._arrays import BoolArray, FloatArray, samples
from tertia._arrays import probability as _share

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, FigureBase

Times: TypeAlias = npt.NDArray[Any]
Adjustable: TypeAlias = Literal["box", "datalim"]

KEPT, FLAGGED = "#56B4E9", "#D55E00"
RESULT, BAND = "#000000", "#009E73"
# axes extend to this multiple of the largest deviation
MARGIN = 1.15
GAP = np.full((1, 2), np.nan)
# share of the height that is kept free for the legend
_HEADROOM = 0.2
_ELLIPSE_POINTS = 181
# rounding may leave a correlation above 1 by this much
_ROUNDING = 1e-12
# for sensors; vermilion is for outliers, green for bands
_COLOURS = ("#0072B2", "#E69F00", "#CC79A7", "#56B4E9")
_MARKERS = ("o", "s", "D", "^", "v", "P", "*")
_LINES = ("-", "-.", ":")


def new_figure(width: float, height: float) -> "Figure":
    """Return an empty pyplot figure, so that `pyplot.show` shows it."""
    try:
        from matplotlib import pyplot as plt  # noqa: PLC0415  # only here is Matplotlib needed
    except ImportError as error:
        raise ImportError("tertia.plot needs Matplotlib: pip install 'tertia[plot]'") from error
    return plt.figure(figsize=(width, height), layout="constrained")


def new_axes() -> "Axes":
    """Return the axes of a new figure."""
    return new_figure(8, 4.5).subplots()


def add_legend(ax: "Axes") -> None:
    """Draw a legend above the axes."""
    low, high = ax.get_ylim()
    ax.set_ylim(low, high + _HEADROOM * (high - low))
    ax.legend(loc="upper center", ncols=3, fontsize="small")


def add_shared_legend(figure: "FigureBase", panels: "Iterable[Axes]", columns: int) -> None:
    """Draw a common legend below several panels."""
    named: dict[str, Any] = {}
    for ax in panels:
        handles, labels = ax.get_legend_handles_labels()
        named |= dict(zip(labels, handles, strict=True))
    entries = list(named.values()), list(named)
    figure.legend(*entries, loc="outside lower center", ncols=columns, fontsize="small")


def draw_band(
    ax: "Axes", x: Times, low: npt.ArrayLike, high: npt.ArrayLike, label: str, **looks: Any
) -> None:
    """Fill the space between two curves."""
    style: dict[str, Any] = {"facecolor": BAND, "edgecolor": "none", "alpha": 0.3, **looks}
    ax.fill_between(x, low, high, label=label, **style)


def bounds(value: FloatArray, half: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return `value` minus `half`, and `value` plus `half`; nan if `value` or `half` is unknown."""
    known = np.isfinite(value) & np.isfinite(half)
    shown, width = np.where(known, value, np.nan), np.where(known, half, np.nan)
    return shown - width, shown + width


def sensor_looks(k: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the styles of the line and of the markers of a sensor."""
    colour = {"color": _COLOURS[k % len(_COLOURS)]}
    line = _LINES[k // len(_COLOURS) % len(_LINES)]
    marker = _MARKERS[k % len(_MARKERS)]
    return colour | {"linestyle": line, "drawstyle": "steps-post"}, colour | {"marker": marker}


# deviations of sensors


def largest(*arrays: FloatArray) -> float:
    """Return the largest finite absolute value; 1 if there is none."""
    return max(float(np.max(np.abs(a[np.isfinite(a)]), initial=0.0)) for a in arrays) or 1.0


def draw_deviations(
    ax: "Axes",
    times: Times,
    deviations: FloatArray,
    outlier: BoolArray,
    names: list[str],
    *,
    inner: float,
) -> None:
    """Draw deviations, (K, steps), and mark outliers; the axis extends from -`inner` to `inner`."""
    shown = np.clip(deviations, -inner, inner)
    for k, name in enumerate(names):
        has = np.isfinite(deviations[k])
        looks = sensor_looks(k)[1]
        ax.plot(times[has], shown[k, has], linestyle="", label=name, markersize=4, **looks)
    flagged = outlier & np.isfinite(deviations)
    far = np.abs(deviations) > inner
    where = np.broadcast_to(times, deviations.shape)
    for marker, chosen, label in [
        ("x", flagged & ~far, "outlier"),
        ("^", flagged & far & (deviations > 0), "outlier, above"),
        ("v", flagged & far & (deviations < 0), "outlier, below"),
    ]:
        if np.any(chosen):
            looks = {"color": FLAGGED, "markersize": 8, "zorder": 3, "label": label}
            ax.plot(where[chosen], shown[chosen], marker, **looks)


# time


def time_axis(time: npt.ArrayLike | None, count: int) -> Times:
    """Return the times for the axis: the given times or, by default, numbers from 0."""
    if time is None:
        return np.arange(count)
    times = np.asarray(time)
    if times.dtype.kind != "M":
        times = samples(time, "time")
    if times.shape != (count,):
        raise ValueError(f"time has shape {times.shape}; it must be ({count},)")
    return times


def label_time(ax: "Axes", times: Times, label: str) -> None:
    """Label the time axis, and use a short format for dates."""
    from matplotlib.dates import ConciseDateFormatter  # noqa: PLC0415  # slow to import

    ax.set_xlabel(label)
    if times.dtype.kind == "M":
        locator = ax.xaxis.get_major_locator()
        ax.xaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]


# from above


def view_from_above(ax: "Axes", unit: str = "m", *, adjustable: Adjustable = "datalim") -> None:
    """Label the axes east and north, and give them equal scales."""
    ax.set(xlabel=f"east ({unit})", ylabel=f"north ({unit})")
    ax.set_aspect("equal", adjustable=adjustable)


def draw_sites(ax: "Axes", paths: Iterable[FloatArray], label: str) -> None:
    """Draw sensors as triangles; a moving sensor is drawn at the end of its path, (n, 2)."""
    for k, path in enumerate(paths):
        ax.plot(
            *path.T,
            color=RESULT,
            linestyle="-" if len(path) > 1 else "",
            linewidth=0.5,
            marker="^",
            markerfacecolor="none",
            markevery=[-1],
            zorder=3,
            # an underscore hides it from the legend
            label=f"_{label}" if k else label,
        )


def add_names(
    ax: "Axes", names: Iterable[Any], places: FloatArray, shift: tuple[float, float] = (5, 5)
) -> None:
    """Write names beside positions; where the name is None, nothing is written."""
    for name, place in zip(names, places, strict=True):
        if name is not None:
            ax.annotate(str(name), tuple(place[:2]), xytext=shift, textcoords="offset points")


def names_of(sensors: Any, count: int) -> list[Any]:
    """Return the names of sensors; None for sensors that are given as positions."""
    names = [getattr(one, "name", None) for one in sensors] if isinstance(sensors, Sequence) else []
    return names if len(names) == count else [None] * count


def ellipse_radius(probability: float) -> float:
    """Return the radius, in standard deviations, of an ellipse with the given probability."""
    return math.sqrt(-2 * math.log1p(-_share(probability, "probability")))


def ellipse(centre: FloatArray, covariance: FloatArray, radius: float, name: str) -> FloatArray:
    """Return the points of the centre, a gap and the ellipse as one array, (n, 2)."""
    variances = np.diagonal(covariance)
    if not np.all(variances > 0):
        raise ValueError(f"{name} has a variance that is not positive in the components drawn")
    sigma = np.sqrt(variances)
    correlation = covariance[0, 1] / sigma[0] / sigma[1]
    if abs(correlation) > 1 + _ROUNDING:
        raise ValueError(f"{name} is indefinite in the components drawn")
    # not by eigenvectors: the components may be of very different size
    other = math.sqrt(max(0.0, 1 - correlation**2))
    angle = np.linspace(0, 2 * np.pi, _ELLIPSE_POINTS)
    first, second = np.cos(angle), np.sin(angle)
    unit = np.column_stack([first, correlation * first + other * second])
    return np.vstack([centre, GAP, centre + radius * sigma * unit])


def ellipses(
    position: FloatArray, covariance: FloatArray, radius: float, rows: npt.ArrayLike, name: str
) -> FloatArray:
    """Return the error ellipses of some rows as one line with gaps, without their centres."""
    lines = [GAP]
    for row in np.asarray(rows, dtype=np.int64):
        line = ellipse(position[row, :2], covariance[row, :2, :2], radius, f"{name}[{row}]")
        lines += [line[2:], GAP]
    return np.vstack(lines)


# angles and texts


def near(angles: FloatArray, origin: float | FloatArray, period: float | None) -> FloatArray:
    """Shift angles by whole periods, so that they are within half a period of the origin."""
    if period is None:
        return angles
    turned: FloatArray = angles - period * np.round((angles - origin) / period)
    return turned


def angle_unit(period: float | None) -> str:
    """Return the unit of angles with this period, as a suffix for axis labels."""
    units = {360.0: " (°)", 2 * math.pi: " (rad)"}
    return units.get(period or 0.0, "")


def wrapped_label(angle: float, period: float) -> str:
    """Return an angle in [0, period) as text."""
    # rounded first: -1e-16 is 0, not 360
    return f"{round(angle, 9) % period:.10g}"


def rounded(value: float, sigma: float) -> tuple[str, str]:
    """Return a value and its sigma as text, both rounded to two significant digits of sigma."""
    if sigma < 1e-9 or math.isinf(sigma):
        return f"{value:.9g}", f"{sigma:.2g}"
    # rounded first: 0.0996 is 0.10, not 0.100
    decimals = max(0, 1 - math.floor(math.log10(float(f"{sigma:.1e}"))))
    return f"{value:.{decimals}f}", f"{sigma:.{decimals}f}"


def with_sigmas(values: Iterable[float], sigmas: Iterable[float]) -> str:
    """Return values with their standard deviations as text."""
    return ", ".join(" ± ".join(rounded(x, s)) for x, s in zip(values, sigmas, strict=True))
