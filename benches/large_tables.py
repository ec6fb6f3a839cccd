"""Recordings that do not fit into memory: rows per second, peak memory, and how both grow.

Makes recordings of so many rows in a folder, as Parquet or CSV, and takes them through
`tertia.tables.stream` in record batches, each task in a process of its own: `copy` reads and writes
all rows, `screen` writes them with their masks, `bearings` one row per 100, `fuse` the tracks of
targets with 10 000 plots of two radars; `command` is `tertia bearing`. The folder is removed. The
exponent is that of the time of all rows.

    python benches/large_tables.py --rows 100000000 --tasks screen bearings
"""

import argparse
import contextlib
import resource
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

sys.path.append(str(Path(__file__).parent / "peers"))

from timing import keep, report_growth

# isort: split
import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.dataset
import pyarrow.parquet

from tertia import tables

GROUP, PLOTS, CHUNK = 100, 10_000, 1_000_000
NOISE = {"sigma": 0.2, "alpha": 0.05, "acceleration_sigma": 0.003}
TASKS = {
    "copy": iter,
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


def command(path):
    """Run `tertia bearing` here."""
    from tertia.cli import main  # noqa: PLC0415  # only here is it needed

    output = str(path.with_name("out.parquet"))
    sys.argv = ["tertia", "bearing", str(path), "--by", "record", "--output", output]
    with contextlib.redirect_stdout(sys.stderr), contextlib.suppress(SystemExit):
        main()


def work(task, path):
    """Run a task here and print seconds of wall and CPU, and peak memory."""
    start, cpu = time.perf_counter(), time.process_time()
    if task == "command":
        command(path)
    else:
        run(task, path)
    seconds, cpu = time.perf_counter() - start, time.process_time() - cpu
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{seconds} {cpu} {peak}")


def run(task, path):
    found = TASKS[task](batches(path))
    first = next(found)
    with pa.parquet.ParquetWriter(path.with_name("out.parquet"), first.schema) as writer:
        writer.write_batch(first)
        for batch in found:
            writer.write_batch(batch)


def measure(task, path, rows, clock):
    """Seconds of a task in a process of its own, by wall or CPU; printed with its memory."""
    command = [sys.executable, __file__, "--work", task, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    seconds, cpu, peak = map(float, done.stdout.split())
    title = f"{path.suffix[1:]}, {task}, {rows:.0e} rows"
    print(
        f"{title}: {seconds:.2f} s, {rows / seconds:,.0f} rows/s ({cpu:.2f} s of CPU), "
        f"peak {peak:.0f} MB",
        flush=True,
    )
    keep(memory=title, peak=peak)
    return {"wall": seconds, "cpu": cpu}[clock]


def grown(kind, rows, seconds):
    if len(rows) > 1:
        for task, each in seconds.items():
            costs = [1e9 * one for one in each]
            report_growth(f"tables, {kind}, {task}, all rows", "rows", rows, costs, "s")
    for task in {"screen"} & seconds.keys() if "copy" in seconds else ():
        costs = {"Tertia": seconds[task][-1], "(reading and writing alone)": seconds["copy"][-1]}
        keep(work=f"tables, {kind}, {task}, {rows[-1]:.0e} rows", unit="s", costs=costs)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=int, nargs="+", default=[10**5, 10**6, 10**7])
    parser.add_argument("--kinds", nargs="+", default=["parquet"], choices=["parquet", "csv"])
    parser.add_argument("--tasks", nargs="+", choices=[*TASKS, "command"])
    parser.add_argument("--clock", choices=("wall", "cpu"), default="wall", help="of the exponents")
    parser.add_argument("--folder", help="where there is space; by default the system's")
    parser.add_argument("--work", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.work:
        return work(options.work[0], Path(options.work[1]))
    tasks = options.tasks or [*TASKS, "command"]
    for kind in options.kinds:
        seconds = {task: [] for task in tasks}
        for rows in options.rows:
            with tempfile.TemporaryDirectory(dir=options.folder) as folder:
                path = Path(folder, f"recording.{kind}")
                make(path, rows)
                for task in tasks:
                    seconds[task].append(measure(task, path, rows, options.clock))
        grown(kind, options.rows, seconds)
    return None


if __name__ == "__main__":
    main()
