"""Conversion of tables of pandas, Polars and pyarrow, in both directions."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any, TypeVar

import polars as pl

Table = TypeVar("Table")


def result(table: Table, frame: pl.DataFrame, keys: Sequence[str] = ()) -> Table:
    """Return a result as a table of the same kind; the columns `keys` keep their types."""
    found: Any = frame
    if _is_of("pandas", "DataFrame", table):
        found = _to_pandas(table, frame, keys)
    elif not isinstance(table, (pl.DataFrame, list)):
        found = _like(table, _to_arrow(table, frame, keys))
    return found  # type: ignore[no-any-return]


def extended(table: Table, columns: pl.DataFrame) -> Table:
    """Return the rows of a table, in their order, with additional columns."""
    there = set(columns.columns) & set(names(table))
    if there:
        raise ValueError(f"the table already has a column {sorted(there)[0]}")
    found: Any = table
    if isinstance(table, pl.DataFrame):
        found = table.hstack(columns)
    elif _is_of("pandas", "DataFrame", table):
        added = _to_pandas(table, columns, ())
        found = found.assign(**{name: added[name].array for name in added.columns})
    else:
        arrow, chunked = _to_arrow(table, columns, ()), _is_of("pyarrow", "Table", table)
        for field, column in zip(arrow.schema, arrow.columns, strict=True):
            found = found.append_column(field, column if chunked else column.combine_chunks())
    return found  # type: ignore[no-any-return]


def _to_pandas(table: Any, frame: pl.DataFrame, keys: Sequence[str]) -> Any:
    import pandas as pd  # noqa: PLC0415  # the caller has it
    import pyarrow as pa  # noqa: PLC0415  # needed to convert strings and dates for pandas

    # the types must not depend on whether values are missing
    nullable = {pa.int64(): pd.Int64Dtype(), pa.bool_(): pd.BooleanDtype()}
    found = frame.to_arrow().to_pandas(types_mapper=nullable.get)
    kinds = {name: table[name].dtype for name in keys if name in found.columns}
    return found.astype(kinds)


def _to_arrow(table: Any, frame: pl.DataFrame, keys: Sequence[str]) -> Any:
    import pyarrow as pa  # noqa: PLC0415  # the caller has it

    plain = frame.with_columns(pl.col(pl.Categorical).cast(pl.String))
    found = plain.to_arrow(compat_level=pl.CompatLevel.oldest())
    kinds = {field.name: field.type for field in table.schema if field.name in keys}
    fields = [
        pa.field(field.name, kinds.get(field.name, _usual(field.type))) for field in found.schema
    ]
    return found.cast(pa.schema(fields))


def series(table: Any, column: str) -> pl.Series:
    """Return a column of a table."""
    if isinstance(table, pl.DataFrame):
        return table[column]
    if _is_of("pandas", "DataFrame", table):
        cells = table[column]
        try:
            own = pl.from_pandas(cells)
        except (ValueError, TypeError):
            # objects of several types become text, so that an error names the first wrong one
            own = pl.from_pandas(cells.astype(str).where(cells.notna(), None))
        assert isinstance(own, pl.Series)  # several columns of one name would give a frame
        return own
    found = pl.from_arrow(table.select([column]))
    assert isinstance(found, pl.DataFrame)  # nested data would give a Series
    return found[column]


def height(table: Any) -> int:
    """Return the number of rows."""
    return len(table) if hasattr(table, "__len__") else int(table.num_rows)


def part(table: Table, start: int, stop: int | None = None) -> Table:
    """Return consecutive rows of a table."""
    rows = slice(start, stop)
    if _is_of("pandas", "DataFrame", table):
        return table.iloc[rows]  # type: ignore[attr-defined,no-any-return]
    return table[rows]  # type: ignore[index,no-any-return]


def joined(tables: Sequence[Table]) -> Table:
    """Return the rows of several tables of one kind as one table."""
    first: Any = tables[0]
    if len(tables) == 1:
        return tables[0]
    if isinstance(first, pl.DataFrame):
        return pl.concat(tables)  # type: ignore[type-var]
    if _is_of("pandas", "DataFrame", first):
        import pandas as pd  # noqa: PLC0415  # the caller has it

        return pd.concat(tables)  # type: ignore[no-any-return]
    import pyarrow as pa  # noqa: PLC0415  # the caller has it

    if _is_of("pyarrow", "Table", first):
        return pa.concat_tables(tables)  # type: ignore[no-any-return]
    return _like(first, pa.Table.from_batches(tables))  # type: ignore[no-any-return]


def is_table(table: Any) -> bool:
    """Return whether this is a table of a supported kind."""
    arrow = (_is_of("pyarrow", name, table) for name in ("Table", "RecordBatch"))
    return isinstance(table, pl.DataFrame) or _is_of("pandas", "DataFrame", table) or any(arrow)


def names(table: Any) -> list[Any]:
    """Return the names of the columns."""
    if is_table(table):
        arrow = hasattr(table, "column_names")
        return list(table.column_names if arrow else table.columns)
    hint = "; collect it first" if isinstance(table, pl.LazyFrame) else ""
    raise TypeError(
        f"table is a {type(table).__name__}; it must be a DataFrame of Polars or pandas, or a "
        f"Table or RecordBatch of pyarrow{hint}"
    )


def _is_of(library: str, name: str, table: Any) -> bool:
    """Return whether a table is from a given library; the library is not imported for this."""
    module = sys.modules.get(library)
    return module is not None and isinstance(table, getattr(module, name))


def _like(table: Any, result: Any) -> Any:
    """Return a pyarrow Table as a table of the same kind as `table`."""
    if _is_of("pyarrow", "Table", table):
        return result
    whole = result.combine_chunks().to_batches()
    return whole[0] if whole else type(table).from_pylist([], schema=result.schema)


def _usual(kind: Any) -> Any:
    import pyarrow as pa  # noqa: PLC0415  # the caller has it

    return pa.string() if pa.types.is_large_string(kind) else kind
