"""Trajectories from measurements of several stations."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Any, Literal, NoReturn, TypeAlias, get_args

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import (
    FloatArray,
    choice,
    finite,
    instance,
    instants_of,
    radians,
    real,
    samples,
    threads,
)
from tertia.location import LocationStatus
from tertia.location._arrivals import LIGHT, read_arrivals
from tertia.location._bias import ERRORS, given_biases, said
from tertia.location._height import without_heights
from tertia.location._readers import (
    checked,
    correlation_of,
    deviations,
    near_enough,
    require_kinds,
)
from tertia.location._result import location_of
from tertia.location._speed import Speed
from tertia.location._wind import Wind, read_medium
from tertia.sensors import Bias, Kind, Station
from tertia.sensors._kinds import ANGLES, KINDS, STATION_KINDS
from tertia.sensors._sensors import by_kind, stack_stations, survey_sigmas
from tertia.smoothing import SmoothedPositions, local_polynomial
from tertia.trajectory._doubts import doubt_measurements, warn_of_path
from tertia.trajectory._height import (
    fields_of,
    in_space,
    read_heights,
    with_heights,
)
from tertia.trajectory._result import Trajectory
from tertia.trajectory._speed import in_found_medium
from tertia.trajectory._systematic import (
    bias_of,
    clocks_of,
    prior_of,
    unit_of,
    without_deviations,
)

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
    arrival_time: npt.ArrayLike | None = None,
    range_sigma: npt.ArrayLike | None = None,
    azimuth_sigma: npt.ArrayLike | None = None,
    elevation_sigma: npt.ArrayLike | None = None,
    range_difference_sigma: npt.ArrayLike | None = None,
    arrival_time_sigma: npt.ArrayLike | None = None,
    range_difference_correlation: float = 0.5,
    propagation_speed: npt.ArrayLike = LIGHT,
    propagation_speed_sigma: float | None = None,
    wind_sigma: float | None = None,
    height: npt.ArrayLike | None = None,
    height_sigma: npt.ArrayLike | None = None,
    order: Order = "spatial-first",
    spatial: Spatial = "robust",
    smoother: Smoother = "rts",
    window: int = 13,
    degree: int | Literal["adaptive"] = "adaptive",
    jerk: float | None = None,
    bias: Bias | None = None,
    initial: npt.ArrayLike | None = None,
    degrees: bool = False,
    n_threads: int | None = None,
) -> Trajectory:
    """Reconstruct a trajectory from the measurements of several stations.

    Parameters
    ----------
    stations : sequence of K Station
        The stations, with their positions and standard deviations. Positions have the shape (D,)
        or, if stations move, (N, D). If the axes of a station change over time, `order` must be
        "spatial-first". A `position_sigma` describes an error that all instants share, and requires
        the order "spatial-first" and the smoother "rts". If D = 3 and only azimuths are measured,
        the path is estimated in the plane, without the heights of the stations: the component up of
        the position, velocity and acceleration is nan with an infinite variance, as in `locate`.
    time : array_like of shape (N,)
        Times of the instants in seconds, in non-decreasing order. A single measurement at an
        instant is sufficient.
    range, azimuth, elevation : array_like of shape (N, K), optional
        Measurements in metres and radians; nan where one is missing. Near a station, noise may make
        a range negative, by at most 5 `range_sigma`.
    range_difference : array_like of shape (N, K - 1), optional
        For each station except the first, its range minus the range of the first station, in
        metres; see `tertia.location.locate`.
    arrival_time : array_like of shape (N, K), optional
        Time at which the signal emitted at each instant arrived at each station, in seconds of a
        common clock or as NumPy's datetimes; nan or NaT where it did not arrive. The times of
        emission are unknown. Therefore two arrivals only determine a hyperbola, and a single
        arrival gives no information.
    range_sigma, azimuth_sigma, elevation_sigma : array_like of shape (K,) or (N, K), optional
        Standard deviations in metres and radians, one per station or one per measurement, instead
        of those of the stations.
    range_difference_sigma : array_like of shape (K - 1,), optional
        Standard deviations of the range differences in metres.
    arrival_time_sigma : array_like of shape (K,) or (N, K), optional
        Standard deviations of the times of arrival in seconds.
    range_difference_correlation : float
        As for `tertia.location.locate`.
    propagation_speed : array_like of shape () or (N,)
        Speed of the signal in m/s; by default the speed of light.
    propagation_speed_sigma : float, optional
        Standard deviation of the speed, whose error is the same at all instants. The speed is then
        estimated from the positions of the single instants, as in `tertia.location.locate`, and the
        covariance includes the error of the estimate. It requires the order "spatial-first" and the
        smoother "rts". By default, the speed of sound is estimated if the measurements clearly
        contradict it, as in `tertia.location.locate`.
    wind_sigma : float, optional
        As for `tertia.location.locate`. It requires the same order and smoother.
    height, height_sigma : array_like of shape () or (N,), optional
        Last coordinate of the target in metres, as from a barometer, and its standard deviation,
        only if D = 3; nan where it was not measured. A height is used like the other measurements,
        and an outlier is left out. Its error has two parts of this standard deviation (the median
        of `height_sigma`): one is new at each instant, the other lasts (see Notes). The same order
        and smoother are required, and no bias may have a sigma of inf.
    order : {"spatial-first", "temporal-first"}
        "spatial-first": instants are located, then the positions are smoothed over time.
        "temporal-first": each series of measurements is smoothed over time, and missing values
        between its first and last measurement are filled; then positions are computed.
    spatial : {"robust", "least-squares"}
        How each instant is located: "robust" with, and "least-squares" without detection of faults.
    smoother : {"rts", "local-polynomial"}
        How positions or series are smoothed over time: with "rts" by `tertia.smoothing.smooth`, and
        with "local-polynomial" by `tertia.smoothing.local_polynomial`.
    window, degree
        Parameters of `tertia.smoothing.local_polynomial`, for "local-polynomial" only.
    jerk : float, optional
        Intensity of the white jerk for "rts" in m²/s⁵. By default, both the driving noise (white
        jerk or white acceleration) and its intensity are estimated (see `tertia.smoothing.smooth`).
        With "temporal-first" the intensity is always estimated.
    bias : Bias, optional
        Systematic errors that replace those of the stations; `Bias()` means that there are none. If
        it is missing, or if a sigma is None, the systematic errors are estimated from
        inconsistencies between the stations. Sigmas other than 0 require "spatial-first" and "rts".
        A finite sigma is that of an error that all instants share. A sigma of inf, which must be
        given for all stations or for none, means that the bias is constant and unknown. If the
        measurements do not determine such a bias, an error is raised. `bias.time` and its sigma
        also apply to the clocks of ranges and angles (see Notes).
    initial : array_like of shape (D,), optional
        A position near the target at the first instant. If two paths that are mirror images of each
        other fit the measurements, the path on its side of the stations is returned (see Notes).
    degrees : bool
        Whether the angles in this call are in degrees.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.

    Returns
    -------
    Trajectory
        Positions, velocities and accelerations with covariances, outliers, residuals and biases.

    Raises
    ------
    ValueError
        If a shape is wrong, a number is outside its domain, times decrease, no instant can be
        located, biases or heights are not determined by the measurements, no path is found that
        agrees with them, or two paths fit them equally well and neither is above the stations.
    TypeError
        If an argument has the wrong type.

    Warns
    -----
    UserWarning
        If most angles contradict each other when read as radians, but agree when read as degrees,
        or if most measurements would agree in another unit, or with another zero or direction.
        If more than half of the measurements, or of the heights, or all of a kind are left out.
        If the path and its mirror image below the stations fit the measurements equally well, if no
        path above the stations fits, or if a path that crosses their plane would be smoother.
        If the path may cross a line or vertical plane of stations or turn back at it (see Notes).

    Notes
    -----
    With "rts", measurements are linearised about the track, even at instants whose measurements do
    not determine a position. With "robust", each measurement is either good or an outlier. In both
    cases its error is normal, relative to the track that is estimated without it. The weight of a
    measurement is the probability that it is good. The variances of good measurements and of
    outliers, and the proportion of outliers, are those that maximise the likelihood. They are found
    by expectation maximisation, in which the noise decreases from the size of the residuals of the
    first track to the stated noise. Repeated measurements are removed first, as are stations whose
    varying errors contradict all the others throughout. If the errors of ranges clearly grow with
    the range, so do the sigmas that are used (`relative_range_sigma`); if several kinds are
    measured and one has far larger errors than stated, its sigmas are larger. The covariance is the
    mean of those for different intensities q of the jerk, weighted by the likelihood of q and by a
    prior density of log q that is proportional to q^(1/4).

    **Systematic errors.** The measurements of one kind by a station have an error c + g(t), where c
    is constant and g is a Gauss-Markov process. To first order this error adds A_t (c + g) to the
    position and (I - H_t)(c + g) to the residuals, where A_t is the matrix of the least-squares
    solution and H_t = J_t A_t. The variance of the error, the fraction of it that is due to g, and
    the correlation time are estimated from the residuals alone, without assumptions about the
    positions, because a bias can look like a curve of the path. A Kalman filter of c and g gives
    the likelihood of these three parameters on a grid, and the results are averaged over the grid.
    Only c is subtracted from the measurements; its remaining uncertainty and the variance of g are
    propagated into the covariance.

    An error that all stations have in common causes no inconsistencies between them. It is assumed
    to be as large as the errors that are estimated from inconsistencies, or as the part of the
    stated variance that appears neither as scatter nor as inconsistencies. If no systematic error
    is found, nothing is subtracted, but the covariance includes the systematic error that cannot be
    excluded. The larger the systematic errors, the wider are the limits beyond which a measurement
    is a fault.

    **Range differences** that share the error of the first station are arrivals, with 0 for that
    station. A range difference is an outlier if either of its stations is wrong.

    The time of emission of each instant is an additional unknown, without a prior. Arrivals are
    therefore used relative to their common part, which is the weighted median of the arrivals that
    are not late.

    **Clocks.** A measurement by a clock that is fast by `bias.time` is assigned to the instant
    nearest to its true time, and corrected along the path for the rest; `time_sigma` is the sigma
    of a constant error. An error of all clocks moves the path along itself; the covariance includes
    it to first order. With times of arrival, errors of clocks are errors of these times alone.

    If the sigma of a bias is inf, c is estimated with Tukey's weights, computed from residuals
    about the track. The covariance of c is A^-1 B A^-1, where A is the derivative of the scores and
    B is their variance. B is computed both from the standard deviations and from the residuals, and
    the larger result is used. If the autocorrelations of the scores are significant (Geyer 1992), B
    is multiplied by one plus twice their sum.

    **Heights.** Half of the variance of the lasting error of heights is that of a constant, which
    is estimated from contradictions with the other measurements and subtracted; the other half is
    that of a drift, as for stations. If nothing contradicts them, the covariance includes all of
    the lasting error. Heights that refer to another level than the stations are not detected, and
    the path follows them. With heights, only a vertical plane of stations leaves two mirror images.

    **Mirror images.** If all stations lie in a plane, or on a line if D = 2, then their ranges,
    range differences and times of arrival are the same for a target and its mirror image. Azimuths
    are also the same if the plane is horizontal. The whole path is kept on one side of the plane:
    on the side of `initial`, or else above the stations. If the stations are only near the plane
    and `initial` is missing, both paths are compared; the path below the stations is returned if it
    is more likely even at prior odds of one to a thousand. Each station may then have a constant
    error of the stated size, if that is likelier and its bias is not given as 0. If the two cannot
    be distinguished and `initial` is missing, a warning is given, and `mirror_image` contains the
    other path. If neither is above the stations, as with D = 2, an error is raised. If `initial` is
    given in this case, the path may cross the plane: it does so where this has a larger marginal
    likelihood than turning back. A warning is given if the two likelihoods differ by less than a
    factor of 400. Near the plane, the square of the height h is measured, and the derivatives with
    respect to h are therefore taken at the height ``sqrt(h^2 + V)``, where V is the variance of h.

    With "temporal-first", the velocity is the product of A_t and the rates of the smoothed series.

    The cost is O(N K). Systematic errors add a cost of O(K²) to O(K³), nearly independent of N: 40
    stations with ranges, azimuths and elevations take about 20 s.

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

    The same target is reconstructed from the times at which its signals arrive at the three
    stations. They determine its path although the times of emission are unknown:

    >>> sent = t + rng.uniform(0, 0.3, 60)
    >>> arrival = sent[:, np.newaxis] + np.linalg.norm(offset, axis=-1) / 299_792_458.0
    >>> track = reconstruct(stations, t, arrival_time=arrival, arrival_time_sigma=30e-9)
    >>> bool(np.max(np.abs(track.position - truth)) < 1.0)
    True
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
    times = instants_of(time).copy()
    places, axes, sigmas = _places(stations, len(times))
    k = places.shape[-2]
    stated = (range_sigma, azimuth_sigma, elevation_sigma, range_difference_sigma)
    values_of = (range, azimuth, elevation, range_difference)
    sigmas |= {
        kind: deviations(sigma, None, kind, k, values, degrees=degrees)
        for kind, sigma, values in zip(KINDS, stated, values_of, strict=False)
        if sigma is not None
    }
    arrivals = None
    if arrival_time is not None:
        known = sigmas.get("arrival_time")
        arrivals = read_arrivals(arrival_time, arrival_time_sigma, known, propagation_speed, k)
        sigmas["arrival_time"] = arrivals.sigma
    heard = (arrivals.value,) if arrivals is not None else (None,)
    measured = {
        kind: _checked(values, sigmas.get(kind), kind, (len(times), k), degrees=degrees)
        for kind, values in zip(
            KINDS, (range, azimuth, elevation, range_difference, *heard), strict=True
        )
        if values is not None
    }
    correlation = correlation_of(range_difference_correlation)
    require_kinds(
        measured, places.shape[-1], shared="range_difference" in measured and correlation > 0
    )
    surveys = survey_sigmas(stations)
    medium = read_medium(
        propagation_speed,
        (propagation_speed_sigma, wind_sigma),
        measured,
        robust=(order, spatial, smoother) == ("spatial-first", "robust", "rts"),
    )
    _require_order((order, smoother), axes, surveys, medium, is_timed=arrivals is not None)
    curves, sources, bias = without_deviations(stations, bias, measured.get("azimuth"))
    given = given_biases(bias, sources, k)
    prior = prior_of(given, bias, sources, measured, arrivals)
    is_asked = curves is not None or np.any(given.sigma > 0)
    if is_asked and (order, smoother) != ("spatial-first", "rts"):
        raise ValueError("bias needs order 'spatial-first' and smoother 'rts'")
    heights = read_heights(
        (height, height_sigma), (len(times), places.shape[-1]), (order, smoother), prior["flat"]
    )
    if curves is not None:
        prior["deviation"] = curves[1].ravel().tolist()
    corrected = {
        kind: given.subtracted(kind, array, unit_of(kind, arrivals))
        for kind, array in measured.items()
    }
    if curves is not None and "azimuth" in corrected:
        corrected["azimuth"] = corrected["azimuth"] - curves[0]
    values, own = _by_station(corrected, sigmas, (len(times), k))
    places, axes, flat = (
        without_heights(places, axes, measured) if heights is None else (places, axes, False)
    )
    usual, differ = _usual(own, values), any(sigma.ndim > 1 for sigma in sigmas.values())
    record = {
        "stations": places,
        "axes": axes,
        "surveys": None if surveys is None else surveys.tolist(),
        "time": times,
        "clocks": clocks_of(given, measured, (order, smoother), deviates=curves is not None),
        "values": values,
        "sigmas": usual,
        "own_sigmas": np.where(np.isnan(values), usual, own) if differ else None,
        "height": None if heights is None else heights.for_path,
        "correlation": correlation,
        "speed_sigma": 0.0,
        "wind": None,
        "robust": spatial == "robust",
        "initial": _initial(initial, places.shape[-1], flat=flat),
    }
    polynomials: tuple[int, int | None] | None = None
    if smoother == "local-polynomial":
        polynomials = int(window), None if isinstance(degree, str) else int(degree)
    steps = {
        "temporal_first": order == "temporal-first",
        "polynomials": polynomials,
        "jerk": jerk,
        **prior,
    }
    record, (speed, wind), arrivals = in_found_medium(
        record, medium, arrivals, prior["bias_sigma"][:-k], threads(n_threads)
    )
    found = _core.reconstruct(record, steps, threads(n_threads))
    doubt_measurements(record, found, degrees=degrees, free=bool(np.isnan(given.sigma).any()))
    if found["failure"] is not None:
        _raise(found["failure"], stations)
    found = in_space(found) if flat else found
    mean, smoothed, kinds = found["mean"], found["smoothed"], tuple(measured)
    d = mean.shape[1] // 3
    warn_of_path(found, values, timed=any(prior["bias_sigma"][-k:]))
    return Trajectory(
        times,
        mean[:, :d],
        mean[:, d : 2 * d],
        mean[:, 2 * d :],
        covariance=found["covariance"],
        fixes=with_heights(
            location_of(found["fixes"], kinds, estimated=False, arrivals=arrivals),
            found,
            values,
            heights,
        ),
        outlier=by_kind(found["outlier"], kinds),
        residual=by_kind(found["residual"], kinds),
        systematic=said(np.isnan(given.sigma), tells=bool(found["bias"] and found["bias"][-1])),
        bias=bias_of(given, found["bias"], arrivals),
        smoothed=None if smoothed is None else _smoothed(mean, smoothed),
        mirror_image=found["image"],
        propagation_speed=speed.value if speed.relative > 0 else None,
        propagation_speed_sigma=speed.sigma if speed.relative > 0 else None,
        wind=wind.mean,
        wind_covariance=wind.covariance,
        relative_range_sigma=found["relative_range_sigma"],
        **fields_of(found),
    )


