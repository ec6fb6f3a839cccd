"""Combination of the measurements of a stationary target into one per sensor and kind."""

from __future__ import annotations

import warnings

import numpy as np
import polars as pl

from tertia._arrays import BoolArray, FloatArray
from tertia.bearing import estimate_bearing
from tertia.location import locate
from tertia.screening import unwrap_about_median
from tertia.sensors import Kind, Station
from tertia.tables._sensors import Sensors

# with fewer measurements, their scatter cannot be estimated
_FEWEST = 5
# with this many measurements, the scatter determines the noise as well as the stated sigma does
_MANY = 40
# periods of the kinds that wrap
PERIODS = {"azimuth": 360.0}
# kinds for which one position is estimated from measurements at different times
_COMMON: tuple[Kind, ...] = ("range", "azimuth", "elevation")
# quantile of the normal distribution that is exceeded with a probability of 5 %
_QUANTILE = 1.645
# median of absolute residuals in sigmas if a fifth of them are outliers; sigma of this median,
# times the root of the number of residuals
_MEDIAN, _SPREAD = 0.89, 0.8
# sigmas of that median beyond which the noise is not as stated, smallest number of residuals for
# this test, and largest factor that counts as noise
_DOUBT, _ENOUGH, _MOST = 2.5, 8, 4.0


def stated_sigmas(rows: pl.DataFrame, sensors: Sensors[Station]) -> FloatArray:
    """Return the sigma of each row in its unit, or that of its sensor; nan if neither is stated."""
    found = rows["sigma"].to_numpy().astype(np.float64)
    for row in np.flatnonzero(np.isnan(found)).tolist():
        kind = rows["kind"][row]
        own = getattr(sensors.items[rows["site"][row]], f"{kind}_sigma", None)
        if own is not None:
            found[row] = own if kind == "range" else np.degrees(own)
    return found


