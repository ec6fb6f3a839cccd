"""`tertia track`: tracks from the plots of radars."""

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tertia import plot
from tertia._result import counted
from tertia.cli.commands import stream as streams
from tertia.cli.commands.control import Control
from tertia.cli.files import maps, read, write
from tertia.cli.terminal import options as opt
from tertia.cli.terminal.options import option
from tertia.cli.terminal.say import WRONG_USAGE, fail, line, note, print_table, working
from tertia.sensors import Bias, Radar
from tertia.tables import Sensors
from tertia.tables._track import NO_TRACK, Tracking, recording_of, tracks_of
from tertia.tracker import AssociationName, PlanModel, Tracker

if TYPE_CHECKING:
    from matplotlib.figure import Figure


EXAMPLES = (
    "tertia track plots.csv --sensors sensors.toml --output tracks.csv --plot tracks.png",
    "tertia track plots.csv --sensors sensors.toml --plans plans.json --output tracks.parquet",
    "tail -n +1 -f plots.csv | tertia track --stream --sensors sensors.toml",
    "tail -n +1 -f lines.jsonl | tertia track --stream --control --sensors sensors.toml",
    "tertia track north.csv south.csv --sensors radars.csv --column range_nm=rho --coasting 3",
)
_FIGURE_SIZE = (11.0, 9.0)
# columns of the errors of radars, columns of their sigmas, names and units
_ERRORS = (
    ("range_bias_m", "range_bias_sigma_m", "range", " m"),
    ("range_gain", "range_gain_sigma", "range gain", ""),
    ("azimuth_bias_deg", "azimuth_bias_sigma_deg", "azimuth", " deg"),
    ("time_bias_s", "time_bias_sigma_s", "time", " s"),
)


def track(
    files: opt.PlotFiles = None,
    *,
    sensors: opt.SensorFile,
    plans: opt.PlanFile = None,
    fixes: opt.FixFile = None,
    airways: opt.AirwayFile = None,
    origin: opt.Origin = None,
    flat: opt.Flat = False,
    column: opt.ColumnNames = None,
    motion: opt.MotionModel = "imm",
    association: Annotated[
        AssociationName, option("How plots are assigned to tracks; mht: with several hypotheses.")
    ] = "gnn",
    flown_probability: Annotated[float, option("Probability that a planned turn is flown.")] = 0.8,
    wind: Annotated[
        str, option("Velocity of the air to the east and north, m/s.", metavar="EAST,NORTH")
    ] = "0,0",
    wind_sigma: Annotated[float, option("Sigma of the wind in m/s.")] = 20.0,
    initiation: Annotated[
        bool, option("Expect new targets where flights without a track are due.")
    ] = False,
    confirmation: Annotated[
        str, option("M plots in N scans confirm a track.", metavar="M,N")
    ] = "3,4",
    coasting: Annotated[
        int, option("Number of scans without a plot after which a track ends.")
    ] = 5,
    clutter_density: Annotated[
        float | None, option("False plots per m² and scan; by default estimated from the plots.")
    ] = None,
    profile: opt.Profile = "aircraft",
    max_speed: Annotated[
        float | None,
        option("Largest speed of a target in m/s; by default, the largest speed of the profile."),
    ] = None,
    gate_probability: Annotated[
        float, option("Probability that a target's plot is within its gate.")
    ] = 0.998,
    identity_error_probability: Annotated[
        float, option("Probability that an identity is wrong; use 1e-9 for MMSI of vessels.")
    ] = 1e-3,
    lag: Annotated[
        float,
        option(
            "Seconds by which plots of a stream may be late; rows are written at once, and "
            "may be replaced until they are final."
        ),
    ] = 0.0,
    clock_period: opt.ClockPeriod = None,
    registration: opt.RegistrationSwitch = None,
    trusted: Annotated[
        list[str] | None,
        option("A radar without systematic errors; may be repeated.", metavar="NAME"),
    ] = None,
    n_threads: opt.Threads = None,
    output: opt.MapOutput = None,
    plot_file: opt.PlotFile = None,
    stream: Annotated[
        bool,
        option(
            "Track plots as they arrive, as lines of CSV or JSON on standard input or in one "
            "file; write rows of confirmed tracks to standard output.",
            "--stream",
        ),
    ] = False,
    control: Annotated[
        bool, option("Execute control lines in the stream, such as add_plan.", "--control")
    ] = False,
    latency: Annotated[
        float | None,
        option("Seconds for which a stream collects plots; by default a quarter of a scan."),
    ] = None,
    udp: Annotated[
        str | None,
        option(
            "Track plots that arrive in ASTERIX by UDP, as with --stream, until Ctrl-C.",
            metavar="[GROUP:]PORT",
        ),
    ] = None,
    send: Annotated[
        str | None,
        option(
            "Send the tracks of a stream by UDP in ASTERIX, category 62; by default, write "
            "them to standard output.",
            metavar="HOST:PORT",
        ),
    ] = None,
    rows: Annotated[
        streams.Rows | None,
        option("Format of the rows of a stream; by default the format of its input."),
    ] = None,
) -> dict[str, Any]:
    """Track targets from the plots of one or several radars, with flight plans if given.

    One row per plot, in any order: time_s; range_m or range_nm, and azimuth_deg, or for position
    sensors east_m and north_m; sensor, if there are several; and, if known, height_m or
    flight_level, and icao_address, mode_3a, callsign and identity.
    """
    columns = opt.column_names(column)
    place = opt.pair(origin, "--origin", float)
    options: dict[str, Any] = {
        "motion": motion,
        "plan_model": PlanModel(
            flown_probability, opt.pair(wind, "--wind", float) or (0.0, 0.0), wind_sigma, initiation
        ),
        "association": association,
        "confirmation": opt.pair(confirmation, "--confirmation", int),
        "coasting": coasting,
        "clutter_density": clutter_density,
        "profile": profile,
        "max_speed": max_speed,
        "gate_probability": gate_probability,
        "identity_error_probability": identity_error_probability,
        "lag": lag,
        "clock_period": clock_period,
        "registration": opt.switched(registration),
        "n_threads": n_threads,
    }
    given = files or []
    if stream or udp is not None:
        if output is not None or plot_file is not None:
            fail("a stream is written to standard output; --output and --plot cannot be used")
        if udp is not None and (given or control):
            fail("--udp cannot be used with files or --control", WRONG_USAGE)
        source = streams.source(given) if udp is None else udp
        described = read.read_sensors if udp is None else read.read_radars
        radars = _trusting(described(sensors, flat=flat), trusted)
        filed = read.read_plans(plans, place, radars, fixes=fixes, airways=airways)
        frame = read.plan_frame(place, radars)
        if udp is not None:
            # times of ASTERIX are times of day
            options["clock_period"] = clock_period or 86_400.0
        tracker = Tracker(radars.items, plans=filed, **options)
        commands = Control(tracker, filed, frame) if control else None
        streams.run(
            source,
            radars,
            tracker,
            filed,
            columns,
            control=commands,
            latency=latency,
            rows=rows,
            send=send,
        )
        return {}
    if latency is not None or rows is not None or send is not None or control:
        fail("--latency, --rows, --send and --control can be used only with --stream", WRONG_USAGE)
    if not given or streams.STDIN in given:
        fail("give files of plots, or --stream to read standard input", WRONG_USAGE)
    write.check_suffixes(output, plot_file, maps=[*maps.SUFFIXES, *write.ASTERIX])
    plots = read.plots(*given)
    radars = _trusting(read.read_sensors(sensors, plots, flat=flat), trusted)
    maps.check(output, radars)
    filed = read.read_plans(plans, place, radars, fixes=fixes, airways=airways)
    recording = recording_of(plots, radars, columns)
    with working(f"Tracking {counted(len(recording.plots), 'plot')}"):
        tracking = tracks_of(recording, filed, **options)
    print_table(tracking.sensors, text=["sensor"], limited="sensors are shown")
    summary = tracking.summary()
    _say(tracking, summary)
    if maps.is_map(output):
        maps.write(_lines(tracking), output, "track")
    elif output is not None and output.suffix.lower() in write.ASTERIX:
        write.write_asterix(tracking.rows, output)
    else:
        write.write(tracking.rows, output)
    write.save(plot_file, _FIGURE_SIZE, partial(_draw, tracking))
    return summary | {"sensors": tracking.sensors.to_dicts()}


