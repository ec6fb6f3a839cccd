"""`tertia register`: systematic errors and noise of radars."""

from typing import Any

import polars as pl

from tertia._result import counted
from tertia.cli.files import read, write
from tertia.cli.terminal import options as opt
from tertia.cli.terminal.say import note, print_table, working
from tertia.tables._register import Registered, registered
from tertia.tables._sensors import RADAR_BIAS

EXAMPLES = (
    "tertia register plots.csv --sensors sensors.toml --output found.csv",
    "tertia track plots.csv --sensors found.csv --output tracks.csv",
)


def register(
    files: opt.PlotFiles = None,
    *,
    sensors: opt.SensorFile,
    flat: opt.Flat = False,
    column: opt.ColumnNames = None,
    profile: opt.Profile = "aircraft",
    clock_period: opt.ClockPeriod = None,
    n_threads: opt.Threads = None,
    output: opt.Output = None,
) -> dict[str, Any]:
    """Estimate range, gain, azimuth and clock errors of radars from common targets.

    The plots are read as by tertia track. The output is a file of sensors with the estimated errors
    and noise at the end of the recording; if it is given to tertia track as --sensors, the errors
    are subtracted from the plots. For an error that the plots do not determine, the sigma of the
    sensors file or of EUROCONTROL's standard is written.
    """
    write.check_suffixes(output)
    recording = read.recording(files, sensors, opt.column_names(column), flat=flat)
    with working(f"Registering {counted(len(recording.sensors.items), 'radar')}"):
        found = registered(recording, n_threads, profile=profile, clock_period=clock_period)
    rows = found.rows
    print_table(_shown(found, rows), text=["radar"], limited="radars are shown")
    if not any(seen.any() for seen in found.registration.observable.values()):
        note("no error can be estimated: at least two radars must see the same targets")
    for name, time in found.changes:
        note(f"the errors of {name} changed suddenly at {time}; those at the end are written")
    if found.registration.bias.deviation_order > 0:
        note(
            "azimuth errors change with the azimuth; azimuth_bias_sigma_deg contains this, which a "
            "sensors file does not describe"
        )
    write.write(rows, output)
    changes = [{"radar": name, "time": time} for name, time in found.changes]
    return {"radars": rows.to_dicts(), "changes": changes}


def _shown(found: Registered, rows: pl.DataFrame) -> pl.DataFrame:
    """Return the errors that the plots determine, and the noise."""
    seen = found.registration.observable
    columns: dict[str, pl.Series] = {"radar": rows["name"]}
    for kind, (value, sigma, _) in RADAR_BIAS.items():
        for name in (value, sigma):
            columns[name] = pl.select(pl.when(pl.Series(seen[kind])).then(rows[name])).to_series()
    for name in ("range_noise_factor", "azimuth_noise_factor"):
        columns[name] = rows[name]
    return pl.DataFrame(columns)
