"""`tertia register`: systematic errors and noise of radars."""

from typing import Any

import polars as pl

from tertia._result import counted
from tertia.cli.files import read, write
from tertia.cli.terminal import options as opt
from tertia.cli.terminal.say import WRONG_USAGE, fail, note, print_table, working
from tertia.tables._register import Registered, registered
from tertia.tables._track import recording_of

EXAMPLES = (
    "tertia register plots.csv --sensors sensors.toml --output found.csv",
    "tertia track plots.csv --sensors found.csv --output tracks.csv",
)
# errors that are shown for each radar: their names, their columns, and the columns of their sigmas
_SHOWN = (
    ("range", "range_bias_m", "range_bias_sigma_m"),
    ("range_gain", "range_gain", "range_gain_sigma"),
    ("azimuth", "azimuth_bias_deg", "azimuth_bias_sigma_deg"),
    ("time", "time_bias_s", "time_bias_sigma_s"),
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
    if not files:
        fail("give files of plots", WRONG_USAGE)
    write.check_suffixes(output)
    plots = read.plots(*files)
    radars = read.read_radars(sensors, plots, flat=flat)
    recording = recording_of(plots, radars, opt.column_names(column))
    with working(f"Registering {counted(len(radars.items), 'radar')}"):
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
    if output is not None:
        write.write(rows, output)
    changes = [{"radar": name, "time": time} for name, time in found.changes]
    return {"radars": rows.to_dicts(), "changes": changes}


def _shown(found: Registered, rows: pl.DataFrame) -> pl.DataFrame:
    """Return the errors that the plots determine, and the noise."""
    seen = found.registration.observable
    columns: dict[str, pl.Series] = {"radar": rows["name"]}
    for kind, value, sigma in _SHOWN:
        for name in (value, sigma):
            columns[name] = pl.select(pl.when(pl.Series(seen[kind])).then(rows[name])).to_series()
    for name in ("range_noise_factor", "azimuth_noise_factor"):
        columns[name] = rows[name]
    return pl.DataFrame(columns)
