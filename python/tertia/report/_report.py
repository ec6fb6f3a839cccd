"""The report on a recording."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from tertia._arrays import positive_number
from tertia.flightplan import FlightPlan
from tertia.metrics import Truth
from tertia.report._analysis import Analysis, analyse
from tertia.report._bearings import Emitter, Finders, hear
from tertia.report._summary import summary
from tertia.report._times import Times
from tertia.sensors import Radar, Station
from tertia.tracker import Motion, Plots, TrackTable
from tertia.tracker._doubts import Shared
from tertia.tracker._models import with_heights
from tertia.tracker._recording import tracked


@dataclass(frozen=True, slots=True, eq=False)
class Report:
    """A page and its summary.

    Attributes
    ----------
    html : str
        The page: one file that does not need a network.
    summary : dict
        The tables of the page and its `findings`, as values for JSON; unknown values are None. The
        names of quantities end in their units.
    """

    html: str
    summary: dict[str, Any]

    def __repr__(self) -> str:
        """Return a text that states the size of the page instead of its contents."""
        counts = (
            (self.summary["tracks"], "tracks"),
            (len(self.summary["radars"]), "radars"),
            (len(self.summary["emitters"]), "emitters"),
        )
        what = ", ".join(f"{count} {name}" for count, name in counts if count)
        return f"Report({what}, {len(self.html) / 1e6:.1f} MB)"

    def save(self, path: str | Path) -> None:
        """Write the page to a file.

        Parameters
        ----------
        path : str or Path
            The file, which is replaced if it exists.

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        Path(path).write_text(self.html, encoding="utf-8")


def make(
    plots: Plots | None = None,
    sensors: Sequence[Radar] = (),
    *,
    motion: Motion = "imm",
    plans: Sequence[FlightPlan] = (),
    truth: Truth | None = None,
    stations: Sequence[Station] = (),
    bearings: Sequence[Emitter] = (),
    max_distance: float = 1000.0,
    update_interval: float | None = None,
    limits: Mapping[str, float] | None = None,
    title: str = "Tracks",
    since: datetime | None = None,
    progress: Callable[[str, float], None] | None = None,
    registration: bool | None = None,
    **options: Any,
) -> Report:
    """Make a page about a recording.

    The page shows the tracks that `tertia.tracker` makes from the plots of all radars together;
    with two radars or more, their systematic errors are estimated and subtracted. It also shows the
    tracks of each radar alone, fused at common instants. The page shows the noise and the biases of
    the radars as estimated by `tertia.registration`, updates and outliers over time, and the
    conformance of tracks to flight plans. All tracks are compared with the truth if it is given;
    otherwise the tracks of each radar are compared with smoothed tracks from the plots of all other
    radars (`tracker.smooth_tracks`). Finally, the page shows the positions of emitters as estimated
    from bearings, or their paths if they move.

    Parameters
    ----------
    plots : Plots, optional
        The plots, in any order. Without plots, the page shows only the results from bearings.
    sensors : sequence of K Radar
        The radars.
    motion : {"imm", "cv", "singer", "window"} or a model
        Motion model of the targets, as for `tertia.tracker.Tracker`.
    plans : sequence of FlightPlan
        Flight plans; only the motions "imm" and "window" can use them.
    truth : tertia.metrics.Truth, optional
        True positions of the targets.
    stations : sequence of Station
        Direction finders, with positions in the plane.
    bearings : sequence of Emitter
        Bearings of each emitter from all stations.
    max_distance : float
        Largest distance in metres from a track to its target; also the cutoff of GOSPA.
    update_interval : float, optional
        Required time between updates in seconds; by default the shortest update interval of the
        radars.
    limits : mapping of str to float, optional
        Limits of indicators, as for `tertia.metrics.indicators`; the page then states whether they
        are met.
    title : str
        Title of the page.
    since : datetime.datetime, optional
        Date and time that correspond to the time 0. Axes then show times of day, in UTC if `since`
        has a time zone.
    progress : callable, optional
        Function that is called before each step with its name and the completed fraction, 0 to 1.
    registration : bool, optional
        Whether systematic errors of the radars are estimated and subtracted in the tracks from the
        plots of all radars, as for `tertia.tracker.Tracker`; by default if there are two radars or
        more. The tracks of single radars are never corrected.
    **options
        Options of the tracker, as for `tertia.tracker.Tracker`.

    Returns
    -------
    Report
        The page and its summary.

    Raises
    ------
    ImportError
        If the extra `report` is not installed.
    ValueError, TypeError
        If there are neither plots nor bearings, stations are in space, bearings do not match the
        stations, a parameter is outside its domain or has the wrong type, or the tracker raises an
        error.

    Notes
    -----
    Noise and biases are estimated by `tertia.registration.register`. Positions and velocities are
    fused by `tertia.fusion.fuse`; a track of a single radar is assigned to the joint track that
    contains most of its plots.

    Long recordings are thinned for display on the page, but all computations use all rows. Every
    n-th row is kept, so that the page contains at most 30,000 rows of tracks, 10,000 plots and
    15,000 positions of the truth. The page contains the first 500 rows of each table. The player
    interpolates between the rows that are kept.

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
            raise ValueError("stations must have two coordinates, east and north")
    if len(bearings) and not len(stations):
        raise ValueError("bearings need stations")

    if plots is None and not len(bearings):
        raise ValueError("plots or bearings must be given")
    if plots is None and (len(sensors) or len(plans) or truth is not None):
        raise ValueError(
            "sensors, plans and truth can be used only with plots, and there are no plots"
        )

    def run(own: Plots, sites: Sequence[Radar], *, registration: bool | None = False) -> TrackTable:
        chosen = {"motion": motion, "plans": plans, "registration": registration}
        return tracked(own, sites, **chosen, **options)[0]

    def corrected(own: Plots, sites: Sequence[Radar]) -> TrackTable:
        table = run(own, sites, registration=True)
        for said in Shared(sites).doubts(table, last=True):
            warnings.warn(said, UserWarning, stacklevel=2)
        return table

    corrects = len(sensors) > 1 if registration is None else registration
    together = corrected if corrects else run

    def quiet(what: str, share: float) -> None:
        pass

    tell = progress or quiet
    analysis: Analysis | None = None
    if plots is not None:
        plots = with_heights(plots, sensors, options.get("profile", "aircraft"))
        analysis = analyse(
            plots,
            sensors,
            run,
            together,
            motion=motion,
            plans=plans,
            truth=truth,
            max_distance=positive_number(max_distance, "max_distance"),
            update_interval=None
            if update_interval is None
            else positive_number(update_interval, "update_interval"),
            limits={} if limits is None else limits,
            progress=tell,
        )
    heard = []
    for number, emitter in enumerate(bearings):
        tell("direction finders", number / len(bearings))
        heard.append(hear(emitter, stations))
    finders = Finders(stations, heard)
    times = Times(since)
    numbers = summary(analysis, finders, times)
    return Report(page(analysis, finders, numbers, title, times), numbers)
