from typing import Any, final

from tertia._arrays import BoolArray, FloatArray, IntArray
from tertia.kalman import SingerModel
from tertia.location._scene import Measured
from tertia.sensors._identities import Identities
from tertia.tracker import Plots

__all__ = [
    "CODES_OF_MANY",
    "DEBUG_BUILD",
    "VERSION",
    "AngleFilter",
    "AngleFusion",
    "Flights",
    "Frame",
    "FusionCentre",
    "Geometry",
    "Motion",
    "PlotTracker",
    "Radar",
    "Registrar",
    "Route",
    "TrackAssociation",
    "TrackColumns",
    "TrackerSettings",
    "assign_pairs",
    "associate",
    "asterix_blocks",
    "asterix_definitions",
    "asterix_recording",
    "asterix_records",
    "asterix_times",
    "beam_meetings",
    "bursts",
    "calibrate",
    "cartesian_states",
    "chi_square_quantile",
    "cochran",
    "common_states",
    "conformance",
    "consistency_bounds",
    "correct_states",
    "correlate",
    "critical_value",
    "ecef_to_geodetic",
    "estimate_bearing",
    "explanation",
    "false_alarm_probability",
    "filter_series",
    "first_outside",
    "fit_noise",
    "fuse",
    "fuse_scalar",
    "fuse_series",
    "gate_pairs",
    "gate_sectors",
    "gate_threshold",
    "geodetic_to_ecef",
    "group_arrivals",
    "grubbs",
    "height_offsets",
    "indicator_powers",
    "k_sigma",
    "lasting",
    "least_count",
    "leave_one_out",
    "leave_one_out_mask",
    "leave_one_out_statistics",
    "likelihood_score",
    "local_polynomial",
    "locate",
    "locate_posterior",
    "location_accuracy",
    "location_radii",
    "location_regions",
    "mean_interval",
    "moving_polynomial",
    "paper_score",
    "plan_speeds",
    "plots_flattened",
    "plots_in_plane",
    "plots_to_cartesian",
    "polar_states",
    "posterior_radii",
    "posterior_regions",
    "predicted",
    "pressure_heights",
    "protection_levels",
    "rank_interval",
    "reconstruct",
    "reconstruct_arrivals",
    "register_errors",
    "register_noise",
    "register_start",
    "series_biases",
    "share_interval",
    "shown_covariances",
    "simulated_factors",
    "singer_transition",
    "smooth",
    "smooth_series",
    "smooth_tracks",
    "steady_state",
    "student_factor",
    "t_test",
    "thompson_tau",
    "times_over",
    "track_columns",
    "traffic_states",
    "unwrap_about_median",
    "weigh",
    "wishart_law",
    "z_test",
]

VERSION: str
DEBUG_BUILD: bool
CODES_OF_MANY: list[int]

