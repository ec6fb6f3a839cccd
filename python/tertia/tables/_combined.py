"""One measurement of each sensor from all of a target that does not move."""

from __future__ import annotations

import warnings

import numpy as np
import polars as pl

from tertia._arrays import FloatArray
from tertia.bearing import BearingEstimate, estimate_bearing
from tertia.location import locate
from tertia.screening import unwrap_about_median
from tertia.sensors import Kind, Station
from tertia.tables._sensors import Sensors

# with fewer measurements, their scatter cannot be estimated
_FEWEST = 5
# with this many measurements, the scatter determines the noise as well as the stated sigma does
_MANY = 40
# of kinds that repeat
PERIODS = {"azimuth": 360.0}
# kinds for which one position is estimated from measurements at different times
_COMMON: tuple[Kind, ...] = ("range", "azimuth", "elevation")


def stated_sigmas(rows: pl.DataFrame, sensors: Sensors[Station]) -> FloatArray:
    """Return the sigma of each row in its unit, nan where it has none and its sensor neither."""
    found = rows["sigma"].to_numpy().astype(np.float64)
    kinds, sites = rows["kind"].to_list(), rows["site"].to_list()
    for row in np.flatnonzero(np.isnan(found)).tolist():
        kind = kinds[row]
        own = getattr(sensors.items[sites[row]], f"{kind}_sigma", None)
        if own is not None:
            found[row] = own if kind == "range" else np.degrees(own)
    return found


def combined(
    rows: pl.DataFrame, name: str, sensors: Sensors[Station] | None
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Return one row per sensor and kind, and all rows with `outlier`, null where unknown.

    The measurements of each sensor are combined by `estimate_bearing`. If there are fewer than 40
    and all have a sigma, the stated sigmas are used, and measurements that contradict those of all
    `sensors` are left out first. Otherwise, the noise is estimated from the scatter. Fewer than
    five measurements without a sigma are replaced by their median.
    """
    stated = rows["sigma"] if sensors is None else pl.Series(stated_sigmas(rows, sensors))
    rows = rows.with_columns(outlier=pl.lit(None, dtype=pl.Boolean), stated=stated)
    parts = rows.partition_by("site", "kind", maintain_order=True)
    few = len(rows) >= _FEWEST and any(one.height < _MANY for one in parts)
    if sensors is not None and few and stated.is_finite().all():
        parts = _without_contradictions(parts, sensors)
    means, singles = [rows.clear()], [rows.clear()]
    for one in parts:
        try:
            value, sigma, marks = _estimate_of(one)
        except ValueError as error:
            raise ValueError(f"{name}: {one['kind'][0]}: {error}") from error
        middle = one[(one.height - 1) // 2]
        means.append(middle.with_columns(value=pl.lit(value), sigma=pl.lit(sigma)))
        singles.append(one.with_columns(marks.alias("outlier")))
    one_each = pl.concat(means).sort("seconds", maintain_order=True)
    return one_each.drop("outlier", "stated"), pl.concat(singles).drop("stated")


def _estimate_of(rows: pl.DataFrame) -> tuple[float, float, pl.Series]:
    """Return an estimate, its sigma (nan: the sigma of the sensor), and the outliers."""
    value, period = rows["value"].to_numpy(), PERIODS.get(rows["kind"][0])
    marks, own = rows["outlier"], float(np.median(rows["sigma"].to_numpy()))
    if rows.height == 1:
        return float(value[0]), own, marks
    if rows.height < _MANY and rows["stated"].is_finite().all():
        wrong = marks.fill_null(value=False).to_numpy()
        kept = ~wrong if not wrong.all() else wrong
        found = _as_stated(rows.filter(kept))
        left = ~kept
        left[kept] = found.outlier
        return float(found.value), float(found.sigma), pl.Series(left)
    if rows.height < _FEWEST:
        near = value if period is None else unwrap_about_median(value, period)
        return float(np.median(near)), own, marks
    found = estimate_bearing(value, period=period)
    sigma = float(found.sigma)
    # equal readings do not show their scatter
    return float(found.value), sigma if 0 < sigma < np.inf else own, pl.Series(found.outlier)


def _as_stated(rows: pl.DataFrame) -> BearingEstimate:
    """Return the estimate of one sensor with its stated sigmas."""
    period = PERIODS.get(rows["kind"][0])
    return estimate_bearing(rows["value"], sigma=rows["stated"], period=period)


def _without_contradictions(
    parts: list[pl.DataFrame], sensors: Sensors[Station]
) -> list[pl.DataFrame]:
    """Mark the outliers about the position that fits most measurements of all sensors.

    Each sensor's sigmas are first multiplied by the noise factor estimated from its scatter, but at
    least by the median factor of all sensors: sigmas that are too small often are so for all.
    """
    factors = [float(_as_stated(one).noise_factor) for one in parts]
    least = float(np.median(factors))
    grown = [
        one.with_columns(pl.col("stated") * max(factor, least))
        for one, factor in zip(parts, factors, strict=True)
    ]
    rows = pl.concat(grown)
    marked = rows.with_columns(outlier=_outliers_at_one_place(rows, sensors))
    return marked.partition_by("site", "kind", maintain_order=True)


def _outliers_at_one_place(rows: pl.DataFrame, sensors: Sensors[Station]) -> pl.Series:
    """Return which measurements are outliers about one position; null if none is found."""
    unknown = pl.Series([None] * len(rows), dtype=pl.Boolean)
    if not rows["kind"].is_in(_COMMON).all():
        return unknown
    stations = [
        Station(one.position, axes=one.axes, bias=one.bias, position_sigma=one.position_sigma)
        for one in (sensors.items[site] for site in rows["site"])
    ]
    options: dict[str, FloatArray] = {}
    for kind in _COMMON:
        own = (rows["kind"] == kind).to_numpy()
        if own.any():
            unit = 1.0 if kind == "range" else np.pi / 180
            options[str(kind)] = np.where(own, rows["value"] * unit, np.nan)[np.newaxis]
            options[f"{kind}_sigma"] = np.where(own, rows["stated"] * unit, 1.0)[np.newaxis]
    with warnings.catch_warnings():
        # bearings that contradict each other are no radians here
        warnings.simplefilter("ignore")
        found = locate(stations, **options)  # type: ignore[arg-type]
    if not np.all(found.success):
        return unknown
    marks = [getattr(found.outlier, kind)[0, k] for k, kind in enumerate(rows["kind"])]
    return pl.Series(marks, dtype=pl.Boolean)
