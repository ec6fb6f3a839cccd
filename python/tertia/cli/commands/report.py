"""`tertia report`: one page about a recording of radars."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from datetime import datetime, timezone
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import polars as pl
import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

from tertia import report as pages
from tertia.cli.files import read, write
from tertia.cli.files.limits import read_limits
from tertia.cli.terminal import options as opt
from tertia.cli.terminal.options import input_file, option, output_file
from tertia.cli.terminal.say import WRONG_USAGE, fail, print_table
from tertia.report import Emitter, Report
from tertia.sensors._identities import NUMBERS, leading
from tertia.tables._evaluate import truth_of
from tertia.tables._measurements import read_targets
from tertia.tables._times import Clock
from tertia.tables._track import refuse_period

EXAMPLES = (
    "tertia report plots.csv --sensors sensors.toml --output report.html",
    "tertia report plots.csv --sensors sensors.toml --plans plans.json --truth truth.csv "
    "--bearings bearings.csv --by target --output report.html",
)
_SUFFIXES = (".html", ".htm")
_SHOWN = {
    "radar": "sensor",
    "plots": "plots",
    "range_sigma_stated_m": "stated (m)",
    "range_sigma_m": "found (m)",
    "azimuth_sigma_stated_deg": "stated (°)",
    "azimuth_sigma_deg": "found (°)",
    "range_bias_m": "bias (m)",
    "azimuth_bias_deg": "bias (°)",
    "probability_of_update": "updates",
}


def report(
    files: opt.PlotFiles = None,
    *,
    sensors: opt.SensorFile,
    plans: opt.PlanFile = None,
    truth: Annotated[Path | None, input_file(opt.TRUTH)] = None,
    bearings: Annotated[
        Path | None, option("Azimuths from the stations, as read by tertia locate.", metavar="FILE")
    ] = None,
    by: opt.By = None,
    origin: opt.Origin = None,
    flat: opt.Flat = False,
    column: opt.ColumnNames = None,
    motion: opt.MotionModel = "imm",
    profile: opt.Profile = "aircraft",
    clock_period: opt.ClockPeriod = None,
    registration: opt.RegistrationSwitch = None,
    update_interval: opt.UpdateInterval = None,
    max_distance: opt.MaxDistance = 1000.0,
    limits: opt.LimitFile = None,
    output: Annotated[Path, output_file("File for the page, .html.")] = Path("report.html"),
) -> dict[str, Any]:
    """Show a recording on one page: tracks, radars, fusion, plans, errors, emitters.

    Plots, radars and plans are read as by tertia track, the truth as by tertia evaluate, and
    bearings as by tertia locate, from the stations of the sensors file; --by applies to bearings.
    Without plots, the page shows only the bearings. The page needs no network.
    """
    write.check_suffix(output, _SUFFIXES)
    if not files and bearings is None:
        fail("give files of plots, or --bearings", WRONG_USAGE)
    if not files and (plans is not None or truth is not None):
        fail("--plans and --truth are for plots: give files of plots", WRONG_USAGE)
    given: dict[str, Any] = {}
    clock: Clock | None = None
    if files:
        names = opt.column_names(column)
        place = opt.pair(origin, "--origin", float)
        given, clock = _seen(
            files, sensors, plans=plans, truth=truth, place=place, flat=flat, names=names
        )
        refuse_period(clock_period, clock)
        given |= {"motion": motion, "profile": profile, "clock_period": clock_period}
        given["limits"] = read_limits(limits)
        given |= {"max_distance": max_distance, "update_interval": update_interval}
        given["registration"] = opt.switched(registration)
    if bearings is not None:
        heard, clock = _heard(bearings, sensors, by or [], clock)
        given |= heard
    shown = files or ([] if bearings is None else [bearings])
    with _bar() as tell:
        page = pages.make(
            **given,
            since=_since(clock),
            title=f"Report on {', '.join(path.name for path in shown)}",
            progress=tell,
        )
    _say(page)
    write.write_text(page.html, output)
    typer.echo(f"wrote {len(page.html.encode()) / 1e6:.1f} MB to {output}")
    return page.summary


def _seen(
    files: list[Path],
    sensors: Path,
    *,
    plans: Path | None,
    truth: Path | None,
    place: tuple[float, float] | None,
    flat: bool,
    names: dict[str, str],
) -> tuple[dict[str, Any], Clock]:
    """Read plots, radars, plans and truth; return the clock of the plots as well."""
    recording = read.recording(files, sensors, names, flat=flat)
    radars, clock = recording.sensors, recording.clock
    filed = read.read_plans(plans, place, radars)
    if place is None and radars.frame is not None:
        place = radars.frame.latitude, radars.frame.longitude
    given = {
        "plots": recording.plots,
        "sensors": radars.items,
        "plans": filed,
        "truth": None
        if truth is None
        else truth_of(read.truth(truth), clock, place, identity=leading(recording.plots, NUMBERS)),
    }
    return given, clock


def _heard(
    bearings: Path, sensors: Path, by: list[str], clock: Clock | None
) -> tuple[dict[str, Any], Clock]:
    """Read bearings and stations, in the time scale of the plots if there are any."""
    # with heights, because there may also be elevations, which are not used
    stations = read.read_stations(sensors)
    # --column is for plots
    source = [replace(part, option=None) for part in read.tables(bearings)]
    targets = [one for one in read_targets(source, stations, by=by) if "azimuth" in one.values]
    if not targets:
        fail(f"{bearings} has no azimuths")
    if any(target.has_places for target in targets):
        fail(
            f"{bearings} has positions of moving direction finders, which a report cannot show: "
            "use tertia locate or tertia reconstruct"
        )
    own = Clock.of(pl.concat([target.moments for target in targets]), midnight=True)
    if clock is not None and clock.dated != own.dated:
        fail(f"time_s of {bearings} and of the plots must both be dates, or both be seconds")
    clock = clock or own
    emitters = [
        Emitter(
            ", ".join(str(cell) for cell in target.keys.row(0)) if by else "the emitter",
            clock.seconds(target.moments),
            target.values["azimuth"],
        )
        for target in targets
    ]
    return {"stations": stations.flat().items, "bearings": emitters}, clock


@contextmanager
def _bar() -> Iterator[Callable[[str, float], None]]:
    """Show the current step and the progress, if the output is a terminal."""
    console = Console(stderr=True)
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as bar:
        task = bar.add_task("", total=1.0)
        yield lambda what, share: bar.update(task, description=what, completed=share)


def _since(clock: Clock | None) -> datetime | None:
    """Return the midnight from which dates are counted."""
    if clock is None or not clock.dated:
        return None
    zero: datetime = clock.moments(np.zeros(1)).item()
    return zero if zero.tzinfo is None else zero.astimezone(timezone.utc)


def _say(page: Report) -> None:
    found = page.summary
    if found["radars"]:
        rows = [{title: row[key] for key, title in _SHOWN.items()} for row in found["radars"]]
        print_table(pl.DataFrame(rows), text=["sensor"], limited="sensors are shown")
        if found["fusion"]:
            print_table(pl.DataFrame(found["fusion"]), text=["tracks"])
        typer.echo(
            f"{found['tracks']} tracks of {found['plots']} plots in {found['duration_s']:.6g} s"
        )
    for finding in found["findings"]:
        typer.echo(f"  {finding}")
