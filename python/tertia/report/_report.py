"""From a recording to its page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from tertia import tracker
from tertia._arrays import positive, real
from tertia.flightplan import FlightPlan
from tertia.metrics import Truth
from tertia.report._analysis import analyse
from tertia.report._bearings import Emitter
from tertia.report._tables import summary
from tertia.sensors import Radar, Station
from tertia.tracker import Motion, Plots, TrackTable

__all__ = ["Report", "make"]


@dataclass(frozen=True, slots=True, eq=False)
class Report:
    """A page, and what it tells in numbers.

    Attributes
    ----------
    html : str
        The page: one file, without network.
    summary : dict
        The tables of the page and what stands out (`findings`): texts, numbers, lists and
        dictionaries that JSON can hold, None where something is not known. Names end in units.
    """

    html: str
    summary: dict[str, Any]

    def __repr__(self) -> str:
        """Tell the size of the page, not the page."""
        radars, tracks = len(self.summary["radars"]), self.summary["tracks"]
        return f"Report({tracks} tracks, {radars} radars, {len(self.html) / 1e6:.1f} MB)"

    def save(self, path: str | Path) -> None:
        """Write the page to a file.

        Parameters
        ----------
        path : str or Path
            Where; a file that is there is replaced.

        Raises
        ------
        OSError
            The file cannot be written.
        """
        Path(path).write_text(self.html, encoding="utf-8")


def make(
    plots: Plots,
    radars: Sequence[Radar],
    *,
    motion: Motion = "imm",
    plans: Sequence[FlightPlan] = (),
    truth: Truth | None = None,
    stations: Sequence[Station] = (),
    emitters: Sequence[Emitter] = (),
    distance: float = 1000.0,
    period: float | None = None,
    title: str = "Tracks",
    since: str | None = None,
    progress: Callable[[str, float], None] | None = None,
    **options: Any,
) -> Report:
    """Make a page of a recording.

    Tracks of all radars together and of each alone; the latter fused at common instants; the noise
    and biases that the plots show beside what radars state; updates and faults along time; how
    tracks follow flight plans; all of it beside the truth, if that is known; and positions of
    emitters that direction finders hear.

    Parameters
    ----------
    plots : Plots
        The plots, in any order.
    radars : sequence of K Radar
        The radars.
    motion : {"imm", "cv", "singer", "window"} or a model
        How targets move; see `tertia.tracker.Tracker`.
    plans : sequence of FlightPlan
        Flight plans, for the motions "imm" and "window".
    truth : tertia.metrics.Truth, optional
        Where targets were.
    stations : sequence of Station
        Direction finders, in the plane.
    emitters : sequence of Emitter
        What they heard.
    distance : float
        A track farther from a target does not show it, in metres; the cutoff of GOSPA.
    period : float, optional
        Seconds between updates that are required; by default those of the fastest radar.
    title : str
        The title of the page.
    since : str, optional
        Of when times are the seconds, in words.
    progress : callable, optional
        Called with what is done next and the share that is done, 0 to 1.
    **options
        As of `tertia.tracker.Tracker`.

    Returns
    -------
    Report
        The page and its numbers.

    Raises
    ------
    ImportError
        The extra `report` is not installed.
    ValueError
        Stations in space, bearings that do not fit them, a parameter outside its domain, and what
        the tracker refuses.
    TypeError
        An argument of the wrong type.

    Notes
    -----
    Noise is the scatter of six successive plots of a track about a straight line, in the tracks of
    the radar alone, made again with the noise that was found. Biases are found by weighted least
    squares from the differences of tracks of different radars. Fusion is `tertia.fusion.fuse` of
    positions and velocities; a track of a radar belongs to the joint one with most of its plots.

    Long recordings are thinned in the page, never in what is computed: at most 30,000 rows of
    tracks, 10,000 plots and 15,000 positions of the truth, every n-th in order of time, and the
    first 500 rows of a table. The player interpolates between the rows that are left.

    Examples
    --------
    >>> from tertia import report, simulate
    >>> scene = simulate.set_up("tma")
    >>> plans = simulate.routes("tma", 3, rng=1)
    >>> traffic = simulate.flights(plans, wind=scene.wind, rng=2)
    >>> record = simulate.radar_plots(traffic, [scene.radar], clutter=1, rng=3)
    >>> page = report.make(record.plots, [scene.radar], plans=plans)  # doctest: +SKIP
    >>> page.save("report.html")  # doctest: +SKIP
    """
    missing = [name for name in ("jinja2", "plotly") if find_spec(name) is None]
    if missing:
        raise ImportError(
            f"{' and '.join(missing)}: a page needs the extra report: pip install 'tertia[report]'"
        )
    from tertia.report._page import page  # noqa: PLC0415  # only here is Jinja needed

    for station in stations:
        if len(station.position) != 2:
            raise ValueError("stations must be in the plane: positions of east and north alone")
    if len(emitters) and not len(stations):
        raise ValueError("emitters need stations")

    def run(own: Plots, sites: Sequence[Radar]) -> TrackTable:
        return tracker.track(own, sites, motion=motion, plans=plans, **options)

    def quiet(what: str, share: float) -> None:
        pass

    told = analyse(
        plots,
        radars,
        run,
        plans=plans,
        truth=truth,
        stations=stations,
        emitters=emitters,
        distance=float(positive(real(distance, "distance"), "distance")),
        period=None if period is None else float(positive(real(period, "period"), "period")),
        progress=progress or quiet,
    )
    numbers = summary(told)
    return Report(page(told, numbers, title, since), numbers)
