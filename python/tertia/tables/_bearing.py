"""Estimation of bearings from groups of measurements."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import polars as pl

from tertia._arrays import BoolArray, FloatArray, IntArray
from tertia.bearing import BearingEstimate, estimate_bearing
from tertia.tables._frames import Table, result
from tertia.tables._groups import (
    Layout,
    as_names,
    by_length,
    column_name,
    group_name,
    layout,
    split_unit,
    usual_period,
)
from tertia.tables._parts import Source, source_of
from tertia.tables._records import Schema, number, read

# an empty batch of measurements, with which the library checks only the options
_NONE = np.empty((0, 5))
# two turns, in degrees
_MOST = 720.0


@dataclass(frozen=True, slots=True)
class Bearings:
    """The estimates of all groups, with one row for each group, and their measurements."""

    rows: pl.DataFrame
    groups: Layout
    theta: FloatArray
    sigma: FloatArray | None
    labels: IntArray | None
    options: Mapping[str, Any]

    def estimates(self, most: int) -> Iterator[tuple[str, FloatArray, BearingEstimate]]:
        """Yield the names, measurements and estimates of the first groups that have an estimate."""
        ends = np.cumsum(self.groups.lengths)
        for k in self.rows["note"].is_null().arg_true()[:most]:
            own = slice(ends[k] - self.groups.lengths[k], ends[k])
            sample = self.theta[own]
            options = {"nan_policy": "omit", **self.options}
            if self.labels is not None:
                options["groups"] = self.labels[own]
            if self.sigma is not None and np.isfinite(self.sigma[own][~np.isnan(sample)]).all():
                options["sigma"] = self.sigma[own]
            estimate = estimate_bearing(sample, **options)
            yield group_name(self.groups.keys[k : k + 1]), sample, estimate


def bearing(
    table: Table,
    *,
    columns: Mapping[str, str] | None = None,
    values: str = "azimuth_deg",
    by: str | Sequence[str] = (),
    groups: str | None = None,
    **options: Any,
) -> Table:
    """Estimate a bearing and its sigma for each group, as the command `tertia bearing` does.

    Parameters
    ----------
    table : DataFrame of Polars or pandas, Table or RecordBatch of pyarrow
        One row per measurement; within a group, rows are in the order of measurement.
    columns : mapping of str to str, optional
        The names that columns have in this table, keyed by their standard names.
    values : str
        Column of the measurements. Missing measurements (null or nan) are left out and counted.
        If `sigma` is not given and the method is "robust", the column of their sigmas
        (`azimuth_sigma_deg` for `azimuth_deg`) is used in groups where every measurement has one.
    by : str or sequence of str
        Columns whose values identify the groups; by default all rows belong to one group.
    groups : str, optional
        Column of labels. Measurements with the same label have a common systematic error, for
        example measurements at one stop, in one hour, or in one sector.
    **options
        Parameters of `tertia.bearing.estimate_bearing`, except `nan_policy`. By default, `period`
        is that of the unit at the end of the name of the column: 360 for degrees (`_deg`), 2 pi for
        radians (`_rad`), None for other units. Without a unit, the values must be degrees.

    Returns
    -------
    table of the same kind
        One row per group, in the order of their first measurements. The columns are those of `by`;
        the number of measurements (`count`) and the number of missing measurements (`missing`); the
        estimate and its sigma (`azimuth_deg`, `azimuth_sigma_deg`); the sigma of the systematic
        errors, which is included in the sigma of the estimate (`azimuth_bias_sigma_deg`; only with
        `groups` or `bias_sigma`); `outlier_count`; `polarity`; and a `note`, which states the
        reason if there is no estimate. An empty table gives an empty result.

    Raises
    ------
    RecordError
        If a column is missing, has the name of a column of the result, or does not contain numbers,
        or if a measurement is infinite.
    ValueError, TypeError
        If an option is outside its domain or has the wrong type, or the table is of an unsupported
        kind.

    Examples
    --------
    >>> import polars as pl
    >>> from tertia import tables
    >>> from tertia.simulate import direction_finder
    >>> table = pl.concat(
    ...     pl.DataFrame({"sensor": name, "azimuth_deg": record.theta})
    ...     for name, angle in [("A", 359.0), ("B", 80.0)]
    ...     for record in [direction_finder(60, bearing=angle, rng=1)]
    ... )
    >>> found = tables.bearing(table, by="sensor")
    >>> found.select("sensor", "count", "outlier_count", "note").rows()
    [('A', 60, 7, None), ('B', 60, 7, None)]
    """
    found = bearings_of(
        source_of(table), columns=columns, values=values, by=by, groups=groups, **options
    )
    return result(table, found.rows, as_names(by))


def bearings_of(
    source: Source,
    *,
    columns: Mapping[str, str] | None = None,
    values: str = "azimuth_deg",
    by: str | Sequence[str] = (),
    groups: str | None = None,
    **options: Any,
) -> Bearings:
    """Return the estimates of all groups with their measurements, as described in `bearing`."""
    by_unit = "period" not in options
    options.setdefault("period", usual_period(values))
    estimate_bearing(_NONE, **options)
    keys = as_names(by)
    fields = {values: "value", column_name(values, "sigma"): "sigma"}
    if groups is not None or options.get("bias_sigma") is not None:
        fields[column_name(values, "bias_sigma")] = "bias_sigma"
    names = ("count", "missing", *fields, "outlier_count", "polarity", "note")
    fields["polarity"] = "polarity"
    # the measurements may be in any unit, so the name of their column is not checked
    standard = values == "azimuth_deg"
    theta_of = number(values, required=True, standard=standard)
    if by_unit and not split_unit(values)[1]:
        # a column without a unit is taken for degrees
        theta_of = replace(theta_of, most=_MOST)
    schema: Schema = {"theta": theta_of}
    if options.get("sigma") is None and options.get("method", "robust") == "robust":
        schema = {**schema, "sigma": number(column_name(values, "sigma"), positive=True)}
    shared = [groups] if groups is not None and groups not in keys else []
    records = read(source, schema, columns=columns, by=[*keys, *shared], results=names)
    rows = layout(records.by.select(keys), records.rows.height)
    theta = rows.arranged(records.rows["theta"].to_numpy())
    labels: IntArray | None = None
    if groups is not None:
        codes = records.by.get_column(groups).rank("dense").fill_null(0).to_numpy()
        labels = rows.arranged(codes.astype(np.int64))
    sigma = rows.arranged(records.rows["sigma"].to_numpy()) if "sigma" in records.column else None
    arrays = {"theta": theta, "sigma": sigma, "groups": labels}
    there = {name: array for name, array in arrays.items() if array is not None}
    count, absent = rows.lengths, np.isnan(theta)
    if absent.any():
        count = np.bincount(rows.group[~absent], minlength=len(count))
        there = {name: array[~absent] for name, array in there.items()}
    found = {name: np.full(len(count), np.nan) for name in fields}
    outliers = np.zeros(len(count), dtype=np.int64)
    notes: list[str | None] = [None] * len(count)
    for which, result_of in _estimates(count, there, options):
        if isinstance(result_of, ValueError):
            notes[which[0]] = str(result_of)
            continue
        for name, field in fields.items():
            found[name][which] = getattr(result_of, field)
        outliers[which] = np.count_nonzero(result_of.outlier, axis=-1)
    note = pl.Series(notes, dtype=pl.String)
    columns_of = {"count": count, "missing": rows.lengths - count, **found, "note": note}
    table = pl.DataFrame(columns_of | {"outlier_count": outliers}).select(names)
    table = table.with_columns(pl.col(list(fields)).fill_nan(None))
    table = table.with_columns(
        pl.when(pl.col("note").is_null()).then(name).alias(name) for name in names[2:-1]
    )
    every = pl.concat([rows.keys, table], how="horizontal")
    return Bearings(every, rows, theta, sigma, labels, options)


def _estimates(
    count: IntArray, arrays: Mapping[str, npt.NDArray[Any]], options: Mapping[str, Any]
) -> Iterator[tuple[IntArray, BearingEstimate | ValueError]]:
    """Yield groups of one length with their estimates, or a group with the reason why it has none.

    The sigmas count in groups of which each measurement has one.
    """
    stated = np.zeros(len(count), dtype=bool)
    if "sigma" in arrays:
        group = np.repeat(np.arange(len(count)), count)
        stated = np.bincount(group[np.isnan(arrays["sigma"])], minlength=len(count)) == 0
    without = [name for name in arrays if name != "sigma"]
    for own, names in ((stated, list(arrays)), (~stated, without)):
        if not own.any():
            continue

        def estimate(*blocks: npt.NDArray[Any], names: Sequence[str] = names) -> BearingEstimate:
            return estimate_bearing(**{**options, **dict(zip(names, blocks, strict=True))})

        chosen = [_of_groups(arrays[name], count, own) for name in names]
        number = np.flatnonzero(own)
        for which, found in by_length(count[own], chosen, estimate):
            yield number[which], found


def _of_groups(array: npt.NDArray[Any], count: IntArray, own: BoolArray) -> npt.NDArray[Any]:
    """Return the elements of some groups."""
    return array if own.all() else array[np.repeat(own, count)]