def leave_one_out_statistics(
    y: FloatArray, n_threads: int | None
) -> tuple[FloatArray, FloatArray]: ...
def leave_one_out_mask(y: FloatArray, k: float, n_threads: int | None) -> BoolArray: ...
def leave_one_out(
    y: FloatArray,
    k: float,
    statistics: str,
    direction: str,
    replace: bool,
    passes: int,
    omit: bool,
    n_threads: int | None,
) -> tuple[BoolArray, FloatArray, FloatArray, FloatArray, FloatArray]: ...
def k_sigma(
    y: FloatArray, k: float, replace: str | None, omit: bool, n_threads: int | None
) -> tuple[BoolArray, FloatArray, FloatArray, FloatArray, FloatArray]: ...
def asterix_definitions() -> list[tuple[int, list[str], list[tuple[str, float, str]]]]: ...
def asterix_blocks(contents: bytes) -> tuple[IntArray, IntArray, IntArray, int]: ...
def asterix_recording(
    contents: bytes, known: list[int]
) -> tuple[IntArray, IntArray, IntArray, list[tuple[int, int]]]: ...
def asterix_records(
    definition: int, contents: bytes, begin: IntArray, end: IntArray
) -> tuple[IntArray, list[IntArray], list[tuple[int, int, str]]]: ...
def asterix_times(full: FloatArray, truncated: FloatArray, source: IntArray) -> FloatArray: ...
def bursts(
    y: FloatArray,
    point_penalty: float,
    burst_penalty: float,
    min_burst: int,
    max_burst: int,
    correlation: float,
    rounding: float,
    omit: bool,
    n_threads: int | None,
) -> tuple[BoolArray, FloatArray, FloatArray, FloatArray, FloatArray]: ...
def moving_polynomial(
    y: FloatArray,
    time: FloatArray,
    window: int,
    degree: int,
    k: float,
    period: float | None,
    n_threads: int | None,
) -> tuple[BoolArray, FloatArray, FloatArray, FloatArray, FloatArray]: ...
def unwrap_about_median(theta: FloatArray, period: float, n_threads: int | None) -> FloatArray: ...
def z_test(
    x: FloatArray, row: IntArray, y: FloatArray, sigma: FloatArray
) -> tuple[FloatArray, FloatArray]: ...
def t_test(x: FloatArray, row: IntArray, y: FloatArray) -> tuple[FloatArray, FloatArray]: ...
def thompson_tau(y: FloatArray) -> tuple[FloatArray, FloatArray]: ...
def grubbs(y: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]: ...
def cochran(
    variances: FloatArray, degrees_of_freedom: float
) -> tuple[IntArray, FloatArray, FloatArray]: ...
def critical_value(
    n: int, significance: float, test: str, degrees_of_freedom: float | None
) -> float: ...
def false_alarm_probability(
    k: float, n: int, test: str, degrees_of_freedom: float | None
) -> float: ...
def first_outside(array: FloatArray, least: float, most: float, missing: bool) -> int | None: ...
def estimate_bearing(
    theta: FloatArray,
    sigma: FloatArray | None,
    groups: FloatArray | None,
    options: dict[str, Any],
    omit: bool,
    n_threads: int | None,
) -> tuple[list[FloatArray], BoolArray, tuple[FloatArray, FloatArray, FloatArray] | None]: ...
def wishart_law(
    n: float | list[float], convention: str, sensors: int
) -> list[tuple[float, float]]: ...
def student_factor(degrees_of_freedom: float) -> float: ...
def simulated_factors(ratios: FloatArray) -> list[float]: ...
def least_count(name: str, sensors: int, dimension: int) -> int: ...
def weigh(
    quantity: str,
    covariances: FloatArray,
    n_threads: int | None,
    *,
    sensor: int = ...,
    n: float | list[float] = ...,
    convention: str = "sample-mean",
    draws: FloatArray | None = None,
    factor: float = 0.0,
) -> FloatArray: ...
def singer_transition(model: SingerModel, dt: float) -> tuple[list[float], list[float]]: ...
def steady_state(model: SingerModel, variance: float) -> tuple[list[float], list[float]]: ...
def consistency_bounds(probability: float, count: int, dimension: int) -> list[float]: ...
def filter_series(
    batch: dict[str, Any], store: str, filled: list[FloatArray], n_threads: int | None
) -> tuple[list[FloatArray], IntArray]: ...
def fit_noise(
    z: FloatArray,
    dt: FloatArray,
    period: float | None,
    outlier_gate: float | None,
    n_threads: int | None,
) -> tuple[Any, BoolArray]: ...
def smooth_series(
    batch: dict[str, Any], n_threads: int | None
) -> tuple[FloatArray, FloatArray]: ...

