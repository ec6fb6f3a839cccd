"""Trajectories from measurements of several stations at common times."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, NoReturn, TypeAlias, get_args

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import FloatArray, finite, positive, radians, real, samples, threads
from tertia.location import LocationStatus
from tertia.location._readers import checked, correlation_of
from tertia.location._result import location_of
from tertia.sensors import (
    ANGLES,
    KINDS,
    STATION_KINDS,
    Bias,
    Kind,
    Station,
    by_kind,
    stack_stations,
)
from tertia.smoothing import SmoothedPositions, local_polynomial
from tertia.trajectory._result import Trajectory

Order: TypeAlias = Literal["spatial-first", "temporal-first"]
Spatial: TypeAlias = Literal["robust", "least-squares"]
Smoother: TypeAlias = Literal["rts", "local-polynomial"]


def reconstruct(
    stations: Sequence[Station],
    time: npt.ArrayLike,
    *,
    range: npt.ArrayLike | None = None,  # noqa: A002  # that is what it is
    azimuth: npt.ArrayLike | None = None,
    elevation: npt.ArrayLike | None = None,
    range_difference: npt.ArrayLike | None = None,
    range_difference_sigma: npt.ArrayLike | None = None,
    range_difference_correlation: float = 0.5,
    order: Order = "spatial-first",
    spatial: Spatial = "robust",
    smoother: Smoother = "rts",
    window: int = 13,
    degree: int | Literal["adaptive"] = "adaptive",
    jerk: float | None = None,
    bias: Bias | None = None,
    degrees: bool = False,
    n_threads: int | None = None,
) -> Trajectory:
    """Reconstruct a trajectory from the measurements of several stations at common times.

    Parameters
    ----------
    stations : sequence of K Station
        Positions and standard deviations of the stations; positions of shape (D,) or, if they move,
        (N, D). If their axes change over time, the order must be "spatial-first".
    time : array_like of shape (N,)
        Times of the instants, not decreasing.
    range, azimuth, elevation : array_like of shape (N, K), optional
        Measurements in metres and radians, nan where there is none.
    range_difference : array_like of shape (N, K - 1), optional
        See `tertia.location.locate`.
    range_difference_sigma : array_like of shape (K - 1,), optional
        Their standard deviations.
    range_difference_correlation : float
        See `tertia.location.locate`.
    order : {"spatial-first", "temporal-first"}
        "spatial-first": instants are located, then positions are smoothed over time;
        "temporal-first": each series of measurements is smoothed over time, then positions are
        computed. The latter does not need measurements at the same instants: nan between the first
        and the last measurement of a station is filled.
    spatial : {"robust", "least-squares"}
        How each instant is located.
    smoother : {"rts", "local-polynomial"}
        How positions or series are smoothed over time: by `tertia.smoothing.smooth` or
        `local_polynomial`.
    window, degree
        Parameters of "local-polynomial".
    jerk : float, optional
        Intensity of the white jerk for "rts"; by default the most likely one. With "temporal-first"
        it is always fitted.
    bias : Bias, optional
        Constant biases of the stations. A sigma of None, as in `Bias(azimuth_sigma=None)`, means
        that the bias of each station is estimated and removed, which needs "spatial-first" and
        "rts"; a sigma of 0 means that there is no bias.
    degrees : bool
        Whether the angles given here are in degrees.
    n_threads : int, optional
        Threads to use; by default one for small tasks and all cores for large ones.

    Returns
    -------
    Trajectory
        Positions, velocities and accelerations with their covariance, faults, residuals, biases.

    Raises
    ------
    ValueError
        A wrong shape, a number outside its domain, times that decrease, no instant that can be
        located, or biases that the measurements do not determine.
    TypeError
        An argument of the wrong type.

    Notes
    -----
    With "rts" and "robust", a measurement is also left out if both the rest of the track (1 % for
    the whole record) and the other measurements of its instant (1 %) contradict it. Instants with
    one or two degrees of freedom have Tukey's weights about the track. Positions are linearised
    about the track. The covariance includes the uncertainty of the fitted jerk: it is the mean over
    the intensities q, weighted by likelihood and a prior on log q proportional to q^(1/4).

    Biases: to first order, biases b add A_t b to the position at an instant, with A_t the matrix of
    its least-squares solution, and (I - H_t) b to its residuals, with H_t = J_t A_t. b is estimated
    from the residuals alone, with Tukey's weights about the track and no assumption about the
    positions. Smoothness would add information about the biases, but a curve of the path could then
    be mistaken for a bias. Their covariance is A^-1 B A^-1, with A the derivative of the scores,
    and B their variance from the standard deviations or the residuals, whichever is larger. B is
    increased by the autocorrelations of the scores if these are significant (Geyer 1992). Errors of
    positions at different instants are assumed to be independent.

    With "temporal-first", velocities are A_t times the rates of the smoothed series.

    Cost O(N K).

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.location import Station
    >>> from tertia.trajectory import reconstruct
    >>> places = np.array([[1.0, 1000.0], [2000.0, 300.0], [400.0, 2600.0]])
    >>> stations = [Station(p, range_sigma=10.0, azimuth_sigma=0.005) for p in places]
    >>> t = np.arange(60.0)
    >>> truth = np.column_stack([20 * t, 1500 + 5 * t])
    >>> offset = truth[:, np.newaxis] - places
    >>> rng = np.random.default_rng(1)
    >>> distance = np.linalg.norm(offset, axis=-1) + 10 * rng.standard_normal((60, 3))
    >>> bearing = np.arctan2(offset[..., 0], offset[..., 1]) + 0.005 * rng.standard_normal((60, 3))
    >>> distance[30:34, 0] += 100
    >>> track = reconstruct(stations, t, range=distance, azimuth=bearing)
    >>> np.flatnonzero(track.outlier.range[:, 0]).tolist()
    [30, 31, 32, 33]
    """
    require_options(
        order=order,
        spatial=spatial,
        smoother=smoother,
        window=window,
        degree=degree,
        jerk=jerk,
        bias=bias,
    )
    instants = _instants(time)
    places, axes, sigmas = _places(stations, len(instants))
    k = places.shape[-2]
    if range_difference_sigma is not None:
        sigma = positive(range_difference_sigma, "range_difference_sigma")
        sigmas["range_difference"] = np.broadcast_to(sigma, max(k - 1, sigma.size))
    given = zip(KINDS, (range, azimuth, elevation, range_difference, None), strict=True)
    measured = {
        kind: _checked(values, sigmas.get(kind), kind, (len(instants), k), degrees=degrees)
        for kind, values in given
        if values is not None
    }
    if not measured:
        raise ValueError("nothing was measured; give range, azimuth, elevation or range_difference")
    if places.shape[-1] == 2 and "elevation" in measured:
        raise ValueError("elevation needs stations with three coordinates")
    if order == "temporal-first" and axes is not None and axes.ndim > 3:
        raise ValueError("axes of stations change along time; order must be 'spatial-first'")
    estimated = _estimated(bias, measured)
    values, deviations = (
        np.full((len(instants), len(KINDS), k), np.nan),
        np.full((len(KINDS), k), np.nan),
    )
    for kind, array in measured.items():
        at, first = KINDS.index(kind), int(kind == "range_difference")
        values[:, at, first:], deviations[at, first:] = array, sigmas[kind]
    record = {
        "stations": places,
        "axes": axes,
        "time": instants,
        "values": values,
        "sigmas": deviations,
        "correlation": correlation_of(range_difference_correlation),
        "robust": spatial == "robust",
    }
    steps = {
        "temporal_first": order == "temporal-first",
        "polynomials": (
            (int(window), None if isinstance(degree, str) else int(degree))
            if smoother == "local-polynomial"
            else None
        ),
        "jerk": jerk,
        "biased": [KINDS.index(kind) for kind in estimated],
    }
    found = _core.reconstruct(record, steps, threads(n_threads))
    if found["failure"] is not None:
        _raise(found["failure"], stations)
    d, mean, smoothed = places.shape[-1], found["mean"], found["smoothed"]
    kinds = tuple(measured)
    return Trajectory(
        instants,
        mean[:, :d],
        mean[:, d : 2 * d],
        mean[:, 2 * d :],
        covariance=found["covariance"],
        fixes=location_of(found["fixes"], kinds, estimated=False),
        outlier=by_kind(found["outlier"], kinds),
        residual=by_kind(found["residual"], kinds),
        bias=None if found["bias"] is None else _bias(*found["bias"]),
        smoothed=None if smoothed is None else SmoothedPositions(mean, *smoothed),
    )


def _bias(values: list[float], sigmas: list[float]) -> Bias:
    rows = dict(
        zip(KINDS, np.reshape([values, sigmas], (2, len(KINDS), -1)).swapaxes(0, 1), strict=True)
    )
    fields: dict[str, Any] = {str(kind): rows[kind][0] for kind in STATION_KINDS}
    return Bias(**fields | {f"{kind}_sigma": rows[kind][1] for kind in STATION_KINDS})


def _raise(failure: tuple[str, list[int]], stations: Sequence[Station]) -> NoReturn:
    why, numbers = failure
    if why == "not-located":
        reasons = "; ".join(LocationStatus(number).message for number in numbers)
        raise ValueError(f"no instant can be located: {reasons}")
    k = len(stations)
    called = [one.name or f"station {at}" for at, one in enumerate(stations)]
    named = ", ".join(f"{KINDS[number // k]} of {called[number % k]}" for number in numbers)
    if why == "unusable":
        raise ValueError(f"biases of {named} cannot be estimated: nothing usable was measured")
    raise ValueError(
        f"biases of {named} are not observable: together they move the positions and change no "
        "residual"
    )


def _instants(time: npt.ArrayLike) -> FloatArray:
    instants = finite(time, "time")
    if instants.ndim != 1 or instants.size == 0:
        raise ValueError(f"time has shape {instants.shape}; it must be (N,)")
    back = np.flatnonzero(np.diff(instants) < 0)
    if back.size:
        raise ValueError(
            f"time[{back[0] + 1}] is before the time before it; time must not decrease"
        )
    return instants


def _places(
    stations: Sequence[Station], n: int
) -> tuple[FloatArray, FloatArray | None, dict[Kind, FloatArray]]:
    """Return positions, (K, D) or (N, K, D), axes, and standard deviations, (K,)."""
    if not isinstance(stations, Sequence) or not all(isinstance(s, Station) for s in stations):
        raise TypeError("stations must be a sequence of Station")
    if not stations:
        raise ValueError("stations is empty; it must have at least one")
    places, axes, sigmas = stack_stations(stations)
    if places.ndim > 3 or (places.ndim == 3 and len(places) != n):
        raise ValueError(
            f"stations have positions of shape {places.shape[:-2]}; there are {n} instants"
        )
    return places, axes, {kind: sigmas[kind] for kind in STATION_KINDS}


def _checked(
    values: npt.ArrayLike,
    sigma: FloatArray | None,
    kind: Kind,
    shape: tuple[int, int],
    *,
    degrees: bool,
) -> FloatArray:
    """Return checked measurements; each must have a standard deviation."""
    n, k = shape
    count = k - int(kind == "range_difference")
    array = radians(values, kind, degrees=degrees) if kind in ANGLES else samples(values, kind)
    if array.shape != (n, count):
        raise ValueError(
            f"{kind} has shape {array.shape}; for {n} instants and {k} stations it must be "
            f"({n}, {count})"
        )
    if sigma is None:
        raise ValueError(f"{kind}_sigma is missing")
    if sigma.shape != (count,):
        raise ValueError(f"{kind}_sigma has shape {sigma.shape}; it must be ({count},)")
    missing = np.flatnonzero(np.isnan(sigma) & ~np.isnan(array).all(axis=0))
    if missing.size:
        raise ValueError(f"{kind}_sigma of station {missing[0]} is missing")
    return checked(array, kind, k)


def require_options(
    *,
    order: Order = "spatial-first",
    spatial: Spatial = "robust",
    smoother: Smoother = "rts",
    window: int = 13,
    degree: int | Literal["adaptive"] = "adaptive",
    jerk: float | None = None,
    bias: Bias | None = None,
) -> None:
    """Refuse options of `reconstruct` that are wrong whatever was measured."""
    chosen = {"order": (order, Order), "spatial": (spatial, Spatial)}
    for name, (value, allowed) in {**chosen, "smoother": (smoother, Smoother)}.items():
        if value not in get_args(allowed):
            choices = " or ".join(map(repr, get_args(allowed)))
            raise ValueError(f"{name} is {value!r}; it must be {choices}")
    if smoother == "local-polynomial":
        # an empty series: the window and degree are judged alone
        local_polynomial(np.empty(0), window, degree, max_degree=0)
    if jerk is not None and not 0 <= real(jerk, "jerk") < np.inf:
        raise ValueError(f"jerk is {jerk}; it must not be negative")
    if bias is not None and not isinstance(bias, Bias):
        raise TypeError(f"bias is {bias!r}; it must be a Bias")
    estimated = bias is not None and any(
        getattr(bias, f"{kind}_sigma") is None for kind in STATION_KINDS
    )
    if estimated and (order, smoother) != ("spatial-first", "rts"):
        raise ValueError("bias needs order 'spatial-first' and smoother 'rts'")


def _estimated(bias: Bias | None, measured: dict[Kind, FloatArray]) -> tuple[Kind, ...]:
    """Return the kinds of which biases are to be estimated."""
    if bias is None:
        return ()
    kinds = []
    for kind in STATION_KINDS:
        sigma = getattr(bias, f"{kind}_sigma")
        if np.any(getattr(bias, kind)):
            raise ValueError(f"bias.{kind} is {getattr(bias, kind)}; it must be 0")
        if sigma is None:
            kinds.append(kind)
        elif np.any(sigma):
            raise ValueError(f"bias.{kind}_sigma is {sigma}; it must be 0, or None: estimated")
        if sigma is None and kind not in measured:
            raise ValueError(f"bias.{kind}_sigma is None, but {kind} was not measured")
    return tuple(kinds)
