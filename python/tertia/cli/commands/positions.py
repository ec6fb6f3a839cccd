"""The common output of `tertia locate` and `tertia reconstruct`."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import typer

from tertia.cli.files import maps, write
from tertia.cli.terminal.say import counted, note, print_table
from tertia.tables._positions import Located, Positions, reason

if TYPE_CHECKING:
    from matplotlib.figure import FigureBase

_MAX_GROUPS_DRAWN = 4
_HEIGHT = 8.0
# p-value below which measurements contradict each other
_DOUBTFUL = 1e-3
# share of the instants from which on this is said: ten times what chance makes
_MANY = 0.01


def print_all(found: Positions[Any], by: Sequence[str]) -> None:
    """Print the results of each sensor, and the origin."""
    print_table(found.sensors, text=[*by, "sensor", "kind"])
    origin = found.stations.origin()
    if origin is not None:
        typer.echo(origin)


def say_located(one: Located[Any]) -> None:
    """Print how many instants of a target were located, how well, and why others were not."""
    fixes, sigma = one.fixes, one.result.sigma
    located = np.asarray(fixes.success)
    total = np.sqrt(np.sum(sigma[np.isfinite(sigma).all(axis=1)] ** 2, axis=1))
    error = f", median sigma {np.median(total):.3g} m" if total.size else ""
    known = np.count_nonzero(np.isfinite(one.result.position).all(axis=1))
    said = f"{np.count_nonzero(located)} of {counted(located.size, 'instant')} located"
    if known > np.count_nonzero(located):
        said += f", {known} with a position"
    typer.echo(": ".join(filter(None, [one.target.name, said + error])))
    numbers, counts = np.unique(np.asarray(fixes.status)[~located], return_counts=True)
    for number, count in zip(numbers, counts, strict=True):
        typer.echo(f"  {counted(int(count), 'instant')} not located: {reason(int(number))}")
    doubtful = (np.asarray(fixes.pvalue) < _DOUBTFUL) & (np.asarray(fixes.outlier.count) == 0)
    if np.sum(doubtful) > _MANY * np.sum(located):
        typer.echo(
            f"  {counted(int(np.sum(doubtful)), 'instant')} with a p-value below {_DOUBTFUL:g} and "
            "no outlier found: a measurement or a sigma is wrong"
        )


def write_all(
    found: Positions[Any],
    output: Path | None,
    measurements: Path | None,
    features: Callable[[], Sequence[maps.Feature | None]],
    noun: str,
) -> None:
    """Write positions, as a table or for a map, and the measurements."""
    if output is not None and maps.is_map(output):
        maps.write(features(), output, noun)
    elif output is not None:
        write.write(found.rows, output)
    if measurements is not None:
        write.write(found.measurements, measurements)


def draw(
    found: Positions[Any], path: Path, one: Callable[[Located[Any], "FigureBase"], None]
) -> None:
    """Draw targets below each other; `one` draws a target."""
    from matplotlib.figure import Figure  # noqa: PLC0415  # slow to import

    drawn = found.targets[:_MAX_GROUPS_DRAWN]
    count = len(drawn)
    if len(found.targets) > count:
        note(f"only the first {count} of {len(found.targets)} groups are drawn")
    figure = Figure(figsize=(11.0, _HEIGHT * count), layout="constrained")
    parts = [figure] if count == 1 else figure.subfigures(count, 1, squeeze=False)[:, 0].tolist()
    for target, part in zip(drawn, parts, strict=True):
        one(target, part)
    write.save(figure, path)


def name_panels(panels: dict[str, Any], one: Located[Any]) -> None:
    """Name the target and the times of a picture."""
    plan, *others = panels.values()
    plan.set_title(": ".join(filter(None, [one.target.name, plan.get_title()])))
    others[-1].set_xlabel("time_s")
