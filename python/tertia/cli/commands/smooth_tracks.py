"""`tertia smooth-tracks`: estimation of tracks from all their plots."""

from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from tertia import plot
from tertia._result import counted
from tertia.cli.files import read, write
from tertia.cli.terminal import options as opt
from tertia.cli.terminal.options import option
from tertia.cli.terminal.say import line, note, working
from tertia.tables._smooth_tracks import Smoothing, smoothing_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


EXAMPLES = (
    "tertia smooth-tracks plots.csv --sensors sensors.toml --every 1 --output reference.csv",
    "tertia smooth-tracks plots.csv --sensors sensors.toml --exclude north --output others.csv",
)
_FIGURE_SIZE = (11.0, 9.0)


def smooth_tracks(
    files: opt.PlotFiles = None,
    *,
    sensors: opt.SensorFile,
    flat: opt.Flat = False,
    column: opt.ColumnNames = None,
    motion: Annotated[Literal["imm", "cv"], option("Motion model of the targets.")] = "imm",
    every: Annotated[
        float | None, option("Interval of additional rows between plots, in seconds.")
    ] = None,
    exclude: Annotated[str | None, option("Name of a sensor whose plots are not used.")] = None,
    clock_period: opt.ClockPeriod = None,
    n_threads: opt.Threads = None,
    output: opt.Output = None,
    plot_file: opt.PlotFile = None,
) -> dict[str, Any]:
    """Estimate each track from all its plots, including later ones.

    One row per plot, as for tertia track. The output can be used as the truth in tertia evaluate.
    """
    write.check_suffixes(output, plot_file)
    recording = read.recording(files, sensors, opt.column_names(column), flat=flat)
    with working(f"Smoothing the tracks of {counted(len(recording.plots), 'plot')}"):
        found = smoothing_of(
            recording,
            motion=motion,
            every=every,
            exclude=exclude,
            clock_period=clock_period,
            n_threads=n_threads,
        )
    summary = found.summary()
    _say(found, summary)
    write.write(found.rows, output)
    write.save(plot_file, _FIGURE_SIZE, partial(_draw, found))
    return summary


def _say(found: Smoothing, summary: dict[str, Any]) -> None:
    line(found.recording.sensors.origin())
    typer.echo(
        f"{counted(summary['track_count'], 'track')}, {counted(summary['row_count'], 'row')}, "
        f"{summary['turn_share']:.1%} of them in a turn"
    )
    if summary["median_sigma_m"] is None:
        note("no track was confirmed")
        return
    typer.echo(f"  sigma of a position {summary['median_sigma_m']:.3g} m (median)")
    typer.echo(f"  {counted(summary['outlier_count'], 'plot')} left out as outliers")


def _draw(found: Smoothing, figure: "Figure") -> None:
    plot.tracks(
        found.table,
        found.recording.sensors.items,
        plots=found.recording.plots[found.tracks.track_of_plot >= 0],
        ax=figure.subplots(),
    )