def _by_station(
    measured: Mapping[Kind, FloatArray], sigmas: Mapping[Kind, FloatArray], shape: tuple[int, int]
) -> tuple[FloatArray, FloatArray]:
    """Return measurements and their standard deviations, (N, 5, K), without impossible ranges."""
    values, own = np.full((2, shape[0], len(KINDS), shape[1]), np.nan)
    for kind, array in measured.items():
        at, first = KINDS.index(kind), int(kind == "range_difference")
        values[:, at, first:], own[:, at, first:] = array, sigmas[kind]
        if kind == "range":
            values[:, at][~near_enough(array, sigmas[kind])] = np.nan
    return values, own


def _usual(sigmas: FloatArray, values: FloatArray) -> FloatArray:
    """Return the median standard deviation of the measurements of each station and kind, (5, K)."""
    measured = np.where(np.isnan(values), np.nan, sigmas)
    with warnings.catch_warnings():
        # of what was not measured there is none
        warnings.simplefilter("ignore", RuntimeWarning)
        return np.asarray(np.nanmedian(measured, axis=0))


def _smoothed(mean: FloatArray, found: Sequence[Any]) -> SmoothedPositions:
    """Return the path as `SmoothedPositions`, whose outliers are those of the measurements."""
    covariance, innovation, log_likelihood, count, (jerk, jerk_sigma, wandering) = found
    return SmoothedPositions(
        mean,
        covariance,
        innovation,
        log_likelihood,
        count,
        jerk,
        jerk_sigma,
        wandering,
        outlier=np.zeros(len(mean), dtype=np.bool_),
        correlation_time=0.0,
        noise_factor=1.0,
    )