@final
class AngleFilter:
    angle: float
    mean: FloatArray
    covariance: FloatArray
    innovation: float
    innovation_variance: float
    def __new__(
        cls, model: Any, measurement_variance: float, *, period: float | None = None
    ) -> AngleFilter: ...
    def predict(self, dt: float | None = None) -> None: ...
    def update(self, z: float, measurement_variance: float | None = None) -> float: ...
    def step(
        self, z: float, measurement_variance: float | None = None, dt: float | None = None
    ) -> float: ...
    def set_state(self, mean: Any, covariance: Any) -> None: ...
    def __getnewargs_ex__(self) -> tuple[tuple[Any, float], dict[str, Any]]: ...
    def __getstate__(self) -> tuple[list[float], float, float]: ...
    def __setstate__(self, state: Any) -> None: ...

def fuse(given: dict[str, Any], n_threads: int | None) -> tuple[list[FloatArray], IntArray]: ...
def fuse_scalar(
    estimate: FloatArray,
    covariance: FloatArray,
    h: FloatArray,
    scalars: FloatArray,
    n_threads: int | None,
) -> tuple[list[FloatArray], IntArray]: ...
def fuse_series(
    batch: dict[str, Any], n_threads: int | None
) -> tuple[list[FloatArray], list[BoolArray]]: ...
def series_biases(
    arrays: tuple[FloatArray, FloatArray, FloatArray],
    prior: FloatArray,
    model: Any,
    n_threads: int | None,
) -> list[FloatArray]: ...

@final
class AngleFusion:
    angle: float
    mean: FloatArray
    covariance: FloatArray
    weights: FloatArray
    noise_variance: FloatArray
    innovation: FloatArray
    innovation_variance: FloatArray
    outlier: list[bool]
    repeated: list[bool]
    def __new__(
        cls,
        model: Any,
        measurement_variance: Any,
        *,
        method: str = "robust",
        period: float | None = None,
        change_probability: float = 0.005,
        forgetting_factor: float = 0.9,
        threshold: float = 1.6,
        outlier_gate: float = 16.0,
    ) -> AngleFusion: ...
    def predict(self, dt: float | None = None) -> None: ...
    def update(self, plots: Any, measurement_variance: Any = None) -> float: ...
    def step(
        self, plots: Any, measurement_variance: Any = None, dt: float | None = None
    ) -> float: ...
    def __getnewargs_ex__(self) -> tuple[tuple[Any, list[float]], dict[str, Any]]: ...
    def __getstate__(self) -> tuple[Any, ...]: ...
    def __setstate__(self, saved: Any) -> None: ...

@final
class PlotTracker:
    time: float
    plots: int
    def __new__(
        cls,
        settings: TrackerSettings,
        radars: list[Radar],
        geometry: list[Geometry],
        plans: list[Route],
        lag: float,
    ) -> PlotTracker: ...
    def track(
        self,
        plots: tuple[Plots, Plots],
        time: FloatArray,
        end: float | None,
        rows: str,
        table: TrackColumns,
        n_threads: int | None,
    ) -> IntArray: ...
    def finish(self, n_threads: int | None) -> tuple[TrackColumns, IntArray]: ...
    def copy(self) -> PlotTracker: ...
    def knowing(self, later: PlotTracker) -> PlotTracker | None: ...
    def noise_factor(self) -> FloatArray: ...
    def extrapolate(self, seconds: float) -> tuple[IntArray, FloatArray]: ...
    def numbers(self) -> IntArray: ...
    def shift(self, track: IntArray, time: FloatArray, by: FloatArray) -> None: ...
    def restart(self, plots: int) -> None: ...
    def take_clock_doubts(self) -> list[tuple[int, float, bool]]: ...
    def noise(self) -> FloatArray: ...
    def set_noise(self, noise: FloatArray) -> None: ...
    def hold(self, radars: list[bool]) -> None: ...
    def set_delays(self, common: FloatArray) -> None: ...
    def weigh_delays(self, unsure: float) -> None: ...
    def delay_sigmas(self) -> FloatArray: ...
    def suspended_plans(self) -> IntArray: ...
    def add_plan(self, plan: Route) -> int: ...
    def replace_plan(self, number: int, plan: Route) -> None: ...
    def remove_plan(self, number: int) -> None: ...
    def correlate(self, track: int, plan: int, take: bool) -> None: ...
    def decorrelate(self, track: int) -> None: ...
    def suspend_plan(self, track: int, suspended: bool) -> None: ...
    def __getstate__(self) -> bytes: ...
    @staticmethod
    def from_state(state: bytes) -> PlotTracker: ...

