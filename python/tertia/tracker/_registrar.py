"""Estimation of the systematic errors of radars during tracking."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from tertia import _core
from tertia._arrays import BoolArray, FloatArray, IntArray
from tertia.sensors import Bias, PositionSensor, Radar, Station
from tertia.sensors._identities import NO_CALLSIGN, NO_IDENTITY, NUMBERS, leading
from tertia.sensors._sensors import drift_rates, own_biases
from tertia.tracker._azimuths import azimuth_sigmas, placed
from tertia.tracker._biases import (
    are_placed,
    bias_of,
    bias_with_deviation,
    columns_of,
    values_of,
    whole_covariance,
)
from tertia.tracker._earth import in_plane
from tertia.tracker._models import ProfileName, with_heights
from tertia.tracker._plots import Plots
from tertia.tracker._sensors import Sensor, core_sensors, interval, slant, velocities_of
from tertia.tracker._start import start
from tertia.tracker._table import TrackTable

# scans of the slowest radar after which errors far larger than expected are sought at first, with
# tracks of two plots, if radars have so many targets in common; standard deviations of the prior
# beyond which they are taken out then; scans after which they are sought with tracks of three plots
_FIRST_SCANS = 3.0
_FIRST_PAIRS = 6
_FAR = 2.5
_SCANS = 7.0
# targets of a radar that are enough for this, and a number that mixes their identities
_AMPLE, _MIXING = 100, np.uint64(0x9E3779B97F4A7C15)

# what columns have that some of the plots do not have
_MISSING = {
    "position": np.nan,
    "covariance": np.nan,
    "velocity": np.nan,
    "velocity_covariance": np.nan,
    "sensor_position": np.nan,
    "sensor_heading": np.nan,
    "icao_address": NO_IDENTITY,
    "mode_3a": NO_IDENTITY,
    "callsign": NO_CALLSIGN,
}

# tracks of the plots of one sensor that have so many
Alone = Callable[[Plots, Radar | PositionSensor, int, ProfileName], TrackTable]


def target_plots(plots: Plots, tracks: TrackTable, rows: IntArray) -> dict[str, Any]:
    """Return the columns, for the core, of the plots of these rows, with their targets."""
    return {
        "sensor": plots.sensor,
        "target": np.ascontiguousarray(tracks.track[rows]),
        "time": plots.time,
        "range": plots.range,
        "azimuth": plots.azimuth,
        "height": plots.height,
        "turn_probability": np.ascontiguousarray(tracks.turn_probability[rows]),
        "position": plots.position,
        "covariance": plots.covariance,
    }


def is_registrable(sensors: Sequence[Sensor]) -> bool:
    """Return whether a sensor may have systematic errors that another sensor can reveal."""
    if sum(not isinstance(one, Station) for one in sensors) < 2:
        return False
    return bool(columns_of(own_biases(sensors), "_sigma").any())


def is_default(sensors: Sequence[Sensor]) -> bool:
    """Return whether sensors are registered by default.

    They are also if errors have stated sigmas: these belong to the covariances of tracks.
    """
    stated = [one for one in sensors if not isinstance(one, Station) and one.bias is not None]
    are_stated = bool(stated) and bool(columns_of(own_biases(stated), "_sigma").any())
    return is_registrable(sensors) or are_stated


def error_sigmas(sensors: Sequence[Sensor]) -> FloatArray:
    """Return the standard deviations of the systematic errors of sensors, (K, 4), if finite."""
    sigmas = columns_of(own_biases(sensors), "_sigma")
    for k in np.flatnonzero(~np.isfinite(sigmas).all(axis=1)):
        raise ValueError(
            f"sensors[{k}].bias has a sigma of inf; for tracks it must be finite, or None for the "
            "usual limits"
        )
    return sigmas


def begun(
    sensors: tuple[Sensor, ...], registration: Any
) -> tuple[tuple[Sensor, ...], tuple[FloatArray, FloatArray] | None]:
    """Return sensors with the noise of a registration, if one is given, and its errors."""
    if registration is None or isinstance(registration, bool):
        return sensors, None
    found = getattr(registration, "sensors", None)
    if found is None:
        raise TypeError(f"registration is {registration!r}; it must be a bool or a Registration")
    if len(found) != len(sensors):
        raise ValueError(
            f"registration has {len(found)} sensors; it must have {len(sensors)}, as sensors"
        )
    # the prior of the errors is that of the sensors
    pairs = zip(found, sensors, strict=True)
    placed = tuple(replace(own, bias=one.bias) for own, one in pairs)
    return placed, (values_of(registration.bias), whole_covariance(registration))


class Registrar:
    """Systematic errors of radars as known after each scan.

    Reported positions are assumed to have noise, possibly a delay and, if their sensor says so,
    errors of east and north. Stations, which measure azimuths without ranges, are not used.

    Attributes
    ----------
    sensors : tuple of Radar, PositionSensor or Station
        The sensors.
    profile : str
        Kind of targets, for the tracks of single sensors.
    kept : list of Plots
        Plots of the last scans; they are kept as long as the search for large errors goes on.
    """

    def __init__(
        self,
        sensors: Sequence[Sensor],
        profile: ProfileName,
        known: tuple[FloatArray, FloatArray] | None = None,
    ) -> None:
        if not is_default(sensors) and not any(isinstance(one, Radar) for one in sensors):
            raise ValueError(
                "registration needs a Radar, a second sensor or stated errors; sensors has none"
            )
        error_sigmas(sensors)
        self.sensors, self.profile = tuple(sensors), profile
        self.kept: list[Plots] = []
        self._begin, self._due = np.nan, np.inf
        # a station has no tracks of its own
        self._paired: BoolArray = np.array([isinstance(one, Station) for one in sensors])
        self._compared = False
        self._radars = [isinstance(one, Radar) for one in sensors]
        prior = own_biases(sensors)
        # reports may be late by other times for other targets
        self._late = are_placed(sensors) & (np.asarray(prior.time_sigma, dtype=np.float64) > 0.0)
        self._start_from(prior)
        if known is not None:
            self._core.know(*known)
            # nothing is far from what is known
            self._paired[:] = True

    def expect(self, later: Registrar) -> bool:
        """Begin with deviations of azimuths that a later registrar has found, if there are any."""
        return self._core.expect(later._core)

    @property
    def period(self) -> float:
        """Scan period of the slowest sensor in seconds."""
        return max(map(interval, self.sensors))

    @property
    def bias(self) -> Bias:
        """Systematic errors of each radar with their standard deviations, (K,)."""
        value, sigma, _ = self._core.known()
        return bias_with_deviation(value, sigma, are_placed(self.sensors))

    def correct(self, plots: Plots) -> Plots:
        """Return plots with the systematic errors of their sensors removed."""
        (time, distance, azimuth), position = self._core.correct(plots)
        if position is None:
            return plots._replaced(time=time, range=distance, azimuth=azimuth)
        return plots._replaced(time=time, range=distance, azimuth=azimuth, position=position)

    @property
    def noise(self) -> FloatArray:
        """Standard deviations of range and azimuth for tracking, (K, 2)."""
        return self._core.known()[2]

    @property
    def held(self) -> list[bool]:
        """Whether the plots of each sensor are at present not allowed to confirm tracks."""
        held = self._core.held()
        # where plots of all sensors are far from their tracks, targets manoeuvre
        return [False] * len(held) if all(held) else held

    def prepare(self, core: _core.PlotTracker) -> None:
        """Give a tracker the noise of the sensors, and which plots may not confirm tracks."""
        core.set_noise(self.noise)
        core.hold(self.held)
        core.set_delays(np.where(self._late, self._core.clocks(), np.nan))

    def scan(
        self,
        core: _core.PlotTracker,
        plots: Plots,
        end: float | None,
        *,
        rows: str,
        table: _core.TrackColumns,
        n_threads: int | None,
    ) -> IntArray:
        """Track a scan of plots, and learn from it; return the tracks of the plots.

        The uncertainty of the errors is in the covariances of the rows.
        """
        first, begin = core.plots, table.count
        self.prepare(core)
        own = placed(self.correct(plots), self.sensors)
        tracks = core.track((own, plots), own.time, end, rows, table, n_threads)
        self.weigh_delays(core, recording=rows == "all")
        noise, time, alive, added = core.noise(), core.time, core.numbers(), (table, begin)
        core.shift(*self.learn(plots, first, tracks, added, noise, time=time, alive=alive))
        return tracks

    def weigh_delays(self, core: _core.PlotTracker, *, recording: bool) -> None:
        """Estimate by how much delays of targets differ, once the radars have been compared."""
        if recording or not self.is_first:
            core.weigh_delays(self._core.unsure(self._radars))
        self._core.set_delays(core.delay_sigmas())

    @property
    def changes(self) -> list[tuple[float, int]]:
        """Times at which errors changed suddenly, and the sensors whose errors changed."""
        return self._core.changes()

    def learn(
        self,
        plots: Plots,
        first: int,
        tracks: IntArray,
        rows: tuple[_core.TrackColumns, int],
        noise: FloatArray,
        *,
        time: float,
        alive: IntArray,
    ) -> tuple[IntArray, FloatArray, FloatArray]:
        """Update the errors from plots and their tracks; `first` numbers the first plot.

        `rows` are a table and the index of the first row that the plots have added to it, `noise`,
        (K, 2, 2), is the noise with which the rows were made and the noise that was found, and
        `alive` are the numbers of all tracks, in order. The uncertainty of the errors is added to
        the covariances of the rows, and the rows are moved by the change of the errors. Returns
        tracks, and by how much they move at which times.
        """
        if not np.isfinite(plots.height).all():
            # at the height of their track
            table, begin = rows
            plots = plots._replaced(height=table.heights(plots.height, first, begin))
            plots = with_heights(plots, self.sensors, self.profile)
        if plots.velocity is not None:
            plots = plots._replaced(velocity_covariance=velocities_of(plots, self.sensors)[1])
        flat = placed(in_plane(plots, self.sensors), self.sensors)
        sigmas = azimuth_sigmas(self.sensors)
        return self._core.learn(flat, first, rows, tracks, noise, sigmas, time, alive)

    @property
    def _first(self) -> float:
        """Return the seconds after which the sensors are compared for the first time."""
        radars = [one for one in self.sensors if isinstance(one, Radar)] or self.sensors
        return _FIRST_SCANS * max(map(interval, radars))

    @property
    def is_first(self) -> bool:
        """Whether the radars have not been compared yet, so that two tracks may be one aircraft."""
        return not (self._paired.all() or self._due > self._begin + self._first)

    def search(self, plots: Plots, time: float, alone: Alone) -> bool:
        """Search for large errors in the first scans; return whether tracks are to start anew.

        If they are, they start from the plots in `kept`. The errors are estimated from tracks of
        single radars. The search is repeated later if radars do not have targets in common yet, or
        if the first few scans showed no large errors. In a later search, tracks start anew only if
        the first scans did not allow all radars to be compared.
        """
        if self._paired.all():
            return False
        known = plots.time[np.isfinite(plots.time)]
        if np.isnan(self._begin) and len(known):
            self._begin = float(np.min(known))
            self._due = self._begin + self._first
        self.kept = [one for one in self.kept if _newest(one) > time - _SCANS * self.period]
        if len(known):
            self.kept.append(plots)
        if time < self._due or not self.kept:
            return False
        is_first, later = self.is_first, 2.0 * (self._due - self._begin)
        self._due = self._begin + (_SCANS * self.period if is_first else later)
        found = self._vote(joined(self.kept), alone, is_first=is_first)
        if np.all(self._paired) and not found:
            self.kept = []
        return found and (is_first or not self._compared)

    def search_recording(self, plots: Plots, alone: Alone) -> None:
        """Search for large errors in the first scans in which radars have targets in common."""
        known = plots.time[np.isfinite(plots.time)]
        if not len(known):
            return
        begin, span = float(np.min(known)), _SCANS * self.period
        due = span
        while not np.all(self._paired) and due - span <= float(np.max(known)) - begin:
            within = (plots.time >= begin + due - span) & (plots.time < begin + due)
            self._vote(plots[within], alone)
            due *= 2.0

    def _vote(self, plots: Plots, alone: Alone, *, is_first: bool = False) -> bool:
        """Restart the estimation from the errors that follow from these plots, if they are large.

        In the first scans, large errors are accepted only if several targets show them. If no large
        errors are found, the search goes on.
        """
        plots = _thinned(plots, len(self.sensors))
        count = 2 if is_first else 3
        tables = [
            alone(plots[:0], PositionSensor(), count, self.profile)
            if isinstance(one, Station)
            else alone(plots[plots.sensor == k], one, count, self.profile)
            for k, one in enumerate(self.sensors)
        ]
        found, known, pairs = start(tables, self.sensors)
        prior = own_biases(self.sensors)
        limits, wide = columns_of(prior, "_sigma"), columns_of(found, "_sigma")
        large = np.any(wide > limits, axis=1)
        paired = pairs >= (_FIRST_PAIRS if is_first else 1)
        if is_first:
            self._compared = bool(np.all(paired | self._paired))
            off = np.abs(columns_of(found) - columns_of(prior))
            is_new = bool(np.any(paired & np.any(off > _FAR * limits, axis=1)))
            paired &= bool(np.any(large))
        else:
            is_new = bool(np.any(paired & ~self._paired) and np.any(large))
        self._paired = self._paired | paired
        if is_new:
            # the plots are taken again: what they say must not count twice
            wide, placed = np.minimum(wide, np.hypot(limits, known)), are_placed(self.sensors)
            self._start_from(bias_of(columns_of(found), wide, placed))
        return is_new

    def _start_from(self, bias: Bias) -> None:
        radars, _ = core_sensors(self.sensors, "cv")
        self._core = _core.Registrar(
            radars,
            slant(self.sensors),
            columns_of(bias),
            columns_of(bias, "_sigma"),
            drift_rates(self.sensors),
        )

    def __getstate__(self) -> dict[str, Any]:
        """Return the complete state."""
        return {**self.__dict__, "_core": self._core.__getstate__()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the state."""
        self.__dict__.update(state)
        self._core = _core.Registrar.from_state(state["_core"])


