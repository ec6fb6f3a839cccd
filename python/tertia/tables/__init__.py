"""Records: tables in, tables out. What the commands do with files, for tables in memory.

A table is a DataFrame of Polars or pandas, or a Table or RecordBatch of pyarrow; what comes back is
of the same kind. Needs the extra `tables` (Polars); pandas needs pyarrow besides. What is wrong
with a record is a `RecordError`, which has its row and column; what looks wrong, as radians in a
column of degrees, is a `RecordWarning`.

Groups are independent of each other, so a recording may be cut between them: every function here is
one for `map_partitions` of Dask and `map_batches` of Ray, and `stream` makes it one for an iterator
of record batches, as `mapInArrow` of Spark and readers of large files have.
"""

from tertia.tables._bearing import bearing
from tertia.tables._evaluate import evaluate
from tertia.tables._fuse_series import fuse_series
from tertia.tables._locate import locate
from tertia.tables._reconstruct import reconstruct
from tertia.tables._records import ColumnError, RecordError, RecordWarning
from tertia.tables._screen import Rule, screen
from tertia.tables._sensors import Sensors
from tertia.tables._smooth import smooth
from tertia.tables._stream import stream
from tertia.tables._track import track
from tertia.tables._weights import weights

__all__ = [
    "ColumnError",
    "RecordError",
    "RecordWarning",
    "Rule",
    "Sensors",
    "bearing",
    "evaluate",
    "fuse_series",
    "locate",
    "reconstruct",
    "screen",
    "smooth",
    "stream",
    "track",
    "weights",
]