@final
class TrackColumns:
    def __new__(cls, rows: int) -> TrackColumns: ...
    @property
    def count(self) -> int: ...
    def truncate(self, rows: int) -> None: ...
    def renumber(self, order: IntArray, first: int) -> None: ...
    def heights(self, height: FloatArray, first: int, begin: int) -> FloatArray: ...
    def keep_confirmed(self, track_of_plot: IntArray, n_threads: int | None) -> IntArray: ...
    def column(self, index: int) -> FloatArray | IntArray | BoolArray: ...

@final
class Radar:
    def __new__(
        cls,
        *,
        position: list[float],
        range_sigma: float,
        azimuth_sigma: float,
        scan_period: float,
        max_range: float,
        detection_probability: float,
        resolution: list[float] | None = None,
        channels: list[list[float] | None] | None = None,
        extent: float = 0.0,
    ) -> Radar: ...

@final
class Motion:
    takes_plans: bool
    @staticmethod
    def cv(*, straight_sigma: float) -> Motion: ...
    @staticmethod
    def imm(
        *,
        straight_sigma: float,
        turn_sigma: float,
        turn_rate_walk: float,
        turn_rate_sigma: float,
        straight_time: float,
        turn_time: float,
        acceleration_sigma: float,
        steady_time: float,
        speed_change_time: float,
    ) -> Motion: ...
    @staticmethod
    def singer(model: SingerModel) -> Motion: ...
    @staticmethod
    def window(*, straight: int, after_turn: int, planned_turn: int, is_curved: bool) -> Motion: ...

@final
class TrackAssociation:
    @staticmethod
    def gnn() -> TrackAssociation: ...
    @staticmethod
    def paper(q: float) -> TrackAssociation: ...
    @staticmethod
    def mht(*, max_hypotheses: int, scans: int, cut: float) -> TrackAssociation: ...

@final
class Geometry:
    @staticmethod
    def flat() -> Geometry: ...
    @staticmethod
    def space() -> Geometry: ...
    @staticmethod
    def position(sigmas: list[float]) -> Geometry: ...
    @staticmethod
    def azimuth(sigma: float) -> Geometry: ...
    @staticmethod
    def earth(site: list[float], plane: Frame, max_range: float) -> Geometry: ...

@final
class TrackerSettings:
    def __new__(
        cls,
        *,
        motion: Motion,
        association: TrackAssociation,
        flown_probability: float,
        initiation: bool,
        wind: list[float],
        wind_sigma: float,
        confirmation: tuple[int, int] | float,
        coasting: int,
        clutter_density: float | None,
        max_speed: float,
        heights: tuple[float, float] | None,
        gate_probability: float,
        guard_acceleration: float | None,
        identity_error_probability: float,
        emergency_codes: list[int],
    ) -> TrackerSettings: ...

