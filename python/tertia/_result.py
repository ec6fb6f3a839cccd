"""Conversion of results to tables of pandas, Polars and pyarrow, and their display in Jupyter."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

AXES = ("east", "north", "up")
# vectors with an axis per coordinate: how their columns begin, and their unit
_VECTORS = {
    "position": ("", "m"),
    "velocity": ("velocity_", "m_s"),
    "acceleration": ("acceleration_", "m_s2"),
    # of no state, so it comes last
    "sensor_position": ("sensor_", "m"),
}
_UNITS = {
    "time": "s",
    "height": "m",
    "height_sigma": "m",
    "vertical_rate": "m_s",
    "range": "m",
    "acceleration": "m_s2",
    "emission_time": "s",
    "emission_time_sigma": "s",
}
_PRODUCTS = {("m", "m"): "m2", ("m", "m_s"): "m2_s", ("m_s", "m_s"): "m2_s2"}


class Result:
    """A result that can be converted to a table.

    The columns have the names of the attributes. If the unit of a quantity is certain, it is part
    of the name, as in files: `time_s`, `east_m`, `velocity_north_m_s`, `covariance_east_north_m2`.
    The columns of other arrays are numbered. Angles are in the unit of the attribute. The table of
    a batch also has the columns `index_0`, `index_1` and so on. Attributes whose rows do not
    correspond to the rows of the table, such as the outliers of a bearing, are left out.
    """

    __slots__ = ()

    # the attribute that says what a row is, and how many axes it has of its own; without it, each
    # figure with its interval is a row
    _rows: ClassVar[tuple[str, int] | None] = None
    _omitted: ClassVar[tuple[str, ...]] = ()

    def to_polars(self) -> Any:
        """Return the result as a table of Polars.

        Returns
        -------
        polars.DataFrame
            One row per estimate, instant or plot.

        Examples
        --------
        >>> from tertia import screening
        >>> screening.k_sigma([45.0, 45.2, 44.9, 45.1, 45.0]).to_polars()["outlier"].sum()
        0
        """
        import polars as pl  # noqa: PLC0415  # an extra

        return pl.DataFrame(self._columns_of_rows())

    def to_pandas(self) -> Any:
        """Return the result as a table of pandas.

        Returns
        -------
        pandas.DataFrame
            One row per estimate, instant or plot.
        """
        import pandas as pd  # noqa: PLC0415  # the caller has it

        return pd.DataFrame(self._columns_of_rows())

    def to_arrow(self) -> Any:
        """Return the result as a table of pyarrow.

        Returns
        -------
        pyarrow.Table
            One row per estimate, instant or plot.
        """
        import pyarrow as pa  # noqa: PLC0415  # the caller has it

        return pa.table(self._columns_of_rows())

    def _repr_html_(self) -> str:
        """Return the first and last rows for Jupyter, or plain text if Polars is not installed."""
        try:
            shown = self.to_polars()
        except ModuleNotFoundError:
            return f"<pre>{repr(self).replace('&', '&amp;').replace('<', '&lt;')}</pre>"
        return f"<p>{type(self).__name__}</p>{shown._repr_html_()}"

    def _columns_of_rows(self) -> dict[str, npt.NDArray[Any]]:
        if self._rows is None:
            return _columns_of_figures(self)
        arrays = dict(_arrays(self, self._omitted))
        name, own = self._rows
        shape = arrays[name].shape
        rows = shape[: len(shape) - own]
        count = int(np.prod(rows, dtype=np.int64))
        found: dict[str, npt.NDArray[Any]] = {}
        if len(rows) > 1:
            index = np.indices(rows).reshape(len(rows), count)
            found |= {f"index_{axis}": index[axis] for axis in range(len(rows))}
        axes = arrays["position"].shape[-1] if "position" in arrays else 0
        for called, array in arrays.items():
            depth = min(array.ndim, len(rows))
            if array.shape[:depth] != rows[:depth]:
                continue
            rest = array.shape[depth:]
            whole = array.reshape(array.shape[:depth] + (1,) * (len(rows) - depth) + rest)
            whole = np.broadcast_to(whole, (*rows, *rest)).reshape(count, *rest)
            found |= dict(_flat(called, whole, axes))
        return found


def _arrays(result: Any, omitted: tuple[str, ...] = ()) -> Iterator[tuple[str, npt.NDArray[Any]]]:
    """Yield the name and value of each number or text of a result and of the results in it."""
    for field in fields(result):
        value = getattr(result, field.name)
        if field.name.startswith("_") or field.name in omitted or value is None:
            continue
        if is_dataclass(value):
            if not hasattr(value, "waypoints"):
                yield from ((f"{field.name}_{name}", one) for name, one in _arrays(value))
            continue
        array = np.asarray(value)
        if array.dtype.kind in "biufU" and not isinstance(value, (tuple, list)):
            yield field.name, array
    sigma = getattr(type(result), "sigma", None)
    # those of positions come with their covariance
    if isinstance(sigma, property) and not hasattr(result, "position"):
        yield "sigma", np.asarray(result.sigma)


def _columns_of_figures(result: Any) -> dict[str, npt.NDArray[Any]]:
    """Return the figures of a result and of its parts as columns, with their intervals."""
    found = list(_figures(result, ""))
    columns = {
        "part": np.array([part for part, _, _ in found]),
        "quantity": np.array([quantity for _, quantity, _ in found]),
    }
    for name in ("value", "low", "high", "count", "effective_number"):
        cells = [getattr(figure, name, np.nan) for _, _, figure in found]
        if name == "value":
            cells = [getattr(figure, name, figure) for _, _, figure in found]
        columns[name] = np.array(cells, dtype=np.float64)
    columns["verdict"] = np.array([getattr(figure, "verdict", "") for _, _, figure in found])
    return columns


def _figures(result: Any, part: str) -> Iterator[tuple[str, str, Any]]:
    """Yield the part to which a figure belongs, its name and its value, for each figure."""
    for field in fields(result):
        value = getattr(result, field.name)
        for key, one in value.items() if isinstance(value, Mapping) else [(None, value)]:
            if hasattr(one, "effective_number") and hasattr(one, "strata"):
                yield from _figures(one, str(key))
            elif hasattr(one, "verdict") or isinstance(one, (int, float)):
                yield part, field.name if key is None else f"{field.name}_{key:g}", one


def _flat(name: str, array: npt.NDArray[Any], axes: int) -> Iterator[tuple[str, npt.NDArray[Any]]]:
    """Yield columns with one number per row; a position has `axes` coordinates."""
    shape = array.shape[1:]
    if not shape:
        yield f"{name}_{_UNITS[name]}" if name in _UNITS else name, array
    elif name in _VECTORS and len(shape) == 1 and shape[0] <= len(AXES):
        prefix, unit = _VECTORS[name]
        for k in range(shape[0]):
            yield f"{prefix}{AXES[k]}_{unit}", array[:, k]
    elif name == "covariance" and axes:
        yield from _covariance(array, axes)
    else:
        numbers = array.reshape(len(array), -1)
        for k, place in enumerate(np.ndindex(*shape)):
            yield "_".join([name, *map(str, place)]), numbers[:, k]


def _covariance(array: npt.NDArray[Any], axes: int) -> Iterator[tuple[str, npt.NDArray[Any]]]:
    """Yield the sigmas and covariances of a state, except those of its accelerations."""
    between = covariance_names(axes, array.shape[-1])
    for i, (name, unit) in enumerate(state_names(axes, array.shape[-1])):
        yield f"{name}_sigma_{unit}", np.sqrt(array[:, i, i])
        yield from ((between[j, i], array[:, j, i]) for j in range(i) if (j, i) in between)


def state_names(axes: int, count: int) -> list[tuple[str, str]]:
    """Return the names and units of the first components of a state in so many dimensions."""
    vectors = _VECTORS.values()
    return [(f"{prefix}{axis}", unit) for prefix, unit in vectors for axis in AXES[:axes]][:count]


def covariance_names(axes: int, count: int) -> dict[tuple[int, int], str]:
    """Return the columns of covariances between two components, except with accelerations."""
    state = enumerate(state_names(axes, count))
    return {
        (i, j): f"covariance_{first}_{second}_{_PRODUCTS[unit, other]}"
        for (i, (first, unit)), (j, (second, other)) in itertools.combinations(state, 2)
        if (unit, other) in _PRODUCTS
    }


def counted(number: int | np.signedinteger[Any], noun: str) -> str:
    """Return a number with its noun, in the plural unless the number is one."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
