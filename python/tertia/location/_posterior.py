"""The posterior density of positions from a few bearings."""

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
# a sigma so many times what bearings scatter by where they meet is that of random bearings; of true
# sigmas up to 25° it was at most 1.5 times as large
_RANDOM = 2.0
# as long as so many instants have bearings that meet
_MEETING = 0.5


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
        (places, axes, values, sigmas), limit, pooled, n_threads
    )
    statuses, bearings, factor, edge = columns
    if pooled:
        _require_bearings((places, axes, values, sigmas), factor, n_threads)
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
            outlier=outlier,
            max_range=limit,
            weights=weights,
        ),
    )


def _require_bearings(
    rows: tuple[FloatArray, FloatArray | None, FloatArray, FloatArray],
    factor: FloatArray,
    n_threads: int | None,
) -> None:
    """Raise an error if bearings that intersect are nevertheless explained as random directions."""
    free = [True] * rows[2].shape[-1] * len(KINDS)
    *_, columns, found, _ = _core.locate(
        *rows,
        None,
        None,
        None,
        ("least-squares", 1),
        (True, 0.0),
        free,
        True,
        (0.0, 0.0, (False, False)),
        n_threads,
    )
    statuses, degrees = np.ravel(columns[0]), np.ravel(columns[1])
    telling, known = degrees > 0, np.isfinite(factor)
    scatter = np.sqrt(found[1][_AZIMUTH])
    if not telling.any() or not known.any() or np.mean(statuses[telling] == 0) < _MEETING:
        return
    pooled = float(np.median(factor[known]))
    if pooled > _RANDOM * scatter > 0:
        raise ValueError(
            "max_range is too large for method='posterior' with pooled=True: random bearings "
            f"explain the record, with a sigma {pooled / scatter:.1f} times the scatter of the "
            "bearings where they meet; give the largest distance at which targets are heard, or "
            "azimuth_sigma"
        )


def _warn_of_limit(edge: FloatArray) -> None:
    beyond = int(np.count_nonzero(edge > _EDGE))
    if beyond:
        warnings.warn(
            f"{beyond} of {edge.size} positions have more than {_EDGE:.0%} of their probability at "
            "max_range, which determines them; it may be too small",
            stacklevel=4,
        )