def track_columns() -> list[tuple[str, str, str, list[int], str]]: ...
def plots_to_cartesian(radars: list[Radar], plots: Plots) -> tuple[FloatArray, FloatArray]: ...
def height_offsets(first: list[int], plots: FloatArray) -> FloatArray: ...
def shown_covariances(
    sensors: tuple[list[Radar], list[Geometry]],
    track: IntArray,
    sensor: IntArray,
    plots: FloatArray,
) -> FloatArray: ...
def smooth_tracks(
    motion: Motion,
    first: list[int],
    plots: FloatArray,
    used: BoolArray,
    *,
    time: FloatArray,
    every: float | None,
    n_threads: int | None,
) -> tuple[IntArray, FloatArray, IntArray, BoolArray]: ...
def locate(
    stations: FloatArray,
    axes: FloatArray | None,
    values: FloatArray,
    sigmas: FloatArray,
    position_sigmas: FloatArray | None,
    height: FloatArray | None,
    initial: FloatArray | None,
    robustness: tuple[str, int],
    differences: tuple[bool, float],
    free: list[bool],
    pooled: bool,
    medium: tuple[float, float, tuple[bool, bool]],
    n_threads: int | None,
) -> tuple[
    FloatArray,
    FloatArray,
    FloatArray,
    BoolArray,
    list[FloatArray],
    list[list[float]],
    tuple[tuple[float, float], tuple[list[float], list[list[float]], FloatArray] | None],
]: ...
def explanation(
    stations: FloatArray,
    axes: FloatArray | None,
    values: FloatArray,
    sigmas: FloatArray,
    position_sigmas: FloatArray | None,
    height: FloatArray | None,
    positions: FloatArray,
    velocities: FloatArray | None,
) -> tuple[str, int, float, float] | None: ...
def locate_posterior(
    measured: tuple[FloatArray, FloatArray | None, FloatArray, FloatArray],
    max_range: float,
    pooled: bool,
    n_threads: int | None,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, list[FloatArray]]: ...
def posterior_regions(
    measured: tuple[FloatArray, FloatArray | None, FloatArray, FloatArray],
    max_range: float,
    weights: FloatArray,
    probability: float,
    n_threads: int | None,
) -> tuple[list[FloatArray], list[list[FloatArray]]]: ...
def posterior_radii(
    measured: tuple[FloatArray, FloatArray | None, FloatArray, FloatArray],
    max_range: float,
    weights: FloatArray,
    centres: FloatArray,
    probability: float,
    n_threads: int | None,
) -> FloatArray: ...
def location_regions(
    scene: Measured,
    accuracy: tuple[FloatArray, tuple[FloatArray, FloatArray] | None],
    probability: float,
    n_threads: int | None,
) -> tuple[list[FloatArray], list[list[FloatArray]]]: ...
def location_radii(
    scene: Measured,
    accuracy: tuple[FloatArray, tuple[FloatArray, FloatArray] | None],
    probability: float,
    n_threads: int | None,
) -> FloatArray: ...
def protection_levels(
    scene: Measured, guarded: tuple[float, float, int, float], n_threads: int | None
) -> FloatArray: ...
def location_accuracy(
    stations: tuple[FloatArray, FloatArray | None],
    sigmas: tuple[FloatArray, FloatArray | None],
    positions: FloatArray,
    correlation: float,
    n_threads: int | None,
) -> tuple[FloatArray, FloatArray]: ...
def predicted(
    stations: FloatArray,
    axes: FloatArray | None,
    positions: FloatArray,
    n_threads: int | None,
) -> FloatArray: ...
def local_polynomial(
    y: FloatArray,
    time: FloatArray | None,
    variance: FloatArray | None,
    window: int,
    degree: int,
    adaptive: bool,
    derivative: int,
    significance: float,
    n_threads: int | None,
) -> tuple[FloatArray, FloatArray, IntArray, FloatArray, FloatArray]: ...
def smooth(
    tracks: dict[str, Any], n_threads: int | None
) -> tuple[tuple[FloatArray, FloatArray, FloatArray, BoolArray], tuple[Any, ...]]: ...
def reconstruct(
    measured: dict[str, Any], steps: dict[str, Any], n_threads: int | None
) -> dict[str, Any]: ...
def group_arrivals(
    time: FloatArray, sensor: list[int], identity: list[int]
) -> list[int | None]: ...
def reconstruct_arrivals(net: dict[str, Any], recorded: dict[str, Any]) -> dict[str, Any]: ...
def gate_threshold(probability: float, dimension: int) -> float: ...
def gate_sectors(
    innovation: FloatArray, covariance: FloatArray, velocity: FloatArray
) -> IntArray: ...
def paper_score(d2: FloatArray, q: float, dimension: int) -> FloatArray: ...
def likelihood_score(
    d2: FloatArray,
    ln_determinant: FloatArray,
    dimension: int,
    detection_probability: float,
    clutter_density: float,
) -> FloatArray: ...
def associate(
    predicted: FloatArray,
    covariance: FloatArray,
    plots: FloatArray,
    plot_covariance: FloatArray | None,
    gate_probability: float,
    likelihood: tuple[float, float] | None,
    q: float,
    method: str,
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]: ...
def gate_pairs(
    predicted: FloatArray,
    covariance: FloatArray,
    plots: FloatArray,
    plot_covariance: FloatArray | None,
    threshold: float,
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]: ...
def assign_pairs(
    row: IntArray, column: IntArray, gain: FloatArray, rows: int, columns: int, method: str
) -> IntArray: ...

