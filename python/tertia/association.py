"""Association: assignment of the plots of a scan to tracks.

The gates, their sectors and the score of a plot for a track are those of Glagovskiy, Lavina,
Rudelson 2014. The default score is the usual likelihood ratio; the score printed in that paper is
available as `paper_score`. Symbols: the innovation is a plot minus its prediction, S is the
covariance of the innovation, `nis = innovation' S^-1 innovation` is the normalised innovation
squared, m is the number of components of the innovation, x is east and y is north.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import ClassVar, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import (
    FloatArray,
    IntArray,
    choice,
    common_batch,
    diagonal,
    finite,
    integer,
    place_of,
    real,
    require_each,
    samples,
    scalar_or_array,
)
from tertia._result import Result

__all__ = [
    "GUARD",
    "INNER",
    "OUTER",
    "Assignment",
    "Association",
    "Gate",
    "GateSector",
    "Pairs",
    "Score",
    "associate",
    "gate",
    "gate_sectors",
    "gate_threshold",
    "likelihood_score",
    "paper_score",
]

Gate: TypeAlias = Literal["inner", "outer", "guard"]
Assignment: TypeAlias = Literal["gnn", "nearest"]
Score: TypeAlias = Literal["likelihood", "paper"]

INNER, OUTER, GUARD = 0.65, 0.95, 0.998
_GATES: dict[str, float] = {"inner": INNER, "outer": OUTER, "guard": GUARD}
_RATIO = 100.0


class GateSector(enum.IntEnum):
    """Sector of a gate in which a plot lies; ahead and behind extend by 45 degrees to each side."""

    INNER = 0
    AHEAD = 1
    BEHIND = 2
    LEFT = 3
    RIGHT = 4
    GUARD_AHEAD = 5
    GUARD_BEHIND = 6
    GUARD_LEFT = 7
    GUARD_RIGHT = 8
    OUTSIDE = 9


@dataclass(frozen=True, slots=True, eq=False)
class Pairs(Result):
    """Plots within the gates of tracks, sorted by track and then by plot.

    Attributes
    ----------
    track : ndarray of int, shape (P,)
        Index of the track.
    plot : ndarray of int, shape (P,)
        Index of the plot.
    nis : ndarray of shape (P,)
        Normalised innovation squared.
    log_determinant : ndarray of shape (P,)
        `ln |S|`, where S is the covariance of the innovation.
    """

    _rows: ClassVar = "track", 0

    track: IntArray
    plot: IntArray
    nis: FloatArray
    log_determinant: FloatArray

    def __len__(self) -> int:
        """Return the number of pairs."""
        return len(self.track)

    def __repr__(self) -> str:
        """Return the number of pairs, as text."""
        return f"Pairs({len(self)})"


@dataclass(frozen=True, slots=True, eq=False)
class Association(Result):
    """An assignment: the plot of each track, and the track of each plot.

    Attributes
    ----------
    track_of_plot : ndarray of int, shape (N,)
        Index of the track assigned to each plot; -1 if there is none.
    plot_of_track : ndarray of int, shape (T,)
        Index of the plot assigned to each track; -1 if there is none.
    score : ndarray of shape (T,)
        Score of the plot that is assigned to each track; nan if the track has no plot.
    nis : ndarray of shape (T,)
        Normalised innovation squared of the plot that is assigned to each track; nan if the track
        has no plot.
    """

    _rows: ClassVar = "track_of_plot", 0
    _omitted: ClassVar = ("plot_of_track", "score")

    track_of_plot: IntArray
    plot_of_track: IntArray
    score: FloatArray
    nis: FloatArray

    def __repr__(self) -> str:
        """Return the number of tracks with a plot, as text."""
        found = np.count_nonzero(self.plot_of_track >= 0)
        tracks, plots = len(self.plot_of_track), len(self.track_of_plot)
        return f"Association({found} of {tracks} tracks, {found} of {plots} plots)"


def gate_threshold(gate_probability: float | Gate = "guard", dimension: int = 2) -> float:
    """Return the largest normalised innovation squared of the plots within a gate.

    Parameters
    ----------
    gate_probability : float or {"inner", "outer", "guard"}
        Probability that a true plot lies within the gate, or the name of a gate: "inner" is 0.65,
        "outer" 0.95 and "guard" 0.998.
    dimension : int
        Number of components of the innovation.

    Returns
    -------
    float
        Quantile of the chi-square distribution with `dimension` degrees of freedom.

    Raises
    ------
    ValueError, TypeError
        If a number is outside its domain, a name is unknown, or an argument has the wrong type.

    Examples
    --------
    >>> from tertia.association import gate_threshold
    >>> round(gate_threshold("outer"), 4)
    5.9915
    """
    return _core.gate_threshold(_content(gate_probability), integer(dimension, "dimension", 1))


def gate_sectors(
    innovation: npt.ArrayLike, covariance: npt.ArrayLike, velocity: npt.ArrayLike
) -> GateSector | IntArray:
    """Return the sector of the gate of a track in which each plot lies.

    Parameters
    ----------
    innovation : array_like of shape (..., 2)
        Plots minus predictions, x east and y north.
    covariance : array_like of shape (..., 2, 2)
        Covariances of the innovations.
    velocity : array_like of shape (..., 2)
        Velocities of the tracks; they must not be zero.

    Returns
    -------
    GateSector or ndarray of int, shape (...)
        The sector of each plot. A plot inside the inner gate indicates straight and uniform motion.
        Between the inner and the outer gate, a plot ahead or behind indicates a change of speed,
        and a plot to one side indicates a change of course. A plot beyond the outer gate, in the
        guard gate, indicates a manoeuvre.

    Raises
    ------
    ValueError
        If shapes do not fit, a number is not finite, or a velocity is zero.
    numpy.linalg.LinAlgError
        If a covariance is not positive definite.
    TypeError
        If an argument has the wrong type.

    Notes
    -----
    Sectors are defined by the angle between `S^-1/2 innovation` and `S^-1/2 velocity`, which is the
    same for every square root of S. Therefore each sector contains a quarter of the true plots.
    Plots at an angle of up to 45 degrees are ahead, and plots at 135 degrees or more are behind.

    Examples
    --------
    An aircraft flies north. One plot is ahead of its predicted position, another one to the left:

    >>> from tertia.association import GateSector, gate_sectors
    >>> gate_sectors([[0, 200], [-300, 100]], [[1e4, 0], [0, 1e4]], [0, 220])
    array([1, 7])
    >>> gate_sectors([0, 200], [[1e4, 0], [0, 1e4]], [0, 220])
    <GateSector.AHEAD: 1>
    """
    e, v = finite(innovation, "innovation"), finite(velocity, "velocity")
    s = finite(covariance, "covariance")
    for array, name in ((e, "innovation"), (v, "velocity")):
        if array.shape[-1:] != (2,):
            raise ValueError(f"{name} has shape {array.shape}; it must be (..., 2)")
    if s.shape[-2:] != (2, 2):
        raise ValueError(f"covariance has shape {s.shape}; it must be (..., 2, 2)")
    still = np.argwhere(~np.any(v != 0.0, axis=-1))
    if len(still):
        raise ValueError(f"{place_of('velocity', still[0])} is zero; it must have a direction")
    batch = common_batch(innovation=e.shape[:-1], covariance=s.shape[:-2], velocity=v.shape[:-1])
    found = _core.gate_sectors(
        np.broadcast_to(e, (*batch, 2)),
        np.broadcast_to(s, (*batch, 2, 2)),
        np.broadcast_to(v, (*batch, 2)),
    )
    return found if found.ndim else GateSector(found.item())


def paper_score(nis: npt.ArrayLike, q: float = _RATIO, dimension: int = 2) -> float | FloatArray:
    """Return the score of a plot for a track as in the paper.

    Parameters
    ----------
    nis : array_like of shape (...)
        Normalised innovations squared.
    q : float
        Ratio of the covariance of the innovation in a false association to that in a true one,
        greater than 1.
    dimension : int
        Number of components m of the innovation.

    Returns
    -------
    float or ndarray of shape (...)
        `(1/q - 1) nis / 2 + m/2 ln q`, which is the log-likelihood ratio of a true association to a
        false one. This score does not depend on the size of the covariance; to compare tracks whose
        covariances differ, use `likelihood_score`.

    Raises
    ------
    ValueError, TypeError
        If a `nis` is negative, `q` is 1 or less, or an argument has the wrong type.

    Examples
    --------
    >>> from tertia.association import paper_score
    >>> round(paper_score(3.0), 3)
    3.12
    """
    distance = _squares(nis)
    ratio, m = real(q, "q"), integer(dimension, "dimension", 1)
    found = _core.paper_score(np.atleast_1d(distance), ratio, m)
    value: float | FloatArray = scalar_or_array(found.reshape(distance.shape))
    return value


def likelihood_score(
    nis: npt.ArrayLike,
    covariance: npt.ArrayLike,
    *,
    clutter_density: float,
    detection_probability: float = 0.9,
) -> float | FloatArray:
    """Return the log-likelihood ratio of two hypotheses: a plot is of this target, or it is false.

    Parameters
    ----------
    nis : array_like of shape (...)
        Normalised innovations squared.
    covariance : array_like of shape (..., m, m)
        Covariances of the innovations.
    clutter_density : float
        Mean number of false plots in a scan per unit of area (m = 2) or volume (m = 3).
    detection_probability : float
        Probability that a target is detected in a scan.

    Returns
    -------
    float or ndarray of shape (...)
        `ln(detection_probability N(innovation; 0, S) / clutter_density)`, with S the covariance.

    Raises
    ------
    ValueError
        If shapes do not fit, or a number is outside its domain.
    numpy.linalg.LinAlgError
        If a covariance is not positive definite.
    TypeError
        If an argument has the wrong type.

    Examples
    --------
    >>> from tertia.association import likelihood_score
    >>> score = likelihood_score(3.0, [[1e4, 0], [0, 1e4]], clutter_density=1e-9)
    >>> round(score, 2)
    8.07
    """
    distance, s = _squares(nis), finite(covariance, "covariance")
    if s.ndim < 2 or s.shape[-1] != s.shape[-2] or s.shape[-1] == 0:
        raise ValueError(f"covariance has shape {s.shape}; it must be (..., m, m)")
    root = np.linalg.cholesky(s)
    volume = 2.0 * np.sum(np.log(diagonal(root)), axis=-1)
    batch = common_batch(nis=distance.shape, covariance=volume.shape)
    found = _core.likelihood_score(
        np.atleast_1d(np.broadcast_to(distance, batch)),
        np.atleast_1d(np.broadcast_to(volume, batch)),
        s.shape[-1],
        real(detection_probability, "detection_probability"),
        real(clutter_density, "clutter_density"),
    )
    value: float | FloatArray = scalar_or_array(found.reshape(batch))
    return value


def gate(
    predicted: npt.ArrayLike,
    covariance: npt.ArrayLike,
    plots: npt.ArrayLike,
    plot_covariance: npt.ArrayLike | None = None,
    *,
    gate_probability: float | Gate = "guard",
) -> Pairs:
    """Find the plots within the gates of tracks.

    Parameters
    ----------
    predicted : array_like of shape (T, m)
        Predicted positions, with m = 2 or 3; the first two coordinates are those in the plane.
    covariance : array_like of shape (T, m, m) or (m, m)
        Covariances of the innovations or, if `plot_covariance` is given, of the predictions.
    plots : array_like of shape (N, m)
        Positions of the plots of one scan.
    plot_covariance : array_like of shape (N, m, m) or (m, m), optional
        Covariances of the plots, to be added to those of the predictions.
    gate_probability : float or {"inner", "outer", "guard"}
        Probability that a true plot lies within its gate.

    Returns
    -------
    Pairs
        Tracks and plots with their normalised innovations.

    Raises
    ------
    ValueError
        If shapes do not fit, or a number is not finite or outside its domain.
    numpy.linalg.LinAlgError
        If a covariance is indefinite, or if it is singular and no `plot_covariance` is given.
    TypeError
        If an argument has the wrong type.

    Notes
    -----
    Plots are found with a spatial index, so the cost is O(T + N) plus the number of pairs.

    Examples
    --------
    >>> from tertia.association import gate
    >>> pairs = gate([[0, 0], [5, 5]], [[1, 0], [0, 1]], [[0.5, 0], [5, 7], [9, 9]])
    >>> pairs.track, pairs.plot, pairs.nis
    (array([0, 1]), array([0, 1]), array([0.25, 4.  ]))
    """
    scene = _scene(predicted, covariance, plots, plot_covariance)
    threshold = _core.gate_threshold(_content(gate_probability), scene[0].shape[-1])
    return Pairs(*_core.gate_pairs(*scene, threshold))


def associate(
    predicted: npt.ArrayLike,
    covariance: npt.ArrayLike,
    plots: npt.ArrayLike,
    plot_covariance: npt.ArrayLike | None = None,
    *,
    method: Assignment = "gnn",
    score: Score = "likelihood",
    clutter_density: float | None = None,
    detection_probability: float = 0.9,
    q: float = _RATIO,
    gate_probability: float | Gate = "guard",
) -> Association:
    """Assign at most one plot to each track, and at most one track to each plot.

    Parameters
    ----------
    predicted, covariance, plots, plot_covariance : array_like
        The same arguments as for `gate`, with the same shapes.
    method : {"gnn", "nearest"}
        "gnn": the global nearest neighbour method, which maximises the sum of the gains (see
        Notes).
        "nearest": repeatedly, the pair with the largest gain among the remaining pairs is assigned.
    score : {"likelihood", "paper"}
        "likelihood": the score is `likelihood_score`. "paper": it is `paper_score`.
    clutter_density : float, optional
        Mean number of false plots in a scan per unit of area or volume; required if `score` is
        "likelihood".
    detection_probability : float
        Probability that a target is detected in a scan; used if `score` is "likelihood".
    q : float
        As for `paper_score`; used if `score` is "paper".
    gate_probability : float or {"inner", "outer", "guard"}
        Probability that a true plot lies within its gate. Plots outside the gate of a track are
        never assigned to it.

    Returns
    -------
    Association
        The plot of each track, and the track of each plot.

    Raises
    ------
    ValueError, numpy.linalg.LinAlgError, TypeError
        As for `gate`; also if `score` is "likelihood" and `clutter_density` is missing.

    Notes
    -----
    The gain of a pair is its likelihood score minus `ln(1 - detection_probability)`, because if the
    pair is not assigned, the plot is false and the target was not detected. Pairs with a gain of
    zero or less are not assigned. If `score` is "paper", the gain is the score of the pair minus
    the score at the edge of the gate, so that only the gate decides whether a plot is accepted.

    Examples
    --------
    The first track is nearer to both plots than the second track, but each track is assigned a
    plot:

    >>> from tertia.association import associate
    >>> result = associate([[0, 0], [3, 0]], [[1, 0], [0, 1]], [[0.9, 0], [0, 0.5]],
    ...                    clutter_density=1e-3)
    >>> result
    Association(2 of 2 tracks, 2 of 2 plots)
    >>> result.plot_of_track
    array([1, 0])
    """
    choice(score, "score", ("likelihood", "paper"))
    choice(method, "method", ("gnn", "nearest"))
    likelihood = None
    if score == "likelihood":
        if clutter_density is None:
            raise ValueError("clutter_density is missing; score='likelihood' needs it")
        likelihood = (
            real(detection_probability, "detection_probability"),
            real(clutter_density, "clutter_density"),
        )
    scene = _scene(predicted, covariance, plots, plot_covariance)
    content = _content(gate_probability)
    return Association(*_core.associate(*scene, content, likelihood, real(q, "q"), method))


def _scene(
    predicted: npt.ArrayLike,
    covariance: npt.ArrayLike,
    plots: npt.ArrayLike,
    plot_covariance: npt.ArrayLike | None,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray | None]:
    """Return predictions, covariances, plots and plot covariances; the core checks the numbers."""
    tracks, scan = samples(predicted, "predicted"), samples(plots, "plots")
    for array, name in ((tracks, "predicted"), (scan, "plots")):
        if array.ndim != 2 or array.shape[-1] not in (2, 3):
            raise ValueError(f"{name} has shape {array.shape}; it must be (N, 2) or (N, 3)")
    m = tracks.shape[-1]
    if scan.shape[-1] != m:
        raise ValueError(f"plots has shape {scan.shape}; it must be (N, {m}), as predicted")
    sigmas = _matrices(covariance, "covariance", len(tracks), m)
    noise = None
    if plot_covariance is not None:
        noise = _matrices(plot_covariance, "plot_covariance", len(scan), m)
    return tracks, sigmas, scan, noise


def _content(gate_probability: float | Gate) -> float:
    """Return the probability that a true plot lies within a gate, given as a number or by name."""
    if isinstance(gate_probability, str):
        if gate_probability not in _GATES:
            raise ValueError(
                f"gate_probability is {gate_probability!r}; it must be a number, 'inner', 'outer' "
                "or 'guard'"
            )
        return _GATES[gate_probability]
    return real(gate_probability, "gate_probability")


def _squares(nis: npt.ArrayLike) -> FloatArray:
    """Return normalised innovations squared."""
    distance = finite(nis, "nis")
    require_each(distance, distance >= 0.0, "nis", "zero or positive")
    return distance


def _matrices(value: npt.ArrayLike, name: str, count: int, m: int) -> FloatArray:
    """Return covariances, (count, m, m) or (m, m)."""
    array = samples(value, name)
    if array.shape not in {(count, m, m), (m, m)}:
        raise ValueError(
            f"{name} has shape {array.shape}; it must be ({count}, {m}, {m}) or ({m}, {m})"
        )
    return array
