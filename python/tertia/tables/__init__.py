"""Tables in, tables out: what the commands do with files, for tables in memory.

A table is a DataFrame of Polars or pandas, or a Table or RecordBatch of pyarrow; what comes back is
of the same kind. Needs the extra `tables` (Polars); pandas needs pyarrow besides.

Groups are independent of each other, so a recording may be cut between them: every function here is
one for `map_partitions` of Dask and `map_batches` of Ray, and `stream` makes it one for an iterator
of record batches, as `mapInArrow` of Spark and readers of large files have.
"""

from tertia.tables._bearings import bearings
from tertia.tables._fuse import fuse
from tertia.tables._screen import Rule, screen
from tertia.tables._smooth import smooth
from tertia.tables._stream import stream
from tertia.tables._track import track

__all__ = ["Rule", "bearings", "fuse", "screen", "smooth", "stream", "track"]