@final
class Route:
    def __new__(
        cls,
        waypoints: FloatArray,
        speeds: FloatArray,
        heights: FloatArray,
        start_time: float,
        bank: float,
        turn_rate: float,
        identities: tuple[int, int, int, str],
    ) -> Route: ...
    @property
    def length(self) -> float: ...
    @property
    def times(self) -> FloatArray: ...
    @property
    def distances(self) -> FloatArray: ...
    def turns(self) -> tuple[list[FloatArray], list[FloatArray]]: ...
    def path(self, values: FloatArray, are_times: bool) -> list[FloatArray]: ...
    def project(
        self, positions: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]: ...

def plan_speeds(
    waypoints: FloatArray, times: FloatArray, bank: float, turn_rate: float
) -> FloatArray: ...
def correlate(
    plans: list[Route],
    tracks: dict[str, Any],
    identities: Identities,
    n_threads: int | None,
) -> tuple[FloatArray, IntArray, IntArray]: ...
def conformance(
    route: Route, track: dict[str, Any], update_interval: float
) -> tuple[IntArray, list[FloatArray], list[BoolArray]]: ...
def times_over(
    route: Route, track: dict[str, Any], update_interval: float, speed_change_sigma: float
) -> list[FloatArray]: ...
def register_noise(
    updates: dict[str, Any], azimuth_sigma: float, scan_period: float, edges: FloatArray
) -> list[list[FloatArray]]: ...
def common_states(
    joint: dict[str, Any], single: list[dict[str, Any]], scan_periods: list[float]
) -> tuple[FloatArray, IntArray, list[FloatArray]]: ...
def calibrate(
    time: FloatArray,
    residual: FloatArray,
    azimuth: FloatArray,
    sigma: float,
    orders: tuple[int, int],
) -> tuple[FloatArray, FloatArray, float, float, float]: ...
def register_errors(
    plots: dict[str, Any],
    radars: list[Radar],
    slant: list[bool],
    prior: list[FloatArray],
    edges: FloatArray,
    start: FloatArray,
) -> tuple[list[FloatArray], list[tuple[int, int]], list[int]]: ...

@final
class Registrar:
    def __new__(
        cls,
        radars: list[Radar],
        slant: list[bool],
        mean: FloatArray,
        sigma: FloatArray,
        drift: FloatArray,
    ) -> Registrar: ...
    def know(self, errors: FloatArray, covariance: FloatArray) -> None: ...
    def expect(self, later: Registrar) -> bool: ...
    def correct(self, plots: Plots) -> tuple[list[FloatArray], FloatArray | None]: ...
    def learn(
        self,
        plots: Plots,
        first: int,
        rows: tuple[TrackColumns, int],
        track_of_plot: IntArray,
        noise: FloatArray,
        azimuth_sigmas: FloatArray,
        time: float,
        alive: IntArray,
    ) -> tuple[IntArray, FloatArray, FloatArray]: ...
    def known(self) -> list[FloatArray]: ...
    def held(self) -> list[bool]: ...
    def clocks(self) -> FloatArray: ...
    def unsure(self, radars: list[bool]) -> float: ...
    def set_delays(self, sigmas: FloatArray) -> None: ...
    def changes(self) -> list[tuple[float, int]]: ...
    def __getstate__(self) -> bytes: ...
    @staticmethod
    def from_state(state: bytes) -> Registrar: ...

