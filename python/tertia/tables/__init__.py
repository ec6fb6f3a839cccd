"""Tables: processes tables in memory in the same way as the commands process files.

A table is a DataFrame of Polars or pandas, or a Table or RecordBatch of pyarrow; results are tables
of the same kind. This module needs the extra `tables` (Polars); tables of pandas also need pyarrow.
An error in a record is reported as a `RecordError` that states its row and column. Values that look
wrong, such as radians in a column of degrees, cause a `RecordWarning`.

Groups are independent of each other, so a recording may be divided into parts that contain complete
groups. Only `fuse_series` uses all groups, for those of its values `sigma`, `alpha` and
`acceleration_sigma` that are not given. Every function of this module can therefore be passed to
`map_partitions` of Dask and to `map_batches` of Ray. With `stream`, it can also be applied to an
iterator of record batches, for example one from `mapInArrow` of Spark or from a reader of large
files.
"""

try:
    from tertia.tables._audit import audit
    from tertia.tables._bearing import bearing
    from tertia.tables._doubts import RecordWarning
    from tertia.tables._evaluate import evaluate
    from tertia.tables._fuse_series import fuse_series
    from tertia.tables._fuse_tracks import fuse_tracks
    from tertia.tables._locate import locate
    from tertia.tables._parts import ColumnError, RecordError
    from tertia.tables._reconstruct import reconstruct
    from tertia.tables._register import register
    from tertia.tables._screen import Rule, screen
    from tertia.tables._sensors import Sensors
    from tertia.tables._smooth import smooth
    from tertia.tables._smooth_tracks import smooth_tracks
    from tertia.tables._stitch import stitch
    from tertia.tables._stream import stream
    from tertia.tables._track import track
    from tertia.tables._weights import weights
except ModuleNotFoundError as error:
    if error.name != "polars":
        raise
    said = "tertia.tables needs the extra tables: pip install 'tertia[tables]'"
    raise ModuleNotFoundError(said, name=error.name) from None

__all__ = [
    "ColumnError",
    "RecordError",
    "RecordWarning",
    "Rule",
    "Sensors",
    "audit",
    "bearing",
    "evaluate",
    "fuse_series",
    "fuse_tracks",
    "locate",
    "reconstruct",
    "register",
    "screen",
    "smooth",
    "smooth_tracks",
    "stitch",
    "stream",
    "track",
    "weights",
]
