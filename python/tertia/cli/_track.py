"""`tertia track`: tracks of the plots of radars."""

import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from tertia import tracker
from tertia.cli import _maps, _tables
from tertia.cli._options import (
    ClockPeriod,
    ColumnNames,
    Origin,
    PlanFile,
    PlotFile,
    PlotFiles,
    RadarFile,
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
from tertia.cli._stream import STDIN, Rows, Stream
from tertia.cli._terminal import WRONG_USAGE, counted, fail, note, print_table, shown, working
from tertia.cli._track_report import PICTURES, write_report
from tertia.cli._tracked import Tracked, draw, figures, lines, radar_rows, summary
from tertia.flightplan import FlightPlan
from tertia.sensors import Radar
from tertia.tracker import MotionName

EXAMPLES = (
    "tertia track plots.csv --radars radars.toml --output tracks.csv --plot tracks.png",
    "tertia track plots.csv --radars radars.toml --plans plans.json --report report",
    "tail -f plots.csv | tertia track --stream --radars radars.toml",
    "tertia track north.csv south.csv --radars radars.csv --column range_nm=rho --coasting 3",
)
# hijack, no radio, emergency
_EMERGENCIES = (0o7500, 0o7600, 0o7700)
_PLANE = [[0.0, 0.0], [1000.0, 0.0]]


def track(
    files: PlotFiles = None,
    *,
    radars: RadarFile,
    plans: PlanFile = None,
    origin: Origin = None,
    column: ColumnNames = None,
    motion: Annotated[MotionName, typer.Option(help="How targets move.")] = "imm",
    flown_probability: Annotated[
        float, typer.Option(help="Probability that a planned turn is flown.")
    ] = 0.8,
    wind: Annotated[
        str,
        typer.Option(metavar="EAST,NORTH", help="Velocity of the air to the east and north, m/s."),
    ] = "0,0",
    wind_sigma: Annotated[float, typer.Option(help="Sigma of the wind in m/s.")] = 20.0,
    confirmation: Annotated[
        str,
        typer.Option(metavar="M,N", help="M plots in N scans confirm a track."),
    ] = "3,4",
    coasting: Annotated[
        int, typer.Option(help="Scans without a plot after which a track ends.")
    ] = 5,
    clutter_density: Annotated[
        float | None,
        typer.Option(help="False plots per m² and scan; by default estimated from the plots."),
    ] = None,
    max_speed: Annotated[float, typer.Option(help="No target is faster, in m/s.")] = 350.0,
    gate_probability: Annotated[
        float, typer.Option(help="Probability that a target's plot is within its gate.")
    ] = 0.998,
    clock_period: ClockPeriod = None,
    output: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write the tracks as .csv, .parquet, .arrow, .jsonl, .json, .geojson or .kml.",
        ),
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Write a summary, tables and pictures to a folder."),
    ] = None,
    plot_file: PlotFile = None,
    stream: Annotated[
        bool,
        typer.Option(
            "--stream",
            help="Track plots as they come: lines of CSV or JSON on standard input, or of one "
            "file; rows of confirmed tracks go to standard output.",
        ),
    ] = False,
    latency: Annotated[
        float | None,
        typer.Option(
            help="Seconds for which a stream gathers plots; by default a quarter of a scan."
        ),
    ] = None,
    rows: Annotated[
        Rows | None,
        typer.Option(help="What a stream writes; by default what it reads."),
    ] = None,
) -> dict[str, Any]:
    """Track the targets that one radar or several see, along their flight plans if they have any.

    One row per plot: time_s, range_m or range_nm, azimuth_deg; radar, if there are several; and, if
    known, height_m or flight_level, and icao_address, mode_3a or identity. Rows in any order.
    """
    columns = column_names(column or [])
    options: dict[str, Any] = {
        "motion": motion,
        "confirmation": pair(confirmation, "--confirmation", int),
        "coasting": coasting,
        "clutter_density": clutter_density,
        "max_speed": max_speed,
        "gate_probability": gate_probability,
        "clock_period": clock_period,
    }
    place = None if origin is None else pair(origin, "--origin", float)
    air = (flown_probability, pair(wind, "--wind", float), wind_sigma)
    options["plan_model"] = _check(options, air, with_plans=plans is not None)
    if report is not None and report.exists() and not report.is_dir():
        fail(f"cannot write {report}: it is no folder", WRONG_USAGE)
    _tables.check_suffixes(output, plot_file, maps=_maps.SUFFIXES)
    _tables.check_suffixes(None, None if report is None else Path(PICTURES[0]))
    given = files or []
    if stream:
        if any(one is not None for one in (output, report, plot_file)):
            fail("a stream goes to standard output; it has no --output, --report or --plot")
        source = _source(given, latency)
        sites = read_radars(radars)
        filed = filed_plans(plans, place, sites)
        one = tracker.Tracker(sites.radars, plans=filed, **options)
        name = "standard input" if source == STDIN else str(source)
        told_as = Stream(one, sites, columns, latency=latency, rows=rows, name=name)
        _run(told_as, source)
        return {}
    if latency is not None or rows is not None:
        fail("--latency and --rows are for --stream", WRONG_USAGE)
    if not given or STDIN in given:
        fail("give files of plots, or --stream to read standard input", WRONG_USAGE)
    opened = open_files(given, columns)
    sites = read_radars(radars, told_of_radars(opened))
    _maps.check(output, sites.places, radars)
    filed = filed_plans(plans, place, sites)
    recording = recording_of(opened, sites)
    if clock_period is not None and recording.clock.dated:
        fail("--clock-period is for seconds; these plots have dates", WRONG_USAGE)
    if recording.identities.name == "mode_3a":
        options["emergency_codes"] = _EMERGENCIES
    tracked = _track(recording, sites, filed, options)

    told = radar_rows(tracked)
    print_table(told, shown, text=["radar"], limited="radars are shown")
    if (told_origin := sites.places.origin()) is not None:
        typer.echo(told_origin)
    _say(tracked)
    if output is not None and _maps.is_map(output):
        _maps.write(lines(tracked), output, "track")
    elif output is not None:
        _tables.write(tracked.rows(), output)
    if report is not None:
        write_report(tracked, told, report)
    if plot_file is not None:
        draw(tracked, plot_file)
    return summary(tracked, told)


