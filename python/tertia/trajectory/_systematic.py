"""Systematic errors of the stations that reconstruct a trajectory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from tertia._arrays import BoolArray, FloatArray
from tertia.location._arrivals import Arrivals
from tertia.location._bias import ERRORS, Given
from tertia.sensors import Bias, Kind, Station
from tertia.sensors._kinds import ANGLES, KINDS, STATION_KINDS

# fields of a bias that do not depend on the direction
_CONSTANT = (
    *ERRORS.values(),
    *(f"{error}_sigma" for error in ERRORS.values()),
    "drift_share",
    "drift_time",
)
# row of the clocks among the given errors
_CLOCK = [*ERRORS].index("arrival_time")


def clocks_of(
    given: Given, measured: dict[Kind, FloatArray], way: tuple[str, str], *, deviates: bool
) -> list[float] | None:
    """Return the given errors of the clocks of ranges and angles, (K,); None if there are none.

    With times of arrival, errors of clocks are errors of these times.
    """
    errors = given.value[_CLOCK]
    unsure = np.nan_to_num(given.sigma[_CLOCK]) > 0
    if "arrival_time" in measured or not (np.any(errors) or np.any(unsure)):
        return None
    name = "bias.time" if np.any(errors) else "bias.time_sigma"
    if "range_difference" in measured:
        raise ValueError(f"{name} is given, but range differences have no time of one clock")
    if not measured.keys() & {*STATION_KINDS}:
        raise ValueError(f"{name} is given, but nothing was measured that depends on a clock")
    if way != ("spatial-first", "rts"):
        raise ValueError(f"{name} needs order 'spatial-first' and smoother 'rts'")
    if deviates:
        raise ValueError(f"{name} is given, but a bias deviates with the azimuth")
    return [float(error) for error in errors]


def without_deviations(
    stations: Sequence[Station], bias: Bias | None, azimuth: FloatArray | None
) -> tuple[tuple[FloatArray, FloatArray] | None, Sequence[Station], Bias | None]:
    """Return azimuth deviations, (N, K), their sigmas, and the stations and bias without them."""
    own = [bias] * len(stations) if bias is not None else [station.bias for station in stations]
    if not any(one is not None and one.deviation_order > 0 for one in own):
        return None, stations, bias
    if azimuth is None:
        raise ValueError("bias has a deviation with the azimuth, but azimuth was not measured")
    curve, sigma, sources = np.zeros(azimuth.shape), np.zeros(azimuth.shape), []
    for k, (station, one) in enumerate(zip(stations, own, strict=True)):
        rest = one
        if one is not None and one.deviation_order > 0:
            value, total = one.at(one._without(np.nan_to_num(azimuth[:, k])))
            # what is constant stays with the others, what drifts is not in the covariance
            constant = float(one.at()[1]) ** 2
            drift = (
                constant
                if one.deviation_covariance is None
                else max(constant - one.deviation_covariance[0, 0], 0.0)
            )
            curve[:, k], sigma[:, k] = value - one.azimuth, np.sqrt(np.maximum(total**2 - drift, 0))
            fields = {name: getattr(one, name) for name in _CONSTANT}
            if one.deviation_covariance is not None:
                fields |= {"azimuth_sigma": np.sqrt(drift), "drift_share": 1.0}
            rest = Bias(**fields)
        sources.append(replace(station, bias=rest))
    return (curve, sigma), sources, None if bias is None else sources[0].bias


def prior_of(
    given: Given,
    bias: Bias | None,
    stations: Sequence[Station],
    measured: dict[Kind, FloatArray],
    arrivals: Arrivals | None,
) -> dict[str, Any]:
    """Return the prior of the systematic errors for the core."""
    k = given.sigma.shape[1]
    flat: BoolArray = np.array([np.isinf(row).any() for row in given.sigma])
    for at, (kind, error) in enumerate(ERRORS.items()):
        if bias is not None and getattr(bias, f"{error}_sigma") is None and kind not in measured:
            clocks = "; for the clocks of ranges and angles, give it in seconds"
            clocks = clocks if kind == "arrival_time" else ""
            raise ValueError(f"bias.{error}_sigma is None, but {kind} was not measured{clocks}")
        if flat[at] and kind == "arrival_time":
            instead = ", or None to be estimated" if kind in measured else ""
            raise ValueError(f"bias.time_sigma is inf; it must be finite{instead}")
        if flat[at] and not np.isinf(given.sigma[at]).all():
            raise ValueError(
                f"bias.{error}_sigma is inf for some stations; it must be for all or none"
            )
        if flat[at] and kind not in measured:
            raise ValueError(f"bias.{error}_sigma is inf, but {kind} was not measured")
    if np.any(flat) and np.any(given.sigma[~flat] != 0):
        raise ValueError("bias has a sigma of inf; those of the other kinds must be 0 or inf")
    # the clocks of what is not a time of arrival come last
    sigma = np.zeros((len(KINDS) + 1, k))
    for kind, row in zip(ERRORS, given.sigma, strict=True):
        sigma[KINDS.index(kind)] = row * np.median(unit_of(kind, arrivals))
    if np.isnan(given.sigma[0]).all():
        # ranges are not trusted, and neither are their differences
        sigma[KINDS.index("range_difference")] = np.nan
    if arrivals is None:
        sigma[-1] = np.nan_to_num(given.sigma[_CLOCK])
    own = [bias] * k if bias is not None else [station.bias for station in stations]
    drift = np.array(
        [
            [np.nan if one is None or (v := getattr(one, name)) is None else v for one in own]
            for name in ("drift_share", "drift_time")
        ]
    )
    shares, times = np.tile(drift, (1, len(sigma))).reshape(2, -1)
    shares[-k:] = 0.0  # clocks are constant
    return {
        "flat": np.flatnonzero(flat).tolist() if np.any(flat) else None,
        "bias_sigma": sigma.ravel().tolist(),
        "drift_share": shares.tolist(),
        "drift_time": times.tolist(),
        "deviation": None,
    }


def bias_of(
    given: Given,
    found: tuple[list[float], list[float], float, float, bool] | None,
    arrivals: Arrivals | None,
) -> Bias | None:
    """Return the given and the estimated biases; None if there are neither."""
    fields: dict[str, Any] = {}
    for at, error in enumerate(ERRORS.values()):
        fields |= {error: given.value[at], f"{error}_sigma": given.sigma[at]}
    if found is None:
        return None if np.isnan(given.sigma).any() else Bias(**fields)
    values, sigmas, share, time, _ = found
    own = np.reshape([values, sigmas], (2, len(KINDS) + 1, -1))
    for kind, error in ERRORS.items():
        is_clock = kind == "arrival_time" and arrivals is None
        at = len(KINDS) if is_clock else KINDS.index(kind)
        value, sigma = own[:, at] / np.median(unit_of(kind, arrivals))
        # no angle is less known than one that is uniform
        most = np.pi / np.sqrt(3.0) if kind in ANGLES else np.inf
        least = np.where(np.isinf(sigma), np.inf, np.minimum(sigma, most))
        fields |= {error: fields[error] + value, f"{error}_sigma": least}
    return Bias(**fields, drift_share=share, drift_time=time)


def unit_of(kind: Kind, arrivals: Arrivals | None) -> FloatArray:
    """Return the factor that converts a systematic error to the unit of the core."""
    if kind != "arrival_time" or arrivals is None:
        return np.ones(())
    return arrivals.speed[..., np.newaxis]