def combined(
    rows: pl.DataFrame, name: str, sensors: Sensors[Station] | None
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Return one row per sensor and kind, and all rows with `outlier`, null where unknown.

    If a sensor has fewer than 40 measurements and all have a sigma, the measurements that do not
    fit the position estimated from all `sensors` are left out. The others are averaged; the sigma
    of the mean follows from the stated sigmas, and is larger if the measurements scatter more or
    are correlated. Otherwise a bearing is estimated for each sensor alone; fewer than five
    measurements are replaced by their median, with the sigma of a single measurement.
    """
    found = None if sensors is None else _search(rows, sensors)
    rows = rows.with_columns(
        pl.lit(None, dtype=pl.Boolean).alias("outlier"), pl.col("sigma").alias("grown")
    )
    if found is not None:
        rows = rows.with_columns(outlier=found[0], grown=found[1])
    means, singles = [rows.clear()], [rows.clear()]
    for one in rows.partition_by("site", "kind", maintain_order=True):
        middle = one[(one.height - 1) // 2]
        if 1 < one.height < _MANY and found is not None and not one["outlier"].all():
            value, own = _mean_of(one)
            marks = one["outlier"]
        else:
            value, own, marks = _estimate_of(one, name)
        means.append(middle.with_columns(value=pl.lit(value), sigma=pl.lit(own)))
        singles.append(one.with_columns(marks.alias("outlier")))
    one_each = pl.concat(means).sort("seconds", maintain_order=True)
    return one_each.drop("outlier", "grown"), pl.concat(singles).drop("grown")


def _search(rows: pl.DataFrame, sensors: Sensors[Station]) -> tuple[BoolArray, FloatArray] | None:
    """Return the outliers about one common position, and the sigmas; None if there is no position.

    If the residuals of all sensors, or of one sensor, are too large for the sigmas, the sigmas are
    increased first. If the residuals of a sensor are even larger, its measurements are outliers.
    """
    sigma = stated_sigmas(rows, sensors)
    if len(rows) < _FEWEST or not np.isfinite(sigma).all():
        return None
    if not rows["kind"].is_in(_COMMON).all():
        return None
    found = _at_one_place(rows, sensors, sigma)
    if found is None:
        return None
    _, residual = found
    site, factor = rows["site"].to_numpy(), np.ones(len(rows))
    for own in (np.ones(len(rows), dtype=bool), *(site == one for one in np.unique(site))):
        count = int(own.sum())
        ratio = float(np.median(np.abs(residual[own]))) / _MEDIAN
        if count >= _ENOUGH and 1.0 + _DOUBT * _SPREAD / np.sqrt(count) < ratio < _MOST:
            factor[own] = ratio
    if np.any(factor > 1.0):
        sigma = sigma * factor
        found = _at_one_place(rows, sensors, sigma)
    return None if found is None else (found[0], sigma)


def _at_one_place(
    rows: pl.DataFrame, sensors: Sensors[Station], sigma: FloatArray
) -> tuple[BoolArray, FloatArray] | None:
    """Return the outliers and residuals of all rows for the position that fits most of the rows."""
    kinds = rows["kind"].to_numpy()
    items = [sensors.items[site] for site in rows["site"]]
    stations = [
        Station(one.position, axes=one.axes, bias=one.bias, position_sigma=one.position_sigma)
        for one in items
    ]
    options = {}
    for kind in _COMMON:
        own = kinds == kind
        if own.any():
            unit = 1.0 if kind == "range" else np.pi / 180
            options[str(kind)] = np.where(own, rows["value"].to_numpy() * unit, np.nan)[np.newaxis]
            options[f"{kind}_sigma"] = np.where(own, sigma * unit, 1.0)[np.newaxis]
    with warnings.catch_warnings():
        # here, contradictory bearings do not mean that degrees were given as radians
        warnings.simplefilter("ignore")
        found = locate(stations, **options)  # type: ignore[arg-type]
    if not np.all(found.success):
        return None
    outlier, residual = np.zeros(len(rows), dtype=bool), np.zeros(len(rows))
    for kind in _COMMON:
        own = kinds == kind
        if own.any():
            outlier[own] = getattr(found.outlier, kind)[0, own]
            residual[own] = getattr(found.residual, kind)[0, own]
    return outlier, residual


def _mean_of(rows: pl.DataFrame) -> tuple[float, float]:
    """Return the mean of the measurements that are not outliers, and its sigma."""
    kept = rows.filter(~pl.col("outlier"))
    values, period = kept["value"].to_numpy(), PERIODS.get(kept["kind"][0])
    near = values if period is None else unwrap_about_median(values, period)
    weights = kept["grown"].to_numpy() ** -2
    mean = float(np.average(near, weights=weights))
    variance = 1.0 / float(weights.sum())
    freedom = len(near) - 1
    if len(near) >= _FEWEST:
        correlation = float(estimate_bearing(near, period=None).correlation)
        if 0.0 < correlation < 1.0:
            variance *= (1.0 + correlation) / (1.0 - correlation)
    if freedom:
        # increased if the scatter is larger than the 95 % quantile for the stated noise (Wilson,
        # Hilferty)
        part = 2.0 / (9.0 * freedom)
        limit = freedom * (1.0 - part + _QUANTILE * np.sqrt(part)) ** 3
        variance *= max(1.0, float(weights @ (near - mean) ** 2) / limit)
    return mean, float(np.sqrt(variance))


def _estimate_of(rows: pl.DataFrame, name: str) -> tuple[float, float, pl.Series]:
    """Return an estimate, its sigma (nan: the sigma of the sensor), and the outliers."""
    values, period = rows["value"].to_numpy(), PERIODS.get(rows["kind"][0])
    # sigma of a row; nan: the sigma of the sensor
    stated = float(np.median(rows["sigma"].to_numpy()))
    if len(values) < _FEWEST:
        near = values if period is None else unwrap_about_median(values, period)
        return float(np.median(near)), stated, rows["outlier"]
    try:
        found = estimate_bearing(values, period=period)
    except ValueError as error:
        raise ValueError(f"{name}: {rows['kind'][0]}: {error}") from error
    sigma = float(found.sigma)
    return float(found.value), sigma if sigma > 0 else stated, pl.Series(found.outlier)
