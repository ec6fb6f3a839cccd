"""One measurement of each sensor from all of a target that does not move."""

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

# with fewer no scatter can be estimated
_FEWEST = 5
# from so many on a sensor's own scatter tells its noise as well as what is stated
_MANY = 40
# of kinds that repeat
PERIODS = {"azimuth": 360.0}
# what are comparable at one place after the other
_COMMON: tuple[Kind, ...] = ("range", "azimuth", "elevation")
# of the normal distribution, exceeded by 5 %
_QUANTILE = 1.645
# median of absolute residuals in sigmas if a fifth are wrong, and its spread for one residual
_MEDIAN, _SPREAD = 0.89, 0.8
# spreads beyond which noise is not as stated, residuals that can tell, and the most that is noise
_DOUBT, _ENOUGH, _MOST = 2.5, 8, 4.0


def stated_sigmas(rows: pl.DataFrame, sensors: Sensors[Station]) -> FloatArray:
    """Return the sigma of each row in its unit, nan where it has none and its sensor neither."""
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

    Of fewer than 40 measurements with a sigma, those are left out that contradict the rest of all
    `sensors`; a mean has the sigma that is stated, more where the others scatter or last. Otherwise
    a sensor has the estimate of its own, of fewer than five their median, with the sigma of one.
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
    """Return which contradict all others at one place, and the sigmas; None if no place is found.

    Where residuals are too large for the sigmas, of all sensors or of one, these grow first; a
    sensor whose residuals are larger still is wrong.
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
    """Return outliers and residuals of all rows at the place that explains most of them."""
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
        # bearings that contradict each other are no radians here
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
    """Return the mean of those that are no outliers, and its sigma."""
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
        # as much as the scatter exceeds what noise as stated exceeds in 5 % (Wilson, Hilferty)
        part = 2.0 / (9.0 * freedom)
        limit = freedom * (1.0 - part + _QUANTILE * np.sqrt(part)) ** 3
        variance *= max(1.0, float(weights @ (near - mean) ** 2) / limit)
    return mean, float(np.sqrt(variance))


def _estimate_of(rows: pl.DataFrame, name: str) -> tuple[float, float, pl.Series]:
    """Return an estimate, its sigma, nan where it is that of the sensor, and what is left out."""
    values, period = rows["value"].to_numpy(), PERIODS.get(rows["kind"][0])
    # of a row; nan: that of the sensor
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