_NO_PATH = {
    "mirrored": "two paths explain the measurements (almost) equally well: a path and its mirror "
    "image, neither of which is above the stations; give initial, or measure something else",
    "unbounded": "the measurements do not determine a path: a covariance is singular, too large or "
    "too small; measure something else, give jerk or initial, or check sigmas and degrees",
    "diverged": "no path was found that agrees with the measurements; give jerk or initial, or "
    "check the positions, sigmas and clocks of the stations",
}


def _raise(failure: tuple[str, list[int]], stations: Sequence[Station]) -> NoReturn:
    why, numbers = failure
    k = len(stations)
    if why == "not-located":
        reasons = [LocationStatus(number).message for number in numbers]
        reasons += ["from one station, `locate` finds targets that rest"] * (k == 1)
        raise ValueError(f"no instant can be located: {'; '.join(reasons)}")
    if why in _NO_PATH:
        raise ValueError(_NO_PATH[why])
    called = [one.name or f"station {at}" for at, one in enumerate(stations)]
    named = ", ".join(f"{KINDS[number // k]} of {called[number % k]}" for number in numbers)
    if why == "unusable":
        raise ValueError(f"biases of {named} cannot be estimated: nothing usable was measured")
    why = "together they move the positions and change no residual"
    raise ValueError(f"biases of {named} are not observable: {why}")


