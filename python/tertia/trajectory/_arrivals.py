"""Trajectories from arrival times at receivers with unsynchronised clocks."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, NoReturn, TypeAlias

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import FloatArray, Systematic, finite, instance, positive, real, require_each
from tertia.sensors import Station
from tertia.sensors._sensors import stack_stations
from tertia.trajectory._arrivals_result import Arrivals, ArrivalTrajectory
from tertia.trajectory._clocks import ClockBias
from tertia.trajectory._surveys import solve_without_wrong_surveys

Beacon: TypeAlias = int | Station | npt.ArrayLike

# residual beyond which an arrival is an outlier
_OUTLIER = 4.0
_MIRRORED = (
    "the receivers are nearly in a plane, and the mirror images of the positions at this plane fit "
    "the arrivals (almost) equally well; if one side is above the receivers, positions are there"
)
# largest differences of the heights of receivers near a plane, relative to their horizontal extent
_FLAT = 0.2
# share of the extent of the net to which times must be resolved
_RESOLUTION = 1e-4


def group_arrivals(arrivals: Arrivals) -> Arrivals:
    """Find which arrivals belong to the same emission, even if clocks are not synchronised.

    Parameters
    ----------
    arrivals : Arrivals
        The arrivals. The emitters must emit at irregular intervals, or each at an interval of its
        own, because the offsets of clocks are found by comparing intervals.

    Returns
    -------
    Arrivals
        The same arrivals with `emission`. It is -1 for repeated arrivals (echoes) of an emission at
        a receiver, and for the arrivals at receivers that have too few emissions in common with the
        others.

    Raises
    ------
    TypeError
        If `arrivals` is not an `Arrivals`.

    Notes
    -----
    Receivers are added one after the other. The distribution of the differences between all
    arrivals at a receiver and the known emissions of the same identity has a peak at the offset of
    the receiver's clock. The peak is the window with the largest excess of differences over its
    surroundings. An identity with a constant interval has a peak at every multiple of it. Of these
    peaks, the one is used at which each identity has more arrivals than at most of them or, if none
    of the identities distinguishes them, the one with the smallest offset. A line of least absolute
    deviations through the differences in the peak gives the rate of the clock. When all arrivals
    have been converted to one clock, a new emission begins wherever the gap between successive
    times is larger than half the width of the widest peak. `reconstruct_arrivals` groups arrivals
    in the same way, and also uses the travel times of the signal between receivers.

    The cost is O(N log N), with at most two million differences for each receiver.

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.trajectory import Arrivals, group_arrivals
    >>> emitted = np.cumsum(np.random.default_rng(1).uniform(20, 40, 30))
    >>> time = np.concatenate([emitted, emitted + 71.3])  # the second clock is 71.3 s fast
    >>> group_arrivals(Arrivals(time, np.repeat([0, 1], 30), np.full(60, 7)))
    Arrivals(60 arrivals in 30 emissions of 1 identity at 2 receivers)
    """
    instance(arrivals, "arrivals", Arrivals)
    _, identity = np.unique(arrivals.identity, return_inverse=True)
    found = _core.group_arrivals(arrivals.time, arrivals.sensor.tolist(), identity.tolist())
    emission = [-1 if one is None else one for one in found]
    return Arrivals(arrivals.time, arrivals.sensor, arrivals.identity, emission)


def reconstruct_arrivals(
    stations: Sequence[Station],
    arrivals: Arrivals,
    *,
    beacons: Mapping[Any, Beacon] | None = None,
    propagation_speed: float,
    propagation_speed_sigma: float = 0.0,
    path_sigma: float | None = None,
    clock_drift: float | None = None,
    jerk: float | None = None,
) -> ArrivalTrajectory:
    """Reconstruct trajectories from arrival times at receivers with unsynchronised clocks.

    Parameters
    ----------
    stations : sequence of K Station
        The receivers, which must not move. `position_sigma` is the standard deviation of their
        survey. `arrival_time_sigma`, if given, determines the relative weights of the receivers; a
        common factor of these sigmas is always estimated. A receiver with `bias=Bias(time=...)` has
        a known clock, which defines the time base. If no clock is known, the clock of the first
        station defines it.
    arrivals : Arrivals
        The arrivals, grouped into emissions or not; see `group_arrivals`.
    beacons : mapping, optional
        Positions of the emitters that do not move, by identity. A position is the number of a
        station, an array of shape (D,), or a `Station` with a `position_sigma`. All other emitters
        move.
    propagation_speed, propagation_speed_sigma : float
        Speed of the signal (sound or light) in m/s, and its standard deviation, which is 0 if the
        speed is known.
    path_sigma : float, optional
        Standard deviation, in seconds, of an error that all arrivals from one beacon at one
        receiver share; by default it is estimated.
    clock_drift : float, optional
        Intensity of the random walk of the clocks' rates, in 1/sqrt(s); by default it is estimated.
    jerk : float, optional
        Intensity of the white jerk of moving identities in m²/s⁵, without white acceleration; by
        default the intensities of both are estimated for each identity.

    Returns
    -------
    ArrivalTrajectory
        Positions, velocities and accelerations with their covariance; also the clocks, the
        positions of the receivers and the propagation speed.

    Raises
    ------
    ValueError
        If a shape is wrong, a number is outside its domain, times are too large to resolve the
        travel times, receivers have too few emissions in common with the others, or an unknown is
        not determined by the arrivals.
    TypeError
        If an argument has the wrong type.

    Warns
    -----
    UserWarning
        If receivers are nearly in a plane, and it is open on which side of it the emitters are, or
        emitters are found below all receivers. If the arrivals contradict the surveyed position of
        a receiver, which is then estimated almost without its survey (see Notes).

    Notes
    -----
    An arrival at receiver h of an emission e from a beacon b is modelled as

        t = T_e + |p_e - s_h| / c + o_h(t) + m_bh + error,

    The errors have Student's distribution with 3 degrees of freedom and an estimated scale. The
    clock offset o_h is linear between nodes. Its rate, which has a standard deviation of 1e-4, is a
    random walk. s_h and c have the given standard deviations, m_bh is constant for a beacon and a
    receiver, and p_e is driven by white jerk and white acceleration. All these unknowns are
    estimated together, by scoring steps; the intensities are estimated by MacKay's fixed-point
    iteration. The information of an arrival is computed from the residuals as mean(psi')^2 /
    mean(psi^2) (Huber 1964), so that the covariance remains correct if the distribution of the
    residuals is not Student's.

    If the receivers are near a plane, emissions fit almost as well at their mirror images. If any
    is found below the receivers, or emissions are found on both sides of a plane that is not level,
    all are estimated on each side. The likelier side is taken, at prior odds of a thousand to one
    for that above the receivers.

    If the position of a receiver is so far from its survey that this happens by chance in one of a
    million nets, everything is estimated again with 30 times the `position_sigma` of the worst one.
    The result is used if it contradicts no survey. At most one of four surveys is taken for wrong.

    If many surveyed positions are wrong by more than `position_sigma`, or the motion is much
    smoother than assumed, the estimated propagation speed is wrong. To detect this, check
    `propagation_speed_deviation`.

    The model is that of Baktoft et al., Scientific Reports 7 (2017) 14294, but without a separate
    synchronisation of the clocks.

    The cost is about N (K D)^2 per step.

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.trajectory import Arrivals, Station, reconstruct_arrivals
    >>> rng = np.random.default_rng(1)
    >>> places = np.array([[0.0, 0.0], [300.0, 20.0], [280.0, 310.0], [-10.0, 290.0], [150.0, 400]])
    >>> emitted = np.cumsum(rng.uniform(10, 30, 120))
    >>> source = np.column_stack([50 + 0.1 * emitted, 100 + 40 * np.sin(emitted / 200)])
    >>> identity = np.where(np.arange(120) % 3 == 0, 1, 2)  # identity 1 is at the second receiver
    >>> source[identity == 1] = places[1]
    >>> travel = np.linalg.norm(source[:, np.newaxis] - places, axis=-1) / 1500
    >>> clock = np.array([0, 31.0, -12.0, 5.0, 77.0]) + 1e-5 * emitted[:, np.newaxis] * np.arange(5)
    >>> time = emitted[:, np.newaxis] + travel + clock + 2e-4 * rng.standard_normal((120, 5))
    >>> heard = Arrivals(time.ravel(), np.tile(np.arange(5), 120), np.repeat(identity, 5))
    >>> stations = [Station(place, position_sigma=0.5) for place in places]
    >>> track = reconstruct_arrivals(
    ...     stations, heard, beacons={1: 1}, propagation_speed=1500, propagation_speed_sigma=5
    ... )
    >>> error = np.linalg.norm(track.position - source[identity == 2], axis=1)
    >>> bool(np.median(error) < 1.0)
    True
    """
    known = _receivers(stations)
    instance(arrivals, "arrivals", Arrivals)
    heard = arrivals
    k, places = len(known), _places(known)
    if np.max(heard.sensor) >= k:
        raise ValueError(f"arrivals have sensor {np.max(heard.sensor)}; there are {k} stations")
    speed = float(positive(real(propagation_speed, "propagation_speed"), "propagation_speed"))
    _not_negative(propagation_speed_sigma, "propagation_speed_sigma")
    if path_sigma is not None:
        _not_negative(path_sigma, "path_sigma")
    for name, number in (("clock_drift", clock_drift), ("jerk", jerk)):
        if number is not None:
            positive(real(number, name), name)
    _refuse_coarse(heard.time, speed, places)
    names, identity = np.unique(heard.identity, return_inverse=True)
    sites, site_sigma, beacon = _beacons(beacons, names, known, places)
    is_base, offset = _time_base(known)
    sigma, _ = _sigmas(known, speed)
    called = [one.name or f"station {at}" for at, one in enumerate(known)]
    found = solve_without_wrong_surveys(
        partial(
            _core.reconstruct_arrivals,
            recorded={
                "time": heard.time - offset[heard.sensor],
                "sensor": heard.sensor.tolist(),
                "identity": identity.tolist(),
                "emission": _emission(heard),
            },
        ),
        {
            "sites": sites,
            "site_sigma": site_sigma,
            "sigma": sigma,
            "is_base": is_base,
            "beacon": beacon,
            "speed": speed,
            "speed_sigma": float(propagation_speed_sigma),
            "path_sigma": None if path_sigma is None else float(path_sigma) * speed,
            "clock_drift": None if clock_drift is None else float(clock_drift),
            "jerk": None if jerk is None else float(jerk),
        },
        called,
    )
    if found["failure"] is not None:
        why, numbers = found["failure"]
        _raise(why, numbers, known, names)
    _warn_of_sides(found, sites[:k])
    prior = (speed, float(propagation_speed_sigma))
    systematic = _systematic(path_sigma, beacon, site_sigma)
    return _result(found, heard, (known, names), prior, systematic)


def _warn_of_sides(found: dict[str, Any], sites: FloatArray) -> None:
    """Warn if mirror images fit as well, or if positions are below all receivers."""
    if found["is_mirrored"]:
        warnings.warn(_MIRRORED, UserWarning, stacklevel=3)
    extent = np.ptp(sites, axis=0)
    if len(extent) < 3 or extent[2] > _FLAT * np.hypot(extent[0], extent[1]):
        return
    sigma = np.sqrt(found["covariance"][:, 2, 2])
    below = found["mean"][:, 2] + 3.0 * sigma < np.min(sites[:, 2])
    if np.any(below):
        warnings.warn(
            f"{np.count_nonzero(below)} of {len(below)} positions are below all receivers; if the "
            "emitters are above them, heights of receivers are wrong by more than their "
            "position_sigma",
            UserWarning,
            stacklevel=3,
        )


def _result(
    found: dict[str, Any],
    heard: Arrivals,
    known: tuple[tuple[Station, ...], npt.NDArray[Any]],
    prior: tuple[float, float],
    systematic: Systematic,
) -> ArrivalTrajectory:
    (stations, names), (speed, speed_sigma) = known, prior
    sigma, stated = _sigmas(stations, speed)
    _, offset = _time_base(stations)
    d = stations[0].position.shape[-1]
    moving = np.array(found["moving"], dtype=np.int64)
    owner = np.array(found["identity"], dtype=np.int64)[moving]
    rows = np.array([-1 if row is None else row for row in found["row"]], dtype=np.int64)
    used = rows >= 0
    residual, emission = np.full(len(heard), np.nan), np.full(len(heard), -1)
    residual[used] = found["residual"][rows[used]]
    emission[used] = np.array(found["emission"])[rows[used]]
    clock, variance, covariance = (table.T for table in found["clock"])
    mean, (place, place_sigma) = found["mean"], found["site"]
    estimated, estimated_sigma = found["speed"]
    return ArrivalTrajectory(
        time=found["time"][moving],
        time_sigma=found["time_sigma"][moving],
        target=names[owner],
        position=mean[:, :d],
        velocity=mean[:, d : 2 * d],
        acceleration=mean[:, 2 * d :],
        covariance=found["covariance"],
        systematic=systematic,
        arrivals=Arrivals(heard.time, heard.sensor, heard.identity, emission),
        residual=residual,
        outlier=np.abs(residual) > _OUTLIER,
        bias=ClockBias(found["node"], clock + offset[:, np.newaxis], variance, covariance[:, :-1]),
        stations=tuple(
            Station(
                place[at],
                arrival_time_sigma=found["noise_factor"] * sigma[at] / speed,
                position_sigma=float(np.sqrt(np.mean(place_sigma[at] ** 2))),
                name=stations[at].name,
            )
            for at in range(len(stations))
        ),
        arrival_time_sigma=found["noise_factor"] * float(np.mean(sigma)) / speed,
        noise_factor=found["noise_factor"] if stated else np.nan,
        propagation_speed=estimated,
        propagation_speed_sigma=estimated_sigma,
        propagation_speed_deviation=(estimated - speed) / speed_sigma if speed_sigma else np.nan,
        path_sigma=found["path_sigma"] / speed,
        clock_drift=found["clock_drift"],
        jerk={names[one].item(): found["jerk"][one] for one in np.unique(owner)},
        acceleration_noise={
            names[one].item(): found["acceleration_noise"][one] for one in np.unique(owner)
        },
        degrees_of_freedom=found["degrees_of_freedom"],
        iterations=found["iterations"],
        success=found["is_converged"],
    )


def _receivers(stations: Sequence[Station]) -> tuple[Station, ...]:
    if not isinstance(stations, Sequence) or not all(isinstance(s, Station) for s in stations):
        raise TypeError("stations must be a sequence of Station")
    if len(stations) < 2:
        raise ValueError(f"there are {len(stations)} stations; at least 2 are needed")
    return tuple(stations)


def _places(stations: tuple[Station, ...]) -> FloatArray:
    places, _, _ = stack_stations(stations)
    if places.ndim != 2:
        raise ValueError("stations move; receivers must stay where they are")
    return places


def _not_negative(value: float, name: str) -> None:
    number = finite(real(value, name), name)
    require_each(number, number >= 0, name, "0 or positive")


def _refuse_coarse(time: FloatArray, speed: float, places: FloatArray) -> None:
    """Raise an error if the times are too large for the resolution of double precision."""
    extent = float(np.linalg.norm(np.ptp(places, axis=0)))
    if extent == 0:
        raise ValueError("stations are all at the same place")
    largest = float(np.max(np.abs(time)))
    step = float(np.spacing(largest)) * speed
    if step > _RESOLUTION * extent:
        raise ValueError(
            f"time is up to {largest:.3g} s, of which a float64 resolves {np.spacing(largest):.1g} "
            f"s, or {step:.2g} m of travel; subtract a common start before"
        )


def _beacons(
    beacons: Mapping[Any, Beacon] | None,
    names: npt.NDArray[Any],
    stations: tuple[Station, ...],
    places: FloatArray,
) -> tuple[FloatArray, FloatArray, list[int | None]]:
    """Return all positions, their sigmas, and which position each identity has (None: it moves)."""
    k, d = places.shape
    sites, sigmas = [*places], [station.position_sigma for station in stations]
    given = {} if beacons is None else beacons
    if not isinstance(given, Mapping):
        raise TypeError("beacons must be a mapping from identities to places")
    found: list[int | None] = []
    for name in names.tolist():
        place = given.get(name)
        if place is None:
            found.append(None)
        elif isinstance(place, (int, np.integer)) and not isinstance(place, bool):
            if not 0 <= place < k:
                raise ValueError(f"beacons[{name!r}] is station {place}; there are {k} stations")
            found.append(int(place))
        else:
            position = place.position if isinstance(place, Station) else place
            where = finite(position, f"beacons[{name!r}]")
            if where.shape != (d,):
                raise ValueError(f"beacons[{name!r}] has shape {where.shape}; it must be ({d},)")
            found.append(len(sites))
            sites.append(where)
            sigmas.append(place.position_sigma if isinstance(place, Station) else 0.0)
    return np.array(sites), np.array(sigmas, dtype=np.float64), found


def _time_base(stations: tuple[Station, ...]) -> tuple[list[bool], FloatArray]:
    """Return which clocks are known, and by how much each of them is fast."""
    is_base, offset = [], np.zeros(len(stations))
    for at, station in enumerate(stations):
        bias = station.bias
        sigma = None if bias is None else bias.time_sigma
        if sigma is not None and 0 < sigma < np.inf:
            raise ValueError(
                f"stations[{at}].bias.time_sigma is {sigma}; it must be 0 (the clock is a time "
                "base), or inf or None (it is estimated)"
            )
        is_base.append(sigma == 0)
        if bias is not None and sigma == 0:
            offset[at] = bias.time
    if not any(is_base):
        is_base[0] = True
    return is_base, offset


def _sigmas(stations: tuple[Station, ...], speed: float) -> tuple[FloatArray, bool]:
    """Return standard deviations of arrivals in metres, and whether they were given."""
    given = np.array(
        [np.nan if (s := station.arrival_time_sigma) is None else s for station in stations]
    )
    if np.all(np.isnan(given)):
        return np.ones(len(stations)), False
    return np.where(np.isnan(given), np.nanmedian(given), given) * speed, True


def _emission(heard: Arrivals) -> list[int | None] | None:
    if heard.emission is None:
        return None
    _, numbers = np.unique(heard.emission, return_inverse=True)
    return [
        None if given < 0 else int(number)
        for given, number in zip(heard.emission, numbers, strict=True)
    ]


def _systematic(
    path_sigma: float | None, beacon: list[int | None], site_sigma: FloatArray
) -> Systematic:
    if path_sigma is not None:
        return "given"
    if any(one is not None for one in beacon):
        return "estimated"
    return "given" if np.any(site_sigma > 0) else "not included"


def _raise(
    why: str, numbers: list[int], stations: tuple[Station, ...], names: npt.NDArray[Any]
) -> NoReturn:
    called = [one.name or f"station {at}" for at, one in enumerate(stations)]
    if why == "apart":
        listed = ", ".join(called[number] for number in numbers)
        raise ValueError(
            f"clocks of {listed} cannot be tied to the others: they share too few emissions"
        )
    if why == "nothing":
        raise ValueError("arrivals have no emission that two receivers heard")
    if why == "clock":
        raise ValueError(f"the clock of {called[numbers[0]]} is not determined by the arrivals")
    if why == "motion":
        raise ValueError(f"the motion of {names[numbers[0]]} is not determined by the arrivals")
    raise ValueError("the arrivals determine neither the clocks nor the speed of propagation")