def _source(files: Sequence[Path], latency: float | None) -> Path:
    """Return where a stream comes from, or fail."""
    if sys.stdout is sys.stderr:
        # where --json has put what else is printed
        fail("a stream has no --json; --rows jsonl writes its rows so", WRONG_USAGE)
    if latency is not None and not 0 <= latency < np.inf:
        fail(f"--latency is {latency:g}; it must be a number of seconds, 0 or more", WRONG_USAGE)
    if len(files) > 1:
        fail("a stream is one file, or standard input", WRONG_USAGE)
    source = files[0] if files else STDIN
    if not _tables.has_lines(source):
        fail(f"cannot stream {source}: a stream has lines of CSV or JSON", WRONG_USAGE)
    return source


def _run(told: Stream, source: Path) -> None:
    """Track what comes from a file, or from standard input."""
    out = typer.get_binary_stream("stdout")
    if source == STDIN:
        told.run(sys.stdin.fileno(), out)
        return
    try:
        with source.open("rb") as file:
            told.run(file.fileno(), out)
    except FileNotFoundError:
        fail(f"there is no file {source}", WRONG_USAGE)
    except OSError as error:
        fail(f"cannot read {source}: {error.strerror}")


def _check(
    options: dict[str, Any], air: tuple[float, tuple[float, float], float], *, with_plans: bool
) -> tracker.PlanModel:
    """Let the library judge the options before the work."""
    radar = Radar(range_sigma=1.0, azimuth_sigma=1.0, scan_period=1.0)
    plans = [FlightPlan(_PLANE, 100.0)] if with_plans else []
    try:
        model = tracker.PlanModel(*air)
        tracker.Tracker([radar], plans=plans, plan_model=model, **options)
    except ValueError as error:
        fail(str(error), WRONG_USAGE)
    return model


def _track(
    recording: Recording,
    sites: RadarSites,
    plans: Sequence[FlightPlan],
    options: dict[str, Any],
) -> Tracked:
    plots = recording.plots
    start = time.perf_counter()
    with working(f"Tracking {counted(len(plots), 'plot')}"):
        try:
            table = tracker.track(plots, sites.radars, plans=plans, **options)
        except ValueError as error:
            fail(str(error))
    seconds = time.perf_counter() - start
    if len(plots) and np.all(table.track_of_plot < 0):
        reasons = Tracked(recording, sites, plans, table, seconds).refused()
        fail(f"no plot can be used: {'; '.join(reasons)}")
    return Tracked(recording, sites, plans, table, seconds)


def _say(tracked: Tracked) -> None:
    told = figures(tracked)
    typer.echo(
        f"{counted(told['tracks'], 'track')}, {counted(told['rows'], 'row')} in "
        f"{told['duration_s']:.6g} s, {told['turning']:.1%} of them in a turn"
    )
    if tracked.plans:
        typer.echo(
            f"  {counted(told['tracks_with_plan'], 'track')} with one of "
            f"{counted(len(tracked.plans), 'plan')}, {told['tracks_that_left_their_plan']} of them "
            "left it"
        )
    for remark in tracked.recording.remarks:
        typer.echo(f"  {remark}")
    for reason, count in tracked.refused().items():
        typer.echo(f"  {counted(count, 'plot')} refused: {reason}")
    typer.echo(f"  {told['plots'] / tracked.seconds:,.0f} plots tracked per second")
    if not told["tracks"]:
        note("no track was confirmed")