@final
class FusionCentre:
    def __new__(
        cls,
        radars: list[Radar],
        method: str,
        cross_correlation: list[float],
        registers: bool,
        mean: FloatArray,
        sigma: FloatArray,
        drift: FloatArray,
    ) -> FusionCentre: ...
    def update(
        self, tracks: dict[str, Any], time: float, n_threads: int | None
    ) -> tuple[IntArray, list[FloatArray], IntArray, list[IntArray], Any, list[BoolArray]]: ...
    def decide(self, a: int, b: int, joined: bool) -> bool: ...
    def release(self, number: int) -> bool: ...
    def known(self) -> list[FloatArray]: ...
    def __getstate__(self) -> bytes: ...
    @staticmethod
    def from_state(state: bytes) -> FusionCentre: ...

def register_start(
    tracks: dict[str, Any], radars: list[Radar], sigma: FloatArray
) -> tuple[list[FloatArray], list[int]]: ...
def correct_states(
    states: dict[str, Any], positions: FloatArray, errors: FloatArray, factors: FloatArray
) -> list[FloatArray]: ...

@final
class Flights:
    def __new__(
        cls, columns: dict[str, Any], offset: Any, variation: Any, step: float
    ) -> Flights: ...
    def advance(self, noise: FloatArray, n_threads: int | None) -> int: ...
    @property
    def is_flying(self) -> bool: ...
    def samples(self) -> tuple[IntArray, list[FloatArray], BoolArray, list[FloatArray]]: ...

def traffic_states(
    traffic: dict[str, Any], flight: IntArray, time: FloatArray
) -> list[FloatArray]: ...
def beam_meetings(
    traffic: dict[str, Any], position: list[float], scan_period: float, phase: float
) -> tuple[IntArray, FloatArray]: ...
def lasting(errors: FloatArray, gaps: FloatArray) -> tuple[FloatArray, FloatArray]: ...
def mean_interval(
    mean: float, ratio: float, worth: dict[str, Any], confidence_level: float
) -> list[float]: ...
def share_interval(share: float, worth: dict[str, Any], confidence_level: float) -> list[float]: ...
def rank_interval(
    probability: float, worth: dict[str, Any], confidence_level: float
) -> list[float]: ...
def indicator_powers(axes: int, probability: float) -> list[float]: ...
def chi_square_quantile(probability: float, degrees_of_freedom: int) -> float: ...

@final
class Frame:
    def __new__(cls, origin: list[float], is_plane: bool) -> Frame: ...
    def from_ecef(self, points: FloatArray) -> FloatArray: ...
    def to_ecef(self, points: FloatArray) -> FloatArray: ...
    def polar_to_geodetic(self, points: FloatArray) -> FloatArray: ...
    def geodetic_to_polar(self, points: FloatArray) -> FloatArray: ...
    def scale_and_convergence(self, points: FloatArray) -> FloatArray: ...
    def transform(
        self, target: Frame, states: FloatArray, covariance: FloatArray | None
    ) -> tuple[FloatArray, FloatArray | None]: ...

def geodetic_to_ecef(points: FloatArray) -> FloatArray: ...
def ecef_to_geodetic(points: FloatArray) -> FloatArray: ...
def polar_states(points: FloatArray) -> tuple[FloatArray, FloatArray]: ...
def cartesian_states(points: FloatArray) -> FloatArray: ...
def pressure_heights(altitude: FloatArray, atmosphere: list[float]) -> FloatArray: ...
def plots_in_plane(
    sites: FloatArray, plane: Frame, sensor: IntArray, plots: FloatArray
) -> FloatArray: ...
def plots_flattened(
    sites: FloatArray, plane: Frame, sensor: IntArray, plots: FloatArray, level: FloatArray
) -> FloatArray: ...
