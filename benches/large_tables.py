"""Recordings that do not fit into memory: rows per second and peak memory.

Makes a recording of so many rows in a folder, as Parquet or CSV, and takes it through
`tertia.tables.stream` in record batches, each task in a process of its own: `screen` writes all
rows with their masks, `bearings` one row per 100, `fuse` the tracks of targets with 10 000 plots of
two radars. The folder is removed.

    python benches/large_tables.py --rows 100000000 --tasks screen bearings
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.dataset
import pyarrow.parquet

from tertia import tables

GROUP, PLOTS, CHUNK = 100, 10_000, 1_000_000
NOISE = {"sigma": 0.2, "alpha": 0.05, "acceleration_sigma": 0.003}
TASKS = {
    "screen": partial(
        tables.stream, tables.screen, values="azimuth_deg", by="record", period=360.0
    ),
    "bearings": partial(tables.stream, tables.bearing, values="azimuth_deg", by="record"),
    "fuse": partial(
        tables.stream,
        tables.fuse_series,
        values="azimuth_deg",
        by="target",
        sensors=["north", "south"],
        **NOISE,
    ),
}


def chunks(rows):
    """A million rows each, the last one fewer."""
    for first in range(0, rows, CHUNK):
        number = np.arange(first, min(first + CHUNK, rows))
        rng = np.random.default_rng(first)
        wrong = rng.random(len(number)) < 0.02
        angle = 359.0 + 3.0 * rng.standard_normal(len(number)) + 40.0 * wrong
        yield pa.record_batch(
            {
                "target": number // PLOTS,
                "record": number // GROUP,
                "time_s": (number % PLOTS) // 2 * 1.0,
                "sensor": pa.DictionaryArray.from_arrays(
                    (number % 2).astype(np.int8), ["north", "south"]
                ).cast(pa.string()),
                "azimuth_deg": angle % 360.0,
            }
        )


def make(path, rows):
    found = chunks(rows)
    first = next(found)
    if path.suffix == ".csv":
        writer = pa.csv.CSVWriter(path, first.schema)
    else:
        writer = pa.parquet.ParquetWriter(path, first.schema)
    with writer:
        writer.write_batch(first)
        for batch in found:
            writer.write_batch(batch)


def batches(path):
    if path.suffix == ".csv":
        # 8 MB at a time
        return pa.csv.open_csv(path, pa.csv.ReadOptions(block_size=2**23))
    # buffered it would end up in memory as a whole
    return pa.parquet.ParquetFile(path, pre_buffer=False).iter_batches(batch_size=2**17)


def work(task, path):
    """Run a task here and print rows, seconds and peak memory."""
    start = time.perf_counter()
    found = TASKS[task](batches(path))
    first = next(found)
    rows = first.num_rows
    with pa.parquet.ParquetWriter(path.with_name("out.parquet"), first.schema) as writer:
        writer.write_batch(first)
        for batch in found:
            writer.write_batch(batch)
            rows += batch.num_rows
    seconds = time.perf_counter() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{rows} {seconds} {time.process_time()} {peak}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=int, default=10_000_000)
    parser.add_argument("--kinds", nargs="+", default=["parquet", "csv"])
    parser.add_argument("--tasks", nargs="+", choices=TASKS, default=list(TASKS))
    parser.add_argument("--folder", help="where there is space; by default the system's")
    parser.add_argument("--work", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.work:
        return work(options.work[0], Path(options.work[1]))
    for kind in options.kinds:
        with tempfile.TemporaryDirectory(dir=options.folder) as folder:
            path = Path(folder, f"recording.{kind}")
            make(path, options.rows)
            size = path.stat().st_size / 1e9
            for task in options.tasks:
                command = [sys.executable, __file__, "--work", task, str(path)]
                done = subprocess.run(command, capture_output=True, text=True, check=True)
                rows, seconds, cpu, peak = map(float, done.stdout.split())
                print(
                    f"{kind} ({size:.1f} GB), {task}: {options.rows:.0e} rows in {seconds:.0f} s, "
                    f"{options.rows / seconds:,.0f} rows/s ({cpu:.0f} s of CPU), "
                    f"{rows:.0f} rows out, peak {peak:.0f} MB",
                    flush=True,
                )
    return None


if __name__ == "__main__":
    main()
