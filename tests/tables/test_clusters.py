"""Partitions in other processes, of Spark and of Ray: the same bits as in one process.

Skipped where these are not installed. Spark also needs Java (in Debian `default-jre-headless`), and
`PYSPARK_PYTHON` where its workers would find another Python.
"""

import os
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from shutil import which
from typing import Any

import polars as pl
import polars.testing
import pytest

import tertia
from tertia import tables

pa = pytest.importorskip("pyarrow")
RECORD = tertia.simulate.direction_finder(240, bearing=80.0, rng=4).theta
TABLE = pl.DataFrame(
    {
        "sensor": ["north", "south", "west"] * 80,
        "time_s": [float(k // 3) for k in range(240)],
        "azimuth_deg": RECORD,
    }
)
ESTIMATE = partial(tables.bearing, by="sensor")
EXPECTED = ESTIMATE(TABLE.sort("sensor", "time_s")).sort("sensor")


@pytest.fixture
def spark(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    sql = pytest.importorskip("pyspark.sql")
    if which("java") is None:
        pytest.skip("Spark needs Java")
    monkeypatch.setenv("PYSPARK_PYTHON", sys.executable)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, sys.path)))
    session = (
        sql.SparkSession.builder.master("local[2]")
        .config("spark.ui.enabled", "false")
        .config("spark.sql.shuffle.partitions", "3")
        .config("spark.driver.bindAddress", "127.0.0.1")
        .config("spark.driver.host", "127.0.0.1")
        .getOrCreate()
    )
    yield session
    session.stop()


@pytest.mark.filterwarnings("ignore")  # Spark's own
def test_map_in_arrow_of_spark(spark: Any, tmp_path: Path) -> None:
    path = tmp_path / "recording.parquet"
    TABLE.write_parquet(path)
    schema = ", ".join(f"{name} {_SPARK[str(kind)]}" for name, kind in EXPECTED.schema.items())
    call = partial(tables.stream, tables.bearing, values="azimuth_deg", by="sensor")
    found = (
        spark.read.parquet(str(path))
        .repartition("sensor")
        .sortWithinPartitions("sensor", "time_s")
        .mapInArrow(call, schema)
        .collect()
    )
    rows = pl.DataFrame([row.asDict() for row in found], schema=EXPECTED.schema)
    polars.testing.assert_frame_equal(rows.sort("sensor"), EXPECTED, check_exact=True)


_SPARK = {"String": "string", "Int64": "long", "Float64": "double", "Boolean": "boolean"}


@pytest.mark.filterwarnings("ignore")  # Ray's own
def test_map_groups_of_ray() -> None:
    ray = pytest.importorskip("ray")
    data = pytest.importorskip("ray.data")
    paths = os.pathsep.join(filter(None, sys.path))
    ray.init(
        num_cpus=2,
        include_dashboard=False,
        configure_logging=False,
        log_to_driver=False,
        runtime_env={"env_vars": {"PYTHONPATH": paths}},
    )
    try:
        found = (
            data.from_arrow(TABLE.to_arrow(compat_level=pl.CompatLevel.oldest()))
            .groupby("sensor")
            .map_groups(ESTIMATE, batch_format="pyarrow")
            .to_arrow_refs()
        )
        parts = [pl.from_arrow(ray.get(one)) for one in found]
    finally:
        ray.shutdown()
    rows = pl.concat([one for one in parts if one.height]).sort("sensor")
    polars.testing.assert_frame_equal(
        rows.select(EXPECTED.columns), EXPECTED, check_exact=True, check_dtypes=False
    )