def scans(time: FloatArray, period: float) -> list[IntArray]:
    """Return the indices of the plots in each scan period, in order of time."""
    order = np.argsort(np.where(np.isfinite(time), time, np.nan), kind="stable")
    known = time[order[: np.count_nonzero(np.isfinite(time))]]
    if not len(known) or known[-1] - known[0] < 1.5 * period:
        return [np.arange(len(time))]
    # not one edge for each period: a single wrong time may be years away
    number = np.floor((known - known[0]) / period)
    last = np.ceil((known[-1] - known[0]) / period) - 1.0
    edges = np.flatnonzero(np.diff(np.minimum(number, last))) + 1
    return np.split(order, edges)


def chosen(plots: Plots, index: IntArray) -> Plots:
    """Return the plots of these indices; without a copy if they follow one another."""
    first = int(index[0]) if len(index) else 0
    rows = slice(first, first + len(index))
    return plots[rows if np.array_equal(index, np.arange(rows.start, rows.stop)) else index]


def _newest(plots: Plots) -> float:
    """Return the time of the last plot that has one."""
    return float(np.max(plots.time, where=np.isfinite(plots.time), initial=-np.inf))


def _thinned(plots: Plots, sensors: int) -> Plots:
    """Return the plots of only so many targets per sensor as are needed to find large errors.

    The targets are selected by their identities, the same for all sensors. Nothing is left out if
    most plots of a sensor have no identity, unless those that have one are of targets enough.
    """
    identity = getattr(plots, leading(plots, NUMBERS))
    has_identity, each = identity >= 0, []
    for k in range(sensors):
        own = plots.sensor == k
        known = identity[own & has_identity]
        codes = np.unique(known)
        if len(codes) < _AMPLE and 2 * len(known) < np.count_nonzero(own):
            return plots
        each.append(codes)
    if all(len(codes) <= _AMPLE for codes in each):
        return plots
    several, times = np.unique(np.concatenate(each), return_counts=True)
    several = several[times > 1]
    # those of several sensors first, in no order that airlines or regions know
    chosen = [
        codes[np.lexsort((codes.astype(np.uint64) * _MIXING, ~np.isin(codes, several)))][:_AMPLE]
        for codes in each
    ]
    return plots[np.isin(identity, np.concatenate(chosen))]


def joined(parts: Sequence[Plots]) -> Plots:
    """Return the plots of several scans as one `Plots` object."""
    columns: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in ("time", "range", "azimuth", "sensor", "height", "identity", "detection")
    }
    for name, missing in _MISSING.items():
        given = [getattr(part, name) for part in parts]
        shape = next((one.shape[1:] for one in given if one is not None), None)
        if shape is not None:
            rows = zip(given, parts, strict=True)
            filled = [
                np.full((len(part), *shape), missing) if one is None else one for one, part in rows
            ]
            columns[name] = np.concatenate(filled)
    return Plots(**columns)
