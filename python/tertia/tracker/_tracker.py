"""The tracker, scan by scan and for whole recordings."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from copy import copy, deepcopy
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np

from tertia import _core
from tertia._arrays import (
    FloatArray,
    IntArray,
    finite,
    flag,
    instance,
    integer,
    positive_number,
    real,
    sequence_of,
    threads,
)
from tertia._core import TrackColumns
from tertia.association import GUARD
from tertia.flightplan import FlightPlan
from tertia.sensors import Bias, PositionSensor, Radar
from tertia.sensors._sensors import own_biases
from tertia.tracker._azimuths import placed
from tertia.tracker._doubts import Doubts, clock_doubts, names_of
from tertia.tracker._models import Association, Motion, PlanModel, ProfileName
from tertia.tracker._plots import Plots, continuous
from tertia.tracker._registrar import Registrar, begun, chosen, is_default, scans
from tertia.tracker._sensors import Sensor, check_plots, core_sensors, sensors_of
from tertia.tracker._settings import core_settings, largest_speed
from tertia.tracker._table import TrackTable, numbered

_State: TypeAlias = tuple[
    tuple[Sensor, ...], list[FlightPlan | None], float | None, float, int | None, Any, Any, bytes
]


class Tracker:
    """A tracker for the plots of one or more sensors, scan by scan.

    It can be pickled and copied; the copy gives exactly the same results as the original.

    Parameters
    ----------
    sensors : sequence of Radar, PositionSensor or Station
        The sensors; plots refer to them by their index. A `Station` measures azimuths without
        ranges; such plots update confirmed tracks but do not start tracks. If radars have a
        `frame`, as set by `tertia.geo.SystemPlane.radar`, tracks are in that plane, and heights are
        above the ellipsoid. Either all radars have the same frame, or none has one.
    motion : {"imm", "cv", "singer", "window"} or ImmModel, CvModel, SingerModel, WindowModel
        How confirmed targets move. "imm" (default): interacting multiple models of straight flight,
        of turns, and of turns in the flight plan. "cv": straight flight. "singer": the acceleration
        decays exponentially. "window": least squares over a sliding window of plots, as in the
        source. A name stands for the model with its usual parameters. A `SingerModel` must have
        been made with `exact=True`; its `dt` is not used.
    plans : sequence of FlightPlan
        Flight plans; only the motions "imm" and "window" can use them. They are assigned to tracks
        by identity, or by position and time.
    plan_model : PlanModel, optional
        Parameters for the use of flight plans, and the velocity of the wind.
    association : {"gnn", "mht", "paper"} or Mht, PaperScore
        How plots are assigned to tracks. "gnn" (global nearest neighbour): the assignment with the
        largest likelihood relative to that of false plots is chosen in each scan and is final.
        "mht": uncertain plots lead to several hypotheses, which are kept until later plots decide
        between them; the best hypothesis is shown. Use it for targets that are close together.
        "paper": plots are assigned by the score of the source, for comparison.
    confirmation : (int, int) or float
        With a pair (M, N), a track is confirmed by M plots in N scans. If there is clutter, more
        plots are required, so that at most one false track is confirmed in a thousand scans. With a
        float p, a track of at least three plots is confirmed as soon as the probability that it
        follows a target (`existence_probability`) reaches p.
    coasting : int
        Number of successive scans without a plot after which a track ends.
    clutter_density : float, optional
        Number of false plots per square metre and scan; by default it is estimated from the plots.
    profile : {"aircraft", "vessel", "road", "drone"}
        Kind of targets; it determines the parameters of the motion "imm" and the largest speed.
    max_speed : float, optional
        Largest speed of a target in m/s; by default that of the profile, which is 350 for aircraft,
        30 for vessels, 70 for road users and 40 for drones.
    gate_probability : float
        Probability that the plot of a target is within its gate.
    guard_acceleration : float, optional
        Largest acceleration in m/s² that is considered possible for a target whose gate is empty.
        Default: 5; with the motion "window", from 12 (scans of 4 s or less) to 7 (10 s or more).
    identity_error_probability : float
        Probability that an `identity` is wrong. An `icao_address` is wrong with a probability of
        1e-9, a `callsign` of 1e-6, and a `mode_3a` of 1e-3.
    emergency_codes : sequence of int
        Codes of emergencies, of `mode_3a` or `identity`, besides 0o7500, 0o7600 and 0o7700 of
        `mode_3a`. After two of them in succession the plan of a track is suspended
        (`suspend_plan`). They are not identities.
    lag : float
        Time in seconds by which plots may be late. With a lag, rows that are older than the lag are
        final, and do not depend on the order in which the plots arrived. Rows that are not as old
        may still be replaced; see `TrackTable.latest`. With 0 (default), rows are final at once,
        and plots may be up to one scan late.
    clock_period : float, optional
        Period of the clock of the plots in seconds, for example 86400 for the time of day.
    registration : bool or tertia.registration.Registration, optional
        Whether to estimate the systematic errors of the radars while tracking, and to correct the
        plots, by targets that other radars or position sensors see as well. Default: if there are
        several sensors and one of them may have errors (its `bias` is not `Bias()`), or if the
        `bias` of a single sensor has sigmas. Positions of a `PositionSensor` are assumed to have
        no systematic error except a delay. `Tracker.bias` contains the current estimate; the
        covariances of the tracks include its uncertainty. Errors several times as large as their
        limits are found from the first three or seven scans; the tracks then start anew, with new
        numbers, and in the first three scans no rows are returned. If azimuth errors are found to
        change with the azimuth, `bias` has a `deviation`. If an earlier `Registration` is given,
        its noise is used, and the estimation continues from its last errors.
    n_threads : int, optional
        Number of threads for scans with over a thousand plots per thread; by default all cores.

    Raises
    ------
    ValueError
        If a number is outside its domain.
    TypeError
        If an argument has the wrong type.

    Notes
    -----
    Plots are assigned first to confirmed tracks and then to tentative tracks, in both cases by the
    assignment with the largest likelihood relative to that of false plots. Each remaining plot
    starts a tentative track. If the gate of a track is empty, a plot within its guard gate is used,
    which also allows for an acceleration since the last plot. The cost of a scan of P plots is
    O(P log P) if there are O(1) plots in a gate.

    Source: Glagovskiy, Lavina, Rudelson 2014, sections on gates and manoeuvres; Bar-Shalom, Li,
    Kirubarajan 2001, section 11.6.

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.tracker import Plots, Radar, Tracker
    >>> radar = Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0)
    >>> tracker = Tracker([radar])
    >>> for time in range(0, 40, 4):
    ...     found = tracker.update(Plots([time], [50e3 + 200 * time], [0.5]))
    >>> found
    TrackTable(1 tracks, 1 rows)
    >>> bool(190 < np.hypot(*found.velocity[0]) < 210)
    True
    """

    __slots__ = (
        "_core",
        "_doubted",
        "_plans",
        "_registrar",
        "clock_period",
        "lag",
        "n_threads",
        "sensors",
    )

    def __init__(
        self,
        sensors: Sequence[Sensor],
        *,
        motion: Motion = "imm",
        plans: Sequence[FlightPlan] = (),
        plan_model: PlanModel | None = None,
        association: Association = "gnn",
        confirmation: tuple[int, int] | float = (3, 4),
        coasting: int = 5,
        clutter_density: float | None = None,
        profile: ProfileName = "aircraft",
        max_speed: float | None = None,
        gate_probability: float = GUARD,
        guard_acceleration: float | None = None,
        identity_error_probability: float = 1e-3,
        emergency_codes: Sequence[int] = (),
        lag: float = 0.0,
        clock_period: float | None = None,
        registration: Any = None,
        n_threads: int | None = None,
    ) -> None:
        self.n_threads = threads(n_threads)
        self.lag = real(lag, "lag")
        self.sensors, known = begun(sensors_of(sensors), registration)
        self._plans: list[FlightPlan | None] = [*sequence_of(plans, FlightPlan, "plans")]
        self.clock_period = None
        if clock_period is not None:
            self.clock_period = positive_number(clock_period, "clock_period")
        settings = core_settings(
            motion=motion,
            plan_model=plan_model,
            association=association,
            confirmation=confirmation,
            coasting=coasting,
            clutter_density=clutter_density,
            profile=profile,
            max_speed=max_speed,
            gate_probability=gate_probability,
            guard_acceleration=guard_acceleration,
            identity_error_probability=identity_error_probability,
            emergency_codes=emergency_codes,
            with_plans=bool(self._plans),
        )
        self._doubted = Doubts(self.sensors, largest_speed(profile=profile, max_speed=max_speed))
        radars, geometry = core_sensors(self.sensors, motion)
        self._core = _core.PlotTracker(
            settings,
            radars,
            geometry,
            [plan._route for plan in plans],
            self.lag,
        )
        if registration is None:
            registration = not self.lag and is_default(self.sensors)
        if registration and lag:
            raise ValueError(
                "registration needs plots in time order, but lag allows late plots; give only one"
            )
        self._registrar = Registrar(self.sensors, profile, known) if registration else None

    @property
    def bias(self) -> Bias:
        """Systematic errors of the sensors as known at present, (K,)."""
        return own_biases(self.sensors) if self._registrar is None else self._registrar.bias

    @property
    def noise_factor(self) -> FloatArray:
        """Ratio of estimated to stated noise of each sensor, (K,); nan until it is known.

        If the ratio is significantly above 1, tracks are made with the estimated noise. For radars,
        range and azimuth have separate ratios. If errors are correlated from scan to scan, the
        estimate is larger than their standard deviation.
        """
        return self._core.noise_factor()

    def update(self, plots: Plots, *, time: float | None = None) -> TrackTable:
        """Process the plots of a scan, or of any other period.

        Parameters
        ----------
        plots : Plots
            Plots in any order. They may be older than the previous plots by at most `lag`, or by at
            most one scan if there is no lag.
        time : float, optional
            Time in seconds up to which all plots have arrived, except for plots that are late; by
            default the time of the last plot. If it is given, a scan without any plot counts as a
            scan in which all targets were missed.

        Returns
        -------
        TrackTable
            New rows of the confirmed tracks. With a lag, the table has the rows that became final,
            followed by those that are new or have changed.

        Raises
        ------
        ValueError
            If a plot belongs to a sensor that does not exist, or `time` is not finite.
        TypeError
            If an argument has the wrong type.

        Warns
        -----
        UserWarning
            If the plots of a sensor go on at other times than those of the others, if the tracker
            starts anew because all plots come from an earlier time, if a period, the unit or the
            scale of ranges, or `max_speed` is evidently wrong, if a radar has no beam that turns,
            if two tracks have the same address at the same time, if all radars have the same
            errors, as if the position of one of them were wrong, or if many targets give several
            plots in a scan although `target_extent` is 0.
        """
        table = self._track(plots, time, recording=False)
        for said in self._doubts(table, plots, names_of(self.sensors)):
            warnings.warn(said, UserWarning, stacklevel=2)
        return table

    def finish(self) -> TrackTable:
        """Make all rows final when no more plots will come.

        Returns
        -------
        TrackTable
            The rows that became final. Without a lag there are none, because rows are final at
            once.
        """
        return TrackTable._of(*self._core.finish(self.n_threads))

    def _track(self, plots: Plots, time: float | None, *, recording: bool) -> TrackTable:
        """Return the rows of confirmed tracks; for a recording also those before confirmation."""
        if not isinstance(plots, Plots):
            raise TypeError(f"plots is {plots!r}; it must be Plots")
        check_plots(plots, self.sensors)
        end = None if time is None else float(finite(real(time, "time"), "time"))
        if self.clock_period is not None:
            period, now = self.clock_period, self._core.time
            plots = replace(plots, time=continuous(plots.time, period, now))
            if end is not None:
                end = float(continuous(np.array([end]), period, now)[0])
        if self._registrar is not None:
            if recording:
                self._registrar.search_recording(plots, _alone)
            if not recording or self._core.plots:
                return self._registered(self._registrar, plots, end, recording)
            fresh, registrar = self._core.copy(), copy(self._registrar)
            tracks = self._registered(self._registrar, plots, end, recording)
            again = fresh.knowing(self._core)
            if registrar.expect(self._registrar) or again is not None:
                # the first plots were tracked before it was known how they are
                self._core, self._registrar = fresh if again is None else again, registrar
                tracks = self._registered(registrar, plots, end, recording)
            return tracks
        rows = "recording" if recording else "confirmed"
        if any(one.bias is not None for one in self.sensors):
            plots = self.bias.correct(plots)
        table = TrackColumns(len(plots))
        return TrackTable._of(table, self._scan(plots, end, rows, table))

    def _scan(self, plots: Plots, end: float | None, rows: str, table: TrackColumns) -> IntArray:
        """Add the rows of plots without systematic errors; return the tracks of the plots."""
        plots = placed(plots, self.sensors)
        return self._core.track((plots, plots), plots.time, end, rows, table, self.n_threads)

    def _registered(
        self, registrar: Registrar, plots: Plots, end: float | None, recording: bool
    ) -> TrackTable:
        """Return rows of tracks, while the errors of the sensors are estimated scan by scan."""
        rows, first = "all" if recording else "confirmed", self._core.plots
        table = TrackColumns(len(plots))
        where: dict[str, Any] = {"rows": rows, "table": table, "n_threads": self.n_threads}
        parts, found = scans(plots.time, registrar.period), []
        for n, index in enumerate(parts):
            part, begin = plots if len(parts) == 1 else chosen(plots, index), table.count
            until = end if n == len(parts) - 1 else None
            tracks = registrar.scan(self._core, part, until, **where)
            if not recording and registrar.search(part, self._core.time, _alone):
                self._core.restart(sum(map(len, registrar.kept)))
                for again in registrar.kept:
                    table.truncate(begin)
                    tracks = registrar.scan(self._core, again, None, **where)
            if registrar.is_first and not recording:
                table.truncate(begin)
            found.append(tracks)
        own = numbered(table, found, parts, first)
        own = table.keep_confirmed(own, self.n_threads) if recording else own
        return TrackTable._of(table, own)

    def _doubts(self, table: TrackTable, plots: Plots, names: Sequence[str]) -> list[str]:
        """Return what there is to say after these plots, which led to these rows."""
        first = self._core.plots - len(plots)
        said = self._doubted.after(table, plots, first, names)
        if self._registrar is not None:
            registrar, time = self._registrar, self._core.time
            said += self._doubted.of_places(self.sensors, lambda: registrar.bias, time)
        return clock_doubts(self._core, names) + said

    def extrapolate(self, seconds: float) -> tuple[IntArray, FloatArray]:
        """Predict where the confirmed tracks will be, without changing them.

        Parameters
        ----------
        seconds : float
            Time in seconds from the last update to the time of the prediction.

        Returns
        -------
        track : ndarray of int, shape (T,)
            Numbers of the tracks.
        position : ndarray of shape (T, 2)
            East and north in metres. The predicted path follows the plan if the track uses one, and
            is straight otherwise.

        Raises
        ------
        ValueError
            If `seconds` is not finite.
        TypeError
            If `seconds` is not a number.
        """
        return self._core.extrapolate(float(finite(real(seconds, "seconds"), "seconds")))

    @property
    def plans(self) -> tuple[FlightPlan | None, ...]:
        """The flight plans in the order of their numbers; None for a plan that was removed."""
        return tuple(self._plans)

    def add_plan(self, plan: FlightPlan) -> int:
        """Add a flight plan, which is used from the next plot on.

        Parameters
        ----------
        plan : FlightPlan
            The plan.

        Returns
        -------
        int
            Number of the plan, as in `TrackTable.plan`. Numbers are not reused.

        Raises
        ------
        ValueError
            If the motion model does not use plans.
        TypeError
            If an argument has the wrong type.

        Examples
        --------
        >>> from tertia.flightplan import FlightPlan
        >>> from tertia.tracker import Radar, Tracker
        >>> radar = Radar(range_sigma=50, azimuth_sigma=0.08, scan_period=4, degrees=True)
        >>> tracker = Tracker([radar])
        >>> tracker.add_plan(FlightPlan([[0, 0], [0, 50e3]], 220.0))
        0
        >>> tracker.remove_plan(0)
        >>> tracker.plans
        (None,)
        """
        instance(plan, "plan", FlightPlan)
        number = self._core.add_plan(plan._route)
        self._plans.append(plan)
        return number

    def replace_plan(self, number: int, plan: FlightPlan) -> None:
        """Replace a flight plan with another, for example after a clearance for a new route.

        A track that has the plan is assigned the new plan, beginning with its nearest leg, unless
        the identities of the plans differ. If the two plans differ only in their times, nothing
        else changes for the track.

        Parameters
        ----------
        number : int
            Number of the plan to be replaced.
        plan : FlightPlan
            The new plan.

        Raises
        ------
        ValueError
            If there is no plan of this number.
        TypeError
            If an argument has the wrong type.
        """
        instance(plan, "plan", FlightPlan)
        self._core.replace_plan(integer(number, "number", 0), plan._route)
        self._plans[number] = plan

    def remove_plan(self, number: int) -> None:
        """Remove a flight plan; a track that has it is assigned another plan if another plan fits.

        Parameters
        ----------
        number : int
            Number of the plan.

        Raises
        ------
        ValueError
            If there is no plan of this number.
        TypeError
            If the number is not an integer.
        """
        self._core.remove_plan(integer(number, "number", 0))
        self._plans[number] = None

    def correlate(self, track: int, plan: int, *, take: bool = False) -> None:
        """Assign a flight plan to a track by hand, until the track ends or the plan is removed.

        The track keeps the plan whatever its identity and its path are, also if it is resumed after
        its end. Like any other plan, the plan is blocked while the track does not follow it.

        Parameters
        ----------
        track : int
            Number of a confirmed track.
        plan : int
            Number of the plan.
        take : bool
            Whether to take the plan from the track that has it; that track may then be assigned
            another plan.

        Raises
        ------
        ValueError
            If there is no such track or plan, or if the plan belongs to another track and `take` is
            False.
        TypeError
            If an argument has the wrong type.
        """
        number = integer(track, "track", 1)
        self._core.correlate(number, integer(plan, "plan", 0), flag(take, "take"))

    def decorrelate(self, track: int) -> None:
        """Remove the flight plan from a track; it is not assigned to the track again automatically.

        Parameters
        ----------
        track : int
            Number of a confirmed track.

        Raises
        ------
        ValueError
            If there is no such track, or it has no plan.
        TypeError
            If the number is not an integer.
        """
        self._core.decorrelate(integer(track, "track", 1))

    def suspend_plan(self, track: int) -> None:
        """Ignore the flight plan of a track until `resume_plan` is called.

        This is for plans that are wrong, and for emergencies. If the track is assigned another
        plan, that plan is suspended, too. Suspensions are part of the pickled state of the tracker.

        Parameters
        ----------
        track : int
            Number of a confirmed track.

        Raises
        ------
        ValueError
            If there is no such track.
        TypeError
            If the number is not an integer.
        """
        self._core.suspend_plan(integer(track, "track", 1), suspended=True)

    def resume_plan(self, track: int) -> None:
        """Use the suspended flight plan of a track again, as soon as the track is back on it.

        The track is back on its plan after it has been on one leg of the plan for five successive
        scans.

        Parameters
        ----------
        track : int
            Number of a confirmed track.

        Raises
        ------
        ValueError
            If there is no such track.
        TypeError
            If the number is not an integer.
        """
        self._core.suspend_plan(integer(track, "track", 1), suspended=False)

    @property
    def suspended_plans(self) -> IntArray:
        """Numbers of the confirmed tracks whose plans are suspended, by hand or by emergency."""
        return self._core.suspended_plans()

    def __getstate__(self) -> _State:
        """Return the complete state of the tracker, which does not change with it."""
        saved = self._core.__getstate__()
        own = self.sensors, [*self._plans], self.clock_period, self.lag, self.n_threads
        return *own, copy(self._registrar), deepcopy(self._doubted), saved

    def __setstate__(self, state: _State) -> None:
        """Restore the state of the tracker."""
        self.sensors, self._plans, self.clock_period, self.lag, *rest = state
        self.n_threads, self._registrar, self._doubted, saved = rest
        self._core = _core.PlotTracker.from_state(saved)

    def __repr__(self) -> str:
        """Return a text that states the number of sensors and the time."""
        return f"Tracker({len(self.sensors)} sensors, time {self._core.time:.6g} s)"


def _alone(
    plots: Plots, sensor: Radar | PositionSensor, count: int, profile: ProfileName
) -> TrackTable:
    """Return the tracks from the plots of one sensor that have at least `count` plots."""
    own, few = replace(plots, sensor=np.zeros(len(plots), np.int64)), (count, count + 1)
    tracker = Tracker([sensor], motion="cv", confirmation=few, profile=profile, registration=False)
    return tracker._track(own, None, recording=True)
