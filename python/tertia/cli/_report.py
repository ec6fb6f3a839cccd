"""`tertia report`: a recording of radars on one page."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import polars as pl
import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

from tertia import report as pages
from tertia.cli import _tables
from tertia.cli._judged import read_truth
from tertia.cli._measurements import Columns, by_target, read_measurements
from tertia.cli._options import (
    By,
    ClockPeriod,
    ColumnNames,
    Origin,
    PlanFile,
    PlotFiles,
    RadarFile,
    RequiredPeriod,
    TargetDistance,
    check_judging,
    pair,
)
from tertia.cli._plans import filed_plans
from tertia.cli._radar_plots import (
    Recording,
    column_names,
    open_files,
    recording_of,
    told_of_radars,
)
from tertia.cli._radars import RadarSites, read_radars
from tertia.cli._stations import Sites, read_stations
from tertia.cli._terminal import WRONG_USAGE, fail, print_table, shown
from tertia.metrics import Truth
from tertia.report import Emitter, Report
from tertia.tracker import MotionName

EXAMPLES = (
    "tertia report plots.csv --radars radars.toml --output report.html",
    "tertia report plots.csv --radars radars.toml --plans plans.json --truth truth.csv "
    "--bearings bearings.csv --stations stations.toml --by target --output report.html",
)
_SUFFIXES = (".html", ".htm")
_SHOWN = {
    "radar": "radar",
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
    files: PlotFiles = None,
    *,
    radars: RadarFile,
    plans: PlanFile = None,
    truth: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            readable=False,
            help="The truth: time_s, target, east_m, north_m; ASTERIX.",
        ),
    ] = None,
    bearings: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Azimuths by direction finders, as tertia locate reads."),
    ] = None,
    stations: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="The direction finders: .toml, CSV, .parquet."),
    ] = None,
    by: By = None,
    origin: Origin = None,
    column: ColumnNames = None,
    motion: Annotated[MotionName, typer.Option(help="How targets move.")] = "imm",
    clock_period: ClockPeriod = None,
    period: RequiredPeriod = None,
    distance: TargetDistance = 1000.0,
    output: Annotated[Path, typer.Option(metavar="FILE", help="Write the page, .html.")] = Path(
        "report.html"
    ),
) -> dict[str, Any]:
    """Tell on one page what is in a recording: tracks, radars, fusion, plans, errors.

    Plots, radars and plans are those of tertia track, the truth that of tertia evaluate, bearings
    and stations those of tertia locate; --by is for the bearings. The page needs no network.
    """
    columns = column_names(column or [])
    check_judging(distance, period)
    if output.suffix.lower() not in _SUFFIXES:
        fail(f"cannot write {output}: its name must end in {', '.join(_SUFFIXES)}", WRONG_USAGE)
    if (bearings is None) != (stations is None):
        fail("--bearings and --stations belong together", WRONG_USAGE)
    if plans is not None and motion not in ("imm", "window"):
        fail(f"--motion {motion} takes no plans; imm and window do", WRONG_USAGE)
    place = None if origin is None else pair(origin, "--origin", float)
    given = files or []
    if not given:
        fail("give files of plots", WRONG_USAGE)
    opened = open_files(given, columns)
    sites = read_radars(radars, told_of_radars(opened))
    filed = filed_plans(plans, place, sites)
    recording = recording_of(opened, sites)
    if clock_period is not None and recording.clock.dated:
        fail("--clock-period is for seconds; these plots have dates", WRONG_USAGE)
    finders = None if stations is None else _in_the_plane(read_stations(stations))
    emitters = [] if finders is None or bearings is None else _emitters(bearings, finders, by or [])
    real = None if truth is None else _truth(truth, place, sites, recording)

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

        def tell(what: str, share: float) -> None:
            bar.update(task, description=what, completed=share)

        try:
            page = pages.make(
                recording.plots,
                sites.radars,
                motion=motion,
                plans=filed,
                truth=real,
                stations=[] if finders is None else finders.stations(),
                bearings=emitters,
                max_distance=distance,
                update_interval=period,
                title=f"Report on {', '.join(path.name for path in given)}",
                since=_since(recording),
                progress=tell,
                clock_period=clock_period,
            )
        except (ImportError, ValueError, np.linalg.LinAlgError) as error:
            fail(str(error))
    _say(page)
    _tables.write_text(page.html, output)
    typer.echo(f"wrote {len(page.html.encode()) / 1e6:.1f} MB to {output}")
    return page.summary


def _truth(
    path: Path, origin: tuple[float, float] | None, sites: RadarSites, recording: Recording
) -> Truth:
    """Return the truth in the seconds of the plots, and in their plane."""
    clock, frame = recording.clock, sites.places.frame
    if origin is None and frame is not None:
        origin = frame.latitude, frame.longitude
    return read_truth(path, origin, clock.dtype if clock.dated else None, clock.seconds)


def _in_the_plane(sites: Sites) -> Sites:
    """Return direction finders without their heights: bearings have no use for them."""
    places = sites.places
    if places.positions.shape[1] == 2:
        return sites
    if places.axes is not None:
        fail(f"{sites.path}: bearings are for stations in the plane; leave out height_m")
    flat = type(places)(places.positions[:, :2])
    return Sites(sites.path, sites.names, flat, sites.sigmas)


def _emitters(path: Path, sites: Sites, by: list[str]) -> list[Emitter]:
    columns = Columns("time_s", "station", list(dict.fromkeys(by)))
    records = by_target(read_measurements([path], columns, sites), columns, sites)
    heard = [
        Emitter(
            ", ".join(str(value) for value in record.keys.row(0)) if by else "the emitter",
            record.times,
            record.values["azimuth"],
        )
        for record in records
        if "azimuth" in record.values
    ]
    if not heard:
        fail(f"{path} has no azimuths")
    return heard


def _since(recording: Recording) -> str | None:
    """Return the midnight from which dates are counted."""
    clock = recording.clock
    if not clock.dated:
        return None
    midnight = clock.moments(np.zeros(1)).dt.strftime("%Y-%m-%d").item()
    return f"{midnight} 00:00"


def _say(page: Report) -> None:
    told = page.summary
    rows = [{title: row[key] for key, title in _SHOWN.items()} for row in told["radars"]]
    print_table(pl.DataFrame(rows), shown, text=["radar"], limited="radars are shown")
    if told["fusion"]:
        fused = pl.DataFrame(told["fusion"])
        print_table(fused, shown, text=["tracks"], limited="rows are shown")
    typer.echo(f"{told['tracks']} tracks of {told['plots']} plots in {told['duration_s']:.6g} s")
    for finding in told["findings"]:
        typer.echo(f"  {finding}")