def _trusting(radars: Sensors[Radar], trusted: list[str] | None) -> Sensors[Radar]:
    """Return the radars, with no systematic errors for the trusted ones."""
    for name in trusted or []:
        if name not in radars.names:
            fail(f"--trusted {name!r}: there is no such radar", WRONG_USAGE)
    items = [
        replace(one, bias=Bias()) if name in (trusted or []) else one
        for name, one in zip(radars.names, radars.items, strict=True)
    ]
    return replace(radars, items=items)


def _say(tracking: Tracking, summary: dict[str, Any]) -> None:
    line(tracking.recording.sensors.origin())
    tracks, rows = summary["track_count"], summary["row_count"]
    typer.echo(
        f"{counted(tracks, 'track')}, {counted(rows, 'row')} in {summary['duration_s']:.6g} s, "
        f"{summary['turn_share']:.1%} of them in a turn"
    )
    if tracking.plans:
        typer.echo(
            f"  {counted(summary['planned_track_count'], 'track')} with one of "
            f"{counted(len(tracking.plans), 'plan')}, {summary['left_plan_count']} of which left "
            "the plan"
        )
    for reason, count in summary["refused_count"].items():
        typer.echo(f"  {counted(count, 'plot')} refused: {reason}")
    for radar in tracking.errors.iter_rows(named=True):
        found = ", ".join(
            f"{words} {radar[name]:+.3g} ± {radar[sigma]:.2g}{unit}"
            for name, sigma, words, unit in _ERRORS
            if radar[name] is not None
        )
        if found:
            typer.echo(f"  {radar['sensor']}: errors subtracted: {found}")
    rate = summary["plot_count"] / summary["tracking_s"]
    typer.echo(f"  {rate:,.0f} plots tracked per second")
    if not tracks:
        note(f"{NO_TRACK} --max-speed")


def _lines(tracking: Tracking) -> list[maps.Feature | None]:
    """Return the tracks as lines on a map."""
    rows = tracking.rows
    groups = rows.partition_by("track", as_dict=True)
    return [
        maps.feature(groups[(row["track"],)], f"track {row['track']}", row)
        for row in tracking.tracks(rows).iter_rows(named=True)
    ]


def _draw(tracking: Tracking, figure: "Figure") -> None:
    of = tracking.recording
    # radars come first
    radars = [one for one in of.sensors.items if isinstance(one, Radar)]
    shown = (tracking.table.track_of_plot >= 0) & (of.plots.sensor < len(radars))
    plot.tracks(
        tracking.table,
        radars,
        plots=of.plots[shown],
        plans=tracking.plans,
        ax=figure.subplots(),
    )
