from typing import Any

from tertia._arrays import BoolArray, FloatArray, IntArray

__all__ = [
    "DEBUG_BUILD",
    "VERSION",
    "bursts",
    "cochran",
    "combine",
    "combine_scalar",
    "covariance_of_covariance",
    "critical_value",
    "estimate_bearing",
    "false_alarm_probability",
    "first_order_excess",
    "fused_covariance",
    "grubbs",
    "jacobian",
    "jacobian_factors",
    "k_sigma",
    "known_sigma",
    "least_count",
    "leave_one_out",
    "leave_one_out_mask",
    "leave_one_out_statistics",
    "simulated_excess",
    "thompson_tau",
    "unknown_sigma",
    "unwrap",
    "weight_bias",
    "weight_covariance",
    "weight_matrices",
    "wishart_law",
]

VERSION: str
DEBUG_BUILD: bool

def leave_one_out_statistics(
    y: FloatArray, n_threads: int | None
) -> tuple[FloatArray, FloatArray]: ...
def leave_one_out_mask(y: FloatArray, k: float, n_threads: int | None) -> BoolArray: ...
def leave_one_out(
    y: FloatArray,
    k: float,
    statistics: str,
    order: str,
    replace: bool,
    passes: int,
    omit: bool,
    n_threads: int | None,
) -> tuple[BoolArray, FloatArray, FloatArray, FloatArray, FloatArray]: ...
def k_sigma(
    y: FloatArray, k: float, replace: str | None, omit: bool, n_threads: int | None
) -> tuple[BoolArray, FloatArray, FloatArray, FloatArray, FloatArray]: ...
def bursts(
    y: FloatArray,
    point_penalty: float,
    burst_penalty: float,
    min_burst: int,
    max_burst: int,
    correlation: float,
    resolution: float,
    omit: bool,
    n_threads: int | None,
) -> tuple[BoolArray, FloatArray, FloatArray, FloatArray, FloatArray]: ...
def unwrap(theta: FloatArray, period: float, n_threads: int | None) -> FloatArray: ...
def known_sigma(
    x: FloatArray, row: IntArray, y: FloatArray, sigma: FloatArray
) -> tuple[FloatArray, FloatArray]: ...
def unknown_sigma(x: FloatArray, row: IntArray, y: FloatArray) -> tuple[FloatArray, FloatArray]: ...
def thompson_tau(y: FloatArray) -> tuple[FloatArray, FloatArray]: ...
def grubbs(y: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]: ...
def cochran(
    variances: FloatArray, degrees_of_freedom: float
) -> tuple[IntArray, FloatArray, FloatArray]: ...
def critical_value(n: int, level: float, test: str, degrees_of_freedom: float | None) -> float: ...
def false_alarm_probability(
    k: float, n: int, test: str, degrees_of_freedom: float | None
) -> float: ...
def estimate_bearing(
    theta: FloatArray, options: dict[str, Any], omit: bool, n_threads: int | None
) -> tuple[
    FloatArray,
    FloatArray,
    BoolArray,
    FloatArray,
    tuple[FloatArray, FloatArray, FloatArray] | None,
]: ...
def wishart_law(
    n: float | list[float], convention: str, sensors: int
) -> list[tuple[float, float]]: ...
def least_count(name: str, sensors: int, dimension: int) -> int: ...
def weight_matrices(covariances: FloatArray, n_threads: int | None) -> FloatArray: ...
def fused_covariance(covariances: FloatArray, n_threads: int | None) -> FloatArray: ...
def jacobian(covariances: FloatArray, sensor: int, n_threads: int | None) -> FloatArray: ...
def jacobian_factors(covariances: FloatArray, sensor: int, n_threads: int | None) -> FloatArray: ...
def weight_covariance(
    covariances: FloatArray,
    n: float | list[float],
    sensor: int,
    convention: str,
    n_threads: int | None,
) -> FloatArray: ...
def weight_bias(
    covariances: FloatArray,
    n: float | list[float],
    sensor: int,
    convention: str,
    n_threads: int | None,
) -> FloatArray: ...
def first_order_excess(
    covariances: FloatArray, n: float | list[float], convention: str, n_threads: int | None
) -> FloatArray: ...
def simulated_excess(
    covariances: FloatArray, draws: FloatArray, n_threads: int | None
) -> tuple[FloatArray, FloatArray, FloatArray]: ...
def combine(
    estimates: FloatArray, covariances: FloatArray, n_threads: int | None
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]: ...
def combine_scalar(
    estimate: FloatArray,
    covariance: FloatArray,
    h: FloatArray,
    scalars: FloatArray,
    n_threads: int | None,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]: ...
def covariance_of_covariance(
    covariance: FloatArray, factor: float, n_threads: int | None
) -> FloatArray: ...
