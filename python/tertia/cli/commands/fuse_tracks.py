"""`tertia fuse-tracks`: fusion of the tracks of several sensors into one picture."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np

from tertia.cli.files import read, write
from tertia.cli.terminal import options as opt
from tertia.cli.terminal.options import input_files, option
from tertia.cli.terminal.say import print_table, working
from tertia.tables._fuse_tracks import fused_tracks
from tertia.tertiary._centre import TrackMethod, core_settings

EXAMPLES = (
    "tertia fuse-tracks north.csv south.csv --sensors sensors.toml --output picture.csv",
    "tertia fuse-tracks tracks.parquet --sensors sensors.toml --method covariance-intersection",
)


def fuse_tracks(
    files: Annotated[
        list[Path],
        input_files(
            "TRACKS...",
            "Tracks of single sensors, as written by tertia track; files are concatenated.",
        ),
    ],
    *,
    sensors: opt.SensorFile,
    flat: opt.Flat = False,
    column: opt.ColumnNames = None,
    method: Annotated[
        TrackMethod, option("Method by which the tracks of one target are fused.")
    ] = "tracklets",
    registration: Annotated[
        bool | None, option("Estimate the systematic errors of the sensors.")
    ] = None,
    update_interval: Annotated[float, option("Seconds between pictures.", metavar="S")] = 5.0,
    output: opt.Output = None,
) -> dict[str, Any]:
    """Fuse the tracks of several sensors that belong to one target into one track.

    The tracks of a sensor must be made only from the plots of this sensor. Rows without a plot are
    left out.
    """
    write.check_suffixes(output)
    options = {"method": method, "registration": registration, "update_interval": update_interval}
    core_settings(**options)  # type: ignore[arg-type]
    tracks = read.tables(*files)
    radars = read.read_radars(sensors, tracks, flat=flat)
    with working("Fusing the tracks"):
        found = fused_tracks(tracks, radars, opt.column_names(column), **options)
    table = found.per_sensor
    print_table(table, text=["sensor"], limited="sensors are shown")
    write.write(found.rows, output)
    sure = found.picture[found.picture.confirmed & ~found.picture.doubtful]
    return {
        "target_count": found.picture.count,
        "row_count": len(found.picture),
        "mean_target_count": len(sure) / max(len(np.unique(found.picture.time)), 1),
        "sensors": table.to_dicts(),
    }
