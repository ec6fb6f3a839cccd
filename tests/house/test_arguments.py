"""Arguments of every public function in other forms give the same result, and stay as they are."""

import dataclasses
import inspect
from collections.abc import Callable
from typing import Any

import numpy as np
import polars as pl
import pytest
from calls import CALLS
from checks import LAYOUTS, assert_same, fields

from tertia.report import Emitter
from tertia.sensors import Bias, Radar, Station
from tertia.tracker import Plots

FloatArray = np.ndarray[Any, np.dtype[np.float64]]
every_call = pytest.mark.parametrize(
    "call", CALLS, ids=[f"{at}-{f.__qualname__}" for at, (f, _) in enumerate(CALLS)]
)
COVARIANCES = ("covariance", "velocity_covariance")
pytestmark = [
    pytest.mark.filterwarnings("ignore:.*probability at max_range"),
    pytest.mark.filterwarnings("ignore:arrival_time is about .*has steps of"),
]


def packed(array: FloatArray) -> Any:
    """Return the same values as a field of records without padding, as binary recordings have."""
    records = np.zeros(array.shape, dtype=[("flag", "u1"), ("value", array.dtype)])
    records["value"] = array
    return records["value"]


def prepared(call: tuple[Any, dict[str, Any]]) -> tuple[Any, dict[str, Any], dict[str, FloatArray]]:
    """Return a function, its arguments, and those that are arrays."""
    function, given = call
    if "rng" in inspect.signature(function).parameters:
        given = given | {"rng": 0}
    return function, given, {k: v for k, v in given.items() if isinstance(v, np.ndarray)}


FORMS: dict[str, Callable[[FloatArray], Any]] = {
    "packed": packed,
    "column": lambda y: pl.Series(y) if y.ndim == 1 else y,
    **LAYOUTS,
}


@every_call
def test_the_form_of_arrays_does_not_matter(call: tuple[Any, dict[str, Any]]) -> None:
    function, given, arrays = prepared(call)
    expected = function(**given) if arrays else None
    for name, array in arrays.items():
        for form in FORMS.values():
            if form is LAYOUTS["object"] and array.dtype == int:
                continue  # numbers of sensors and targets
            assert_same(function(**given | {name: form(array)}), expected)


@every_call
def test_other_numbers_are_taken_as_float64(call: tuple[Any, dict[str, Any]]) -> None:
    function, given, arrays = prepared(call)
    for name, array in arrays.items():
        if array.dtype != np.float64:
            continue
        single = array.astype(np.float32)
        expected = function(**given | {name: single.astype(np.float64)})
        for kind in (np.float32, np.longdouble, ">f8", object):
            assert_same(function(**given | {name: single.astype(kind)}), expected)


@every_call
def test_arguments_are_left_alone(call: tuple[Any, dict[str, Any]]) -> None:
    """They may be read-only, and results and inputs of other calls do not share their memory."""
    function, given, arrays = prepared(call)
    kept = {name: array.copy() for name, array in arrays.items()}
    for array in kept.values():
        array.flags.writeable = False
    result = function(**given | kept)
    for name, array in kept.items():
        np.testing.assert_array_equal(array, arrays[name])
        for field, value in fields(result).items():
            assert not isinstance(value, np.ndarray) or not np.shares_memory(value, array), field


@pytest.mark.parametrize(
    "call",
    [
        (Station, {"position": np.zeros((3, 2)), "axes": np.tile(np.eye(2), (3, 1, 1))}),
        (Radar, {"position": np.zeros(2), **dict.fromkeys(("range_sigma", "scan_period"), 9.0)}),
        (Bias, {"deviation": np.zeros(2), "deviation_covariance": np.eye(3)}),
        (Emitter, {"time": np.zeros(3), "azimuth": np.zeros((3, 2))}),
        (
            Plots,
            {name: np.zeros((3, 2)) for name in ("position", "velocity", "sensor_position")}
            | {name: np.tile(np.eye(2), (3, 1, 1)) for name in COVARIANCES}
            | {"time": np.zeros(3), "sensor_heading": np.zeros(3), "callsign": np.array(["A"] * 3)}
            | {"identity": np.zeros(3, dtype=int), "sensor": np.zeros(3, dtype=int)},
        ),
    ],
    ids=lambda call: call[0].__name__,
)
def test_objects_keep_what_they_are_made_of(call: tuple[Any, dict[str, Any]]) -> None:
    kind, arrays = call
    others = {Radar: {"azimuth_sigma": 0.1}, Bias: {"deviation_order": 1}, Emitter: {"name": "e"}}
    made = kind(**arrays, **others.get(kind, {}))
    kept = {name: getattr(made, name).copy() for name in arrays if np.ndim(arrays[name])}
    for array in arrays.values():
        if np.ndim(array):
            array[...] = "B" if array.dtype.kind == "U" else 7
    for name, value in kept.items():
        np.testing.assert_array_equal(getattr(made, name), value)


@every_call
def test_results_are_frozen(call: tuple[Any, dict[str, Any]]) -> None:
    function, given, _ = prepared(call)
    result = function(**given)
    if dataclasses.is_dataclass(result):
        assert not hasattr(result, "__dict__")
        for name, value in fields(result).items():
            with pytest.raises(dataclasses.FrozenInstanceError):
                setattr(result, name, value)
