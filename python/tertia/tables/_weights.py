"""Weights of several sensors for estimates of the same quantity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from tertia import _core
from tertia import weights as weighting
from tertia._arrays import FloatArray, not_negative
from tertia.fusion import FusedEstimate, fuse
from tertia.fusion._estimates import allowing_for
from tertia.tables._doubts import doubt
from tertia.tables._frames import Table, result
from tertia.tables._groups import as_names, column_name, layout, split_unit
from tertia.tables._parts import ColumnError, RecordError, Source, source_of
from tertia.tables._records import SENSOR, Field, number, read
from tertia.weights import FusionLoss
from tertia.weights._readers import LARGEST

FUSED = "fused"
_LOSSES = (1e-6, 1e6)
# usual differences, in steps, from which on equal rows are copies; standard deviations and number
# by which they must exceed those of chance
_DIFFERENT, _SURE, _FEW = 4.0, 3.0, 3.0


@dataclass(frozen=True, slots=True)
class Weighed:
    """One row per sensor, followed by the fused estimate; and the loss from estimated weights."""

    rows: pl.DataFrame
    fused: FusedEstimate
    loss: FusionLoss
    required: int


def weights(
    table: Table,
    *,
    columns: Mapping[str, str] | None = None,
    values: str | Sequence[str],
    differences: bool = False,
    loss: float = 0.05,
    bias_sigma: float = 0.0,
) -> Table:
    """Estimate the weights of sensors that measured the same quantity, as `tertia weights` does.

    Parameters
    ----------
    table : DataFrame of Polars or pandas, Table or RecordBatch of pyarrow
        One row per measurement: `sensor`, and all components. Incomplete rows are left out.
    columns : mapping of str to str, optional
        The names that columns have in this table, keyed by their standard names.
    values : str or sequence of str
        Columns of the components of the measured quantity.
    differences : bool
        Whether to estimate the noise from successive differences, for a measured quantity that
        changes slowly.
    loss : float
        Loss of accuracy for which the required number of measurements is computed.
    bias_sigma : float
        Standard deviation of the systematic error of each sensor and component, in their unit. Such
        an error does not show in the scatter of the measurements. It is included in the sigmas and
        the weights, but not in the loss.

    Returns
    -------
    table of the same kind
        One row per sensor, and a last row named `fused`. Columns are `sensor`, `measurement_count`,
        means with their sigmas (`east_m`, `east_sigma_m`), and weights (`weight`, or for each pair
        of components `weight_east_north`). The sigmas allow for the number of measurements: an
        interval of ± 2 sigmas contains the true value of a component with a probability of 95.45 %,
        even with n = 3 (see `tertia.fusion.fuse`).

    Raises
    ------
    RecordError
        If a column is missing or does not hold numbers, a sensor has no name, there are fewer than
        two sensors, or the measurements of a sensor have no scatter.
    ValueError
        If `loss` or `bias_sigma` is outside its domain.
    numpy.linalg.LinAlgError
        If a covariance is singular.
    TypeError
        If the table is of an unsupported kind.

    Examples
    --------
    >>> import polars as pl
    >>> from tertia import tables
    >>> table = pl.DataFrame({"sensor": list("AABBAABB"), "m": [1.0, 3, 0, 8, 2, 1, 3, 1]})
    >>> tables.weights(table, values="m").select("sensor", "measurement_count").rows()
    [('A', 4), ('B', 4), ('fused', 8)]
    """
    found = weights_of(
        source_of(table),
        columns=columns,
        values=values,
        differences=differences,
        loss=loss,
        bias_sigma=bias_sigma,
    )
    return result(table, found.rows)


def weights_of(
    source: Source,
    *,
    columns: Mapping[str, str] | None,
    values: str | Sequence[str],
    differences: bool,
    loss: float,
    bias_sigma: float,
) -> Weighed:
    """Return the weights and the loss from estimating them, as described in `weights`."""
    if not _LOSSES[0] <= loss <= _LOSSES[1]:
        raise ValueError(f"loss is {loss:g}; it must be between {_LOSSES[0]:g} and {_LOSSES[1]:g}")
    bias = not_negative(bias_sigma, "bias_sigma")
    components = as_names(values)
    samples = _samples(source, columns, components)
    counts = [len(sample) for sample in samples.values()]
    means = np.array([sample.mean(axis=0) for sample in samples.values()])
    # covariances of the means
    covariances = np.array(
        [
            weighting.sample_covariance(sample, differences=differences) / len(sample)
            for sample in samples.values()
        ]
    )
    convention: weighting.Convention = "differences" if differences else "sample-mean"
    laws = _core.wishart_law([float(count) for count in counts], convention, len(counts))
    complete = covariances + bias**2 * np.eye(len(components))
    fused = allowing_for(fuse(means, complete), means, complete, laws)
    values_of = np.vstack([means, fused.mean])
    own = [
        np.hypot(_core.student_factor(degrees) * np.sqrt(np.diagonal(one)), bias)
        for one, (degrees, _) in zip(covariances, laws, strict=True)
    ]
    sigmas = np.array([*own, fused.sigma])
    rows: dict[str, Any] = {
        "sensor": [*samples, FUSED],
        "measurement_count": [*counts, sum(counts)],
    }
    for i, name in enumerate(components):
        rows[name], rows[column_name(name, "sigma")] = values_of[:, i], sigmas[:, i]
    short = [split_unit(name)[0] for name in components]
    for i, row in enumerate(short):
        for j, column in enumerate(short):
            of = [row, column] if len(components) > 1 else []
            rows["_".join(["weight", *of])] = [*fused.weights[:, i, j], None]
    return Weighed(
        pl.DataFrame(rows),
        fused,
        weighting.fusion_loss(covariances, counts, convention=convention),
        int(weighting.required_samples(covariances, loss, convention=convention)),
    )


def _samples(
    source: Source, columns: Mapping[str, str] | None, components: Sequence[str]
) -> dict[str, FloatArray]:
    """Return the measurements of each sensor, (n, m), in the order of the table."""
    if "sensor" in components:
        raise ColumnError("the column sensor is given for two purposes", column="sensor")
    schema = {"sensor": Field("name", SENSOR.columns, required=True)}
    schema |= {name: number(name, required=True, standard=False) for name in components}
    rows = read(source, schema, columns=columns).rows.select(list(schema))
    whole = rows.with_columns(pl.col(components).fill_nan(None)).drop_nulls()
    if left_out := rows.height - whole.height:
        doubt(f"{left_out} of {rows.height} rows are incomplete")
    groups = layout(whole.select("sensor"), whole.height)
    samples = {str(keys.item()): whole[own].select(components).to_numpy() for keys, own in groups}
    if len(samples) < 2:
        there = "is 1 sensor" if samples else "are no sensors"
        raise RecordError(f"there {there}; two are needed", file=source[0].file)
    for name, sample in samples.items():
        if len(sample) < 2:
            raise RecordError(f"sensor {name} has 1 measurement; its weight needs at least two")
        large = np.any(np.abs(sample) > LARGEST, axis=0)
        if np.any(large):
            column = components[int(np.flatnonzero(large)[0])]
            raise RecordError(f"sensor {name}: {column} has a number above {LARGEST:g}")
        same = np.all(sample == sample[:1], axis=0)
        if np.any(same):
            column = components[int(np.flatnonzero(same)[0])]
            raise RecordError(
                f"sensor {name}: all values of {column} are equal; a weight can be computed only "
                "from values that scatter"
            )
    return {name: _without_copies(name, sample) for name, sample in samples.items()}


def _without_copies(name: str, sample: FloatArray) -> FloatArray:
    """Return measurements without rows that repeat the row before, if these are too many.

    Rounding makes successive measurements equal, too, but at most one in twice the median
    difference of those that differ, in steps.
    """
    apart = np.abs(np.diff(sample, axis=0))
    differs = np.any(apart > 0.0, axis=1)
    steps = np.where(apart > 0.0, apart, np.nan)
    if not differs.any():
        return sample
    least = np.nanmin(steps, axis=0, initial=np.inf)
    usual = np.max(np.median(apart[differs], axis=0) / least)
    count, copies = len(differs), int(np.sum(~differs))
    chance = 0.5 / max(usual, 0.5)
    many = count * chance + _SURE * np.sqrt(count * chance * (1.0 - chance)) + _FEW
    if usual < _DIFFERENT or copies <= many:
        return sample
    doubt(
        f"{copies} of {len(sample)} rows of sensor {name} repeat the row before: they are no "
        "measurements of their own, and are left out"
    )
    kept: FloatArray = sample[np.concatenate([[True], differs])]
    return kept