def _initial(initial: npt.ArrayLike | None, d: int, *, flat: bool) -> list[float] | None:
    """Return a position in the D coordinates in which the path is estimated."""
    if initial is None:
        return None
    start, given = finite(initial, "initial"), d + int(flat)
    if start.shape != (given,):
        raise ValueError(f"initial has shape {start.shape}; it must be ({given},)")
    return [float(v) for v in start[:d]]


def _places(
    stations: Sequence[Station], n: int
) -> tuple[FloatArray, FloatArray | None, dict[Kind, FloatArray]]:
    """Return positions, (K, D) or (N, K, D), axes, and position sigmas, (K,)."""
    if not isinstance(stations, Sequence) or not all(isinstance(s, Station) for s in stations):
        raise TypeError("stations must be a sequence of Station")
    if not stations:
        raise ValueError("stations is empty; it must have at least one")
    places, axes, sigmas = stack_stations(stations)
    if places.ndim > 3 or (places.ndim == 3 and len(places) != n):
        raise ValueError(
            f"stations have positions of shape {places.shape[:-2]}; there are {n} instants"
        )
    return places, axes, {kind: sigmas[kind] for kind in (*STATION_KINDS, "arrival_time")}


def _checked(
    values: npt.ArrayLike,
    sigma: FloatArray | None,
    kind: Kind,
    shape: tuple[int, int],
    *,
    degrees: bool,
) -> FloatArray:
    """Return measurements, after checking them and that each has a standard deviation."""
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
    if sigma.shape not in {(count,), (n, count)}:
        each = "" if kind == "range_difference" else f" or ({n}, {count})"
        raise ValueError(f"{kind}_sigma has shape {sigma.shape}; it must be ({count},){each}")
    missing = np.argwhere(np.isnan(sigma) & ~np.isnan(array))
    if missing.size:
        raise ValueError(f"{kind}_sigma of station {missing[0][1]} is missing")
    return checked(array, kind, k, sigma=sigma)


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
    """Raise an error for options of `reconstruct` that are wrong whatever the measurements are."""
    chosen = {"order": (order, Order), "spatial": (spatial, Spatial)}
    for name, (value, allowed) in {**chosen, "smoother": (smoother, Smoother)}.items():
        choice(value, name, get_args(allowed))
    if smoother == "local-polynomial":
        # an empty series: the window and degree are judged alone
        local_polynomial(np.empty(0), window, degree, max_degree=0)
    if jerk is not None and not 0 <= real(jerk, "jerk") < np.inf:
        raise ValueError(f"jerk is {jerk}; it must not be negative")
    if bias is not None:
        instance(bias, "bias", Bias)
        sigmas = [getattr(bias, f"{error}_sigma") for error in ERRORS.values()]
        asked = any(sigma is None or np.any(sigma) for sigma in sigmas)
        if asked and (order, smoother) != ("spatial-first", "rts"):
            raise ValueError("bias needs order 'spatial-first' and smoother 'rts'")


def _require_order(
    way: tuple[Order, Smoother],
    axes: FloatArray | None,
    surveys: FloatArray | None,
    medium: tuple[Speed, Wind],
    *,
    is_timed: bool,
) -> None:
    """Raise an error if the chosen order or smoother does not support the input."""
    if way[0] == "temporal-first" and is_timed:
        raise ValueError("arrival_time needs order 'spatial-first': each emission has its own time")
    if way[0] == "temporal-first" and axes is not None and axes.ndim > 3:
        raise ValueError("axes of stations change over time; order must be 'spatial-first'")
    if surveys is not None and way != ("spatial-first", "rts"):
        raise ValueError(
            "position_sigma of stations needs order 'spatial-first' and smoother 'rts'"
        )
    names = ("propagation_speed_sigma", "wind_sigma")
    sigmas = (0.0 if one.as_stated else one.relative for one in medium)
    for name, sigma in zip(names, sigmas, strict=True):
        if sigma > 0 and way != ("spatial-first", "rts"):
            raise ValueError(f"{name} needs order 'spatial-first' and smoother 'rts'")
