from typing import Any

from tertia._arrays import BoolArray, FloatArray, IntArray

__all__ = [
    "DEBUG_BUILD",
    "VERSION",
    "bursts",
    "cochran",
    "critical_value",
    "estimate_bearing",
    "false_alarm_probability",
    "grubbs",
    "k_sigma",
    "known_sigma",
    "leave_one_out",
    "leave_one_out_mask",
    "leave_one_out_statistics",
    "thompson_tau",
    "unknown_sigma",
    "unwrap",
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
