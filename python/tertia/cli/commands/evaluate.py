"""`tertia evaluate`: comparison of tracks with the truth."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from tertia.cli.files import read, write
from tertia.cli.files.limits import read_limits
from tertia.cli.terminal import options as opt
from tertia.cli.terminal.options import input_file, input_files, output_file
from tertia.cli.terminal.say import note, print_table, working
from tertia.metrics._evaluation import PARTS, Judged
from tertia.tables._evaluate import evaluation_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

EXAMPLES = (
    "tertia evaluate tracks.csv --truth truth.csv",
    "tertia evaluate tracks.parquet --truth truth.csv --update-interval 4 --output figures.json",
    "tertia evaluate tracks.csv --truth truth.csv --limits limits.toml",
    "tertia evaluate tracks.csv --truth truth.csv --targets targets.csv --plot errors.png",
)
# if a smaller share of the updates is near targets, a note is printed
_FEW = 0.1
_KEPT, _WRONG, _TRUE = "#0072B2", "#D55E00", "0.6"


def evaluate(
    tracks: Annotated[Path, input_files("TRACKS", "Tracks, as written by tertia track.")],
    *,
    truth: Annotated[Path, input_file(opt.TRUTH)],
    column: opt.ColumnNames = None,
    origin: opt.Origin = None,
    update_interval: opt.UpdateInterval = None,
    max_distance: opt.MaxDistance = 1000.0,
    limits: opt.LimitFile = None,
    output: opt.Output = None,
    targets: Annotated[Path | None, output_file("Write one row per target to this file.")] = None,
    plot_file: opt.PlotFile = None,
) -> dict[str, Any]:
    """Compare tracks with the truth: update rate, accuracy, and false tracks.

    Only confirmed tracks are compared, and only their rows with a plot. The truth is interpolated
    linearly between its times; a target is absent before its first and after its last time.
    """
    write.check_suffixes(output, plot_file, targets)
    with working("Comparing the tracks"):
        found = evaluation_of(
            read.tables(tracks),
            read.truth(truth),
            columns=opt.column_names(column),
            origin=opt.pair(origin, "--origin", float),
            max_distance=max_distance,
            update_interval=update_interval,
            limits=read_limits(limits),
        )
    print_table(found.rows, text=["figure", "unit", "verdict"], limited="figures are shown")
    share = np.mean(found.judged.indicators.matching.matched)
    if share < _FEW:
        few = f"{share:.0%} of the updates are" if share else "no track is"
        note(
            f"{few} within {max_distance:g} m of a target: do tracks and truth have the same "
            "origin?"
        )
    write.write(found.rows, output)
    write.write(found.targets, targets)
    write.save(plot_file, (13.0, 7.0), partial(_draw, found.judged))
    return {"figures": found.rows.to_dicts()}


def _draw(judged: Judged, figure: "Figure") -> None:
    panels = figure.subplot_mosaic([["plan", "gospa"], ["plan", "errors"]])
    _draw_plan(panels["plan"], judged)
    for name, values, line in zip(PARTS, judged.gospa.T, ("-", ":", "--", "-."), strict=True):
        panels["gospa"].plot(judged.instants, values, line, linewidth=1, label=name)
    panels["gospa"].set(ylabel="GOSPA and square roots of its parts (m)", ylim=(0.0, None))
    for label, values, mark in (
        ("along track", judged.along, "."),
        ("cross track", judged.across, "x"),
    ):
        panels["errors"].plot(judged.time, values, mark, markersize=3, label=label)
    panels["errors"].set(xlabel="time (s)", ylabel="error (m)")
    panels["errors"].sharex(panels["gospa"])
    for ax in panels.values():
        ax.legend(fontsize="small")


def _draw_plan(ax: "Axes", judged: Judged) -> None:
    rows, matched = judged.rows, judged.indicators.matching.matched
    for k, (_, _, position) in enumerate(judged.truth):
        ax.plot(*position.T / 1e3, color=_TRUE, linewidth=3, label="_truth" if k else "truth")
    places = rows.position[rows.updated] / 1e3
    for chosen, colour, mark, label in (
        (matched, _KEPT, ".", "update"),
        (~matched, _WRONG, "x", "false update"),
    ):
        if np.any(chosen):
            ax.plot(*places[chosen].T, mark, color=colour, markersize=3, label=label)
    ax.set(
        title=f"probability of update {judged.indicators.probability_of_update.value:.3f}, "
        f"RMSE {judged.indicators.rmse.value:.3g} m",
        xlabel="east (km)",
        ylabel="north (km)",
    )
    ax.set_aspect("equal", adjustable="datalim")
