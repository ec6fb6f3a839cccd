"""The density of positions of a few bearings."""

from __future__ import annotations

import warnings

import numpy as np

from tertia import _core
from tertia._arrays import BoolArray, FloatArray, positive_number, scalar_or_array
from tertia.location._bias import said
from tertia.location._result import Location, LocationStatus
from tertia.location._scene import Scene
from tertia.sensors._kinds import KINDS
from tertia.sensors._sensors import by_kind

# median of what radio telemetry reports (Gerber et al. 2018), where nothing is stated
_SIGMA = np.radians(5.0)
# so much of a density near the limit of range means that the limit made it
_EDGE = 0.05
_AZIMUTH = KINDS.index("azimuth")


def locate_posterior(
    places: FloatArray,
    axes: FloatArray | None,
    values: FloatArray,
    stated: FloatArray,
    surveys: FloatArray | None,
    *,
    max_range: float | None,
    pooled: bool,
    free: BoolArray,
    n_threads: int | None,
) -> Location:
    """Return expected positions with their covariances; see `locate`."""
    if surveys is not None:
        raise ValueError("stations have a position_sigma; method='posterior' takes them as exact")
    if max_range is None:
        raise ValueError("max_range is missing; method='posterior' needs it")
    limit = positive_number(max_range, "max_range")
    sigmas = np.where(np.isnan(stated), _SIGMA, stated)
    position, covariance, residual, weights, columns = _core.locate_posterior(
        places, axes, values, sigmas, limit, pooled, n_threads
    )
    statuses, bearings, factor, edge = columns
    _warn_of_limit(edge)
    outlier = np.zeros(residual.shape, dtype=bool)
    measured = ~np.isnan(values[..., _AZIMUTH, :])
    with np.errstate(invalid="ignore", divide="ignore"):
        total = np.sum(np.where(measured, sigmas[..., _AZIMUTH, :], 0.0), axis=-1)
        size = total.reshape(bearings.shape) / bearings
    status = statuses.astype(np.int64)
    unknown = np.full(factor.shape, np.nan)
    statistic = np.where(np.isnan(factor), np.nan, np.nansum(residual**2, axis=(-2, -1)))
    return Location(
        position=position,
        covariance=covariance,
        residual=by_kind(residual, ["azimuth"]),
        outlier=by_kind(outlier, ["azimuth"]),
        degrees_of_freedom=scalar_or_array(bearings.astype(np.int64) - 2),
        statistic=scalar_or_array(statistic),
        pvalue=scalar_or_array(unknown),
        dop=scalar_or_array(unknown),
        measurement_sigma=scalar_or_array(factor * size),
        emission_time=None,
        emission_time_sigma=None,
        status=LocationStatus(int(statuses)) if position.ndim == 1 else status,
        systematic=said(free, tells=bool(np.any(bearings > position.shape[-1]))),
        _scene=Scene(
            places,
            axes,
            values,
            sigmas,
            outlier=outlier.astype(np.float64),
            max_range=limit,
            weights=weights,
        ),
    )


def _warn_of_limit(edge: FloatArray) -> None:
    beyond = int(np.count_nonzero(edge > _EDGE))
    if beyond:
        warnings.warn(
            f"{beyond} of {edge.size} positions have more than {_EDGE:.0%} of their probability at "
            "max_range, which determines them; it may be too small",
            stacklevel=4,
        )
