"""Parameters of the tracker for the motion of targets and for the use of flight plans."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias, get_args

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import finite, flag, integer, not_negative, positive, real
from tertia.kalman import SingerModel
from tertia.sensors import Radar
from tertia.sensors._channels import CHANNELS, sigmas_of
from tertia.tracker._earth import reach

if TYPE_CHECKING:
    from tertia.tracker._plots import Plots

MotionName: TypeAlias = Literal["imm", "cv", "singer", "window"]
Motion: TypeAlias = "MotionName | ImmModel | CvModel | SingerModel | WindowModel"
ProfileName: TypeAlias = Literal["aircraft", "vessel", "road", "drone"]
AssociationName: TypeAlias = Literal["gnn", "mht", "paper"]
Association: TypeAlias = "AssociationName | Mht | PaperScore"


@dataclass(frozen=True, slots=True)
class ImmModel:
    """Interacting multiple models (IMM): straight flight, turns and changes of speed.

    Attributes
    ----------
    straight_sigma, turn_sigma : float
        Standard deviation of the acceleration during a scan, in straight flight and in turns, in
        m/s². For straight flight, 0.05 is suitable for simulated flights and 0.2 for recorded
        flights.
    turn_rate_walk : float
        Intensity of the random walk of the turn rate, in radians per second and per square root of
        a second.
    turn_rate_sigma : float
        Standard deviation of the initial turn rate of a turn, in radians per second.
    straight_time, turn_time : float
        Mean duration of straight flight and of a turn, in seconds.
    acceleration_sigma : float
        Standard deviation of the acceleration along the course while the speed changes, in m/s².
    steady_time, speed_change_time : float
        Mean time between two changes of speed and mean duration of one, in seconds.
    """

    straight_sigma: float = 0.1
    turn_sigma: float = 0.8
    turn_rate_walk: float = float(np.radians(0.03))
    turn_rate_sigma: float = float(np.radians(1.2))
    straight_time: float = 400.0
    turn_time: float = 35.0
    acceleration_sigma: float = 0.5
    steady_time: float = 900.0
    speed_change_time: float = 60.0

    def __post_init__(self) -> None:
        """Check the parameters."""
        _require_positive(self)


@dataclass(frozen=True, slots=True)
class CvModel:
    """Motion at nearly constant velocity: straight flight, disturbed by small accelerations.

    Attributes
    ----------
    straight_sigma : float
        Standard deviation of the acceleration during a scan, in m/s².
    """

    straight_sigma: float = 0.1

    def __post_init__(self) -> None:
        """Check the parameter."""
        _require_positive(self)


@dataclass(frozen=True, slots=True)
class WindowModel:
    """Least squares over a sliding window of plots, as in the source (see `Tracker`).

    Attributes
    ----------
    straight : int
        Number of plots in the window in straight flight.
    after_turn : int
        Number of plots that are kept when a manoeuvre is detected; by default 3, or 7 if `degree`
        is 2.
    planned_turn : int
        Number of plots in the window when the target is near a turn of its flight plan.
    degree : {1, 2}
        Degree of the polynomial after a manoeuvre is detected. A quadratic polynomial (2) is fitted
        to at least five plots. It is used until its acceleration is no longer significant, but for
        at most twelve scans. After that, a straight line is fitted, at first to three plots.
    """

    straight: int = 20
    after_turn: int | None = None
    planned_turn: int = 5
    degree: int = 1

    def __post_init__(self) -> None:
        """Check the windows."""
        degree = integer(self.degree, "degree", 1)
        if degree > 2:
            raise ValueError(f"degree is {degree}; it must be 1 or 2")
        if self.after_turn is None:
            object.__setattr__(self, "after_turn", 3 if degree == 1 else 7)
        for name in ("straight", "after_turn", "planned_turn"):
            least = 5 if degree == 2 and name == "after_turn" else 2
            object.__setattr__(self, name, integer(getattr(self, name), name, least))


@dataclass(frozen=True, slots=True)
class PaperScore:
    """Association by the score of the source, `½ (1/q − 1) d² + ln q` for a plot at the distance d.

    The density of false plots, the detection probability and the size of the covariances are
    ignored. A track is confirmed by M plots in N scans, however many false plots there are.

    Attributes
    ----------
    q : float
        Ratio of the variance of the distance of a false plot to that of a true one, above 1.
    """

    q: float = 100.0

    def __post_init__(self) -> None:
        """Check the ratio."""
        q = real(self.q, "q")
        if not 1.0 < q < float("inf"):
            raise ValueError(f"q is {q}; it must be above 1")
        object.__setattr__(self, "q", q)


@dataclass(frozen=True, slots=True, init=False)
class PlanModel:
    """Parameters for the use of flight plans, and the velocity of the wind.

    Attributes
    ----------
    flown_probability : float
        Probability that a planned turn is flown, as assumed before any turn has been observed. If
        it is 0, plans have no influence. With the motion "window", all values above 0 have the same
        effect.
    wind : (float, float)
        East and north velocity of the air in m/s, used for planned turns.
    wind_sigma : float
        Standard deviation of the wind in m/s: about 6 if the wind is known, 20 if it is not.
    initiation : bool
        Whether to expect a new target at the place where, according to its plan, a flight without a
        track should now be. A track that begins there is confirmed earlier; two plots are enough if
        false plots are rare. Do not use this option for a primary radar that shows echoes of the
        previous scan again: two such echoes would confirm a track.

    Raises
    ------
    ValueError, TypeError
        If a number is outside its domain or has the wrong type.
    """

    flown_probability: float
    wind: tuple[float, float]
    wind_sigma: float
    initiation: bool

    def __init__(
        self,
        flown_probability: float = 0.8,
        wind: npt.ArrayLike = (0.0, 0.0),
        wind_sigma: float = 20.0,
        initiation: bool = False,
    ) -> None:
        probability = real(flown_probability, "flown_probability")
        if not 0.0 <= probability < 1.0:
            raise ValueError(
                f"flown_probability is {probability}; it must be 0 or more and less than 1"
            )
        air = finite(wind, "wind")
        if air.shape != (2,):
            raise ValueError(f"wind has shape {air.shape}; it must be (2,): east and north")
        sigma = not_negative(wind_sigma, "wind_sigma")
        object.__setattr__(self, "flown_probability", probability)
        object.__setattr__(self, "wind", (float(air[0]), float(air[1])))
        object.__setattr__(self, "wind_sigma", sigma)
        object.__setattr__(self, "initiation", flag(initiation, "initiation"))


@dataclass(frozen=True, slots=True)
class Mht:
    """Multiple-hypothesis tracking: keeps several assignments of plots to tracks at a time.

    Attributes
    ----------
    max_hypotheses : int
        Largest number of joint hypotheses for a group of tracks that have plots in common in their
        gates.
    scans : int
        Number of scans after which the choice between hypotheses is final. The output is not
        delayed by this, because the best hypothesis is always shown at once.
    cut : float
        Natural logarithm of the likelihood ratio at which a hypothesis is dropped: it is dropped if
        the best hypothesis is more than exp(cut) times as likely.

    Raises
    ------
    ValueError, TypeError
        If a number is outside its domain or has the wrong type.
    """

    max_hypotheses: int = 32
    scans: int = 15
    cut: float = 7.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name in ("max_hypotheses", "scans"):
            object.__setattr__(self, name, integer(getattr(self, name), name, 1))
        object.__setattr__(self, "cut", not_negative(self.cut, "cut"))


class Profile(NamedTuple):
    """Properties of a kind of targets.

    `heights` are the mean and the standard deviation of unknown heights above the sensor; None:
    anywhere in the height of air traffic.
    """

    motion: ImmModel
    max_speed: float
    heights: tuple[float, float] | None = None


def core_motion(motion: Motion, profile: ProfileName = "aircraft") -> _core.Motion:
    """Return a motion model in the form that the core takes; a name selects that of the profile."""
    names = get_args(MotionName)
    if isinstance(motion, str):
        if motion not in names:
            raise ValueError(f"motion is {motion!r}; it must be one of {', '.join(names)}")
        motion = _MODELS[motion] if motion != "imm" else profile_of(profile).motion
    match motion:
        case ImmModel():
            return _core.Motion.imm(**asdict(motion))
        case CvModel():
            return _core.Motion.cv(**asdict(motion))
        case SingerModel():
            if not motion.exact:
                raise ValueError("motion is a SingerModel with exact=False; it must be exact")
            return _core.Motion.singer(motion)
        case WindowModel():
            windows = {name: getattr(motion, name) for name in ("straight", "after_turn")}
            return _core.Motion.window(
                **windows, planned_turn=motion.planned_turn, is_curved=motion.degree == 2
            )
    raise TypeError(f"motion is {motion!r}; it must be a model, or one of {', '.join(names)}")


def profile_of(profile: ProfileName) -> Profile:
    """Return the properties of a kind of targets."""
    if not isinstance(profile, str) or profile not in _PROFILES:
        names = ", ".join(get_args(ProfileName))
        raise ValueError(f"profile is {profile!r}; it must be one of {names}")
    return _PROFILES[profile]


def with_heights(plots: Plots, sensors: Sequence[Any], profile: ProfileName) -> Plots:
    """Return plots in which targets near the ground are at the height that the profile expects.

    Only the heights of plots of radars with a height of their own are filled in, because the ranges
    of other radars are horizontal.
    """
    heights = profile_of(profile).heights
    if heights is None or np.isfinite(plots.height).all():
        return plots
    expected = np.array([_height(sensor) for sensor in sensors]) + heights[0]
    unknown = np.isnan(plots.height)
    return plots._replaced(height=np.where(unknown, expected[plots.sensor], plots.height))


def _height(sensor: Any) -> float:
    """Return the height of a radar; nan if it has none."""
    if not isinstance(sensor, Radar):
        return np.nan
    if sensor.site is not None:
        return sensor.site.height
    return float(sensor.position[2]) if len(sensor.position) > 2 else np.nan


def core_association(association: Association) -> _core.TrackAssociation:
    """Return a rule of association in the form that the core takes."""
    match association:
        case "gnn":
            return _core.TrackAssociation.gnn()
        case "paper":
            return _core.TrackAssociation.paper(PaperScore().q)
        case PaperScore():
            return _core.TrackAssociation.paper(association.q)
        case "mht":
            return core_association(Mht())
        case Mht():
            return _core.TrackAssociation.mht(**asdict(association))
    names = ", ".join(get_args(AssociationName))
    if isinstance(association, str):
        raise ValueError(f"association is {association!r}; it must be one of {names}")
    raise TypeError(
        f"association is {association!r}; it must be an Mht, a PaperScore, or one of {names}"
    )


def core_radar(radar: Radar) -> _core.Radar:
    """Return a radar in the form that the core takes."""
    east, north, *up = radar.position.tolist()
    size, angle = radar.range_resolution, radar.azimuth_resolution
    return _core.Radar(
        position=[east, north, *(up or [0.0])],
        range_sigma=radar.range_sigma,
        azimuth_sigma=radar.azimuth_sigma,
        scan_period=radar.scan_period,
        max_range=reach(radar),
        detection_probability=radar.detection_probability,
        resolution=None if size is None or angle is None else [size, angle],
        channels=_core_channels(radar),
        extent=radar.target_extent,
    )


def _core_channels(radar: Radar) -> list[list[float] | None] | None:
    """Return the numbers for the primary, secondary and mode S channels; None without channels."""
    if radar.channels is None:
        return None
    own, sigmas = radar.channels, (radar.range_sigma, radar.azimuth_sigma)
    return [
        [
            own[name].detection_probability,
            *sigmas_of(own, name, sigmas),
            _number_or_nan(own[name].clutter_per_scan),
        ]
        if name in own
        else None
        for name in CHANNELS
    ]


def _number_or_nan(value: float | None) -> float:
    return np.nan if value is None else value


def _require_positive(model: Any) -> None:
    for name in model.__slots__:
        number = positive(real(getattr(model, name), name), name)
        object.__setattr__(model, name, float(number))


_PROFILES: dict[str, Profile] = {
    "aircraft": Profile(ImmModel(), 350.0),
    "vessel": Profile(
        ImmModel(0.03, 0.1, 0.0005, 0.02, 200.0, 50.0, 0.1, 600.0, 60.0), 30.0, (0.0, 50.0)
    ),
    "road": Profile(ImmModel(0.5, 2.0, 0.03, 0.15, 12.0, 5.0, 1.5, 30.0, 8.0), 70.0, (0.0, 10.0)),
    "drone": Profile(
        ImmModel(0.3, 2.0, 0.05, 0.3, 20.0, 5.0, 1.5, 30.0, 5.0), 40.0, (100.0, 100.0)
    ),
}
_MODELS: dict[str, CvModel | SingerModel | WindowModel] = {
    "cv": CvModel(),
    # 3 m/s2 that fades within a minute; the tracker has the times of the plots in place of dt
    "singer": SingerModel(1.0, 1 / 60, 3.0, exact=True),
    "window": WindowModel(),
}
