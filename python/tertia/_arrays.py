"""Conversion and checks of the arguments and results of public functions."""

from __future__ import annotations

import operator
import sys
from collections.abc import Iterable, Sequence
from typing import Any, Literal, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._moments import are_moments, seconds

FloatArray: TypeAlias = npt.NDArray[np.float64]
BoolArray: TypeAlias = npt.NDArray[np.bool_]
IntArray: TypeAlias = npt.NDArray[np.int64]
NanPolicy: TypeAlias = Literal["raise", "omit"]
# what a sigma says of systematic errors: their sigma was given, estimated, or is not part of it
Systematic: TypeAlias = Literal["given", "estimated", "not included"]

_T = TypeVar("_T")
_ARRAY = np.ndarray
# standard deviation of an angle of which nothing is known
_UNIFORM_SIGMA = np.pi / np.sqrt(3.0)
# the square of what is larger is not a number in double precision
LARGEST = 1e150
# smallest positive number, and largest number
SMALLEST, _MOST = 5e-324, sys.float_info.max
_FLOAT64 = np.dtype(np.float64)


def samples(value: npt.ArrayLike, name: str) -> FloatArray:
    """Return `value` as float64 numbers; masked values, None and pandas' NA become nan.

    A `time` may also consist of datetimes or ISO 8601 text, which become seconds since 1970, or of
    durations or times of day, which become their seconds.
    """
    if type(value) is _ARRAY and value.dtype is _FLOAT64 and value.flags.aligned:
        return value
    if type(value) is float:
        return np.array(value)
    if isinstance(value, np.ma.MaskedArray):
        value = _filled(value)
    array = array_of(value, name)
    if name == "time" and are_moments(array):
        return seconds(array, name)
    if array.dtype.kind not in "iufO":
        raise TypeError(f"{name} has dtype {array.dtype}; it must hold real numbers")
    if array.dtype.kind == "O":
        array = without_na(array)
        _refuse_objects(array, name)
    return np.asarray(array, dtype=np.float64)


def _filled(array: np.ma.MaskedArray[Any, Any]) -> npt.NDArray[Any]:
    """Return an array in which masked numbers are nan, and masked datetimes are not a time."""
    if array.dtype.kind in "iuf":
        return np.ma.filled(array.astype(np.float64), np.nan)
    found = np.array(array.data)
    if array.dtype.kind in "MmO":
        # masked datetimes become NaT
        found[np.ma.getmaskarray(array)] = None
    return found


def array_of(value: npt.ArrayLike, name: str) -> npt.NDArray[Any]:
    """Return `value` as an array of any type.

    A field of packed records is copied: its numbers are not a whole number of their sizes apart,
    and the core cannot read them.
    """
    try:
        array = np.asarray(value)
    except ValueError:
        raise ValueError(
            f"{name} is ragged; all its rows must have the same number of measurements"
        ) from None
    return array if array.flags.aligned else array.copy()


def without_na(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the objects; pandas' NA, which nullable columns contain, is replaced by None."""
    pandas = sys.modules.get("pandas")
    if pandas is None:
        return array
    found: npt.NDArray[Any] = array.copy()
    is_na = np.frompyfunc(lambda item: item is pandas.NA, 1, 1)
    found[np.asarray(is_na(array), dtype=bool)] = None
    return found


def _refuse_objects(array: npt.NDArray[Any], name: str) -> None:
    """Raise an error at the first object that is neither a real number nor None."""
    for index, item in np.ndenumerate(array):
        if isinstance(item, (bool, np.bool_)):
            raise TypeError(f"{place_of(name, index)} is {item}; it must be a real number")
        if item is not None:
            real(item, place_of(name, index))


def finite(value: npt.ArrayLike, name: str) -> FloatArray:
    """Return `value` as float64 numbers, all of them finite."""
    array = samples(value, name)
    require_between(array, name, "a finite number")
    return array


def positive(value: npt.ArrayLike, name: str) -> FloatArray:
    """Return `value` as float64 numbers, all of them finite and positive."""
    array = samples(value, name)
    if not lies_between(array, SMALLEST):
        require_between(array, name, "a finite number")
        require_between(array, name, "a positive number", SMALLEST)
    return array


def instants_of(time: npt.ArrayLike) -> FloatArray:
    """Return times of shape (N,), after checking that there are some and that none decreases."""
    instants = finite(time, "time")
    if instants.ndim != 1 or instants.size == 0:
        raise ValueError(f"time has shape {instants.shape}; it must be (N,), N at least 1")
    back = np.flatnonzero(np.diff(instants) < 0)
    if back.size:
        raise ValueError(f"time[{back[0] + 1}] is before the previous time; time must not decrease")
    return instants


def squarable(value: npt.ArrayLike, name: str) -> FloatArray:
    """Return `value` as float64 numbers whose squares do not overflow; nan is kept."""
    array = samples(value, name)
    requirement = f"between -{LARGEST:g} and {LARGEST:g}"
    require_between(array, name, requirement, -LARGEST, LARGEST, missing=True)
    return array


def points(value: npt.ArrayLike, name: str) -> FloatArray:
    """Return `value` as finite positions in a plane or in space."""
    array = finite(value, name)
    if array.ndim != 2 or array.shape[-1] not in (2, 3):
        raise ValueError(f"{name} has shape {array.shape}; it must be (N, 2) or (N, 3)")
    return array


def lies_between(
    array: FloatArray, least: float, most: float = _MOST, *, missing: bool = False
) -> bool:
    """Return whether all numbers lie between the limits; with `missing`, nan is also allowed."""
    return _core.first_outside(np.asarray(array), least, most, missing) is None


def require_between(
    array: FloatArray,
    name: str,
    requirement: str,
    least: float = -_MOST,
    most: float = _MOST,
    *,
    missing: bool = False,
) -> None:
    """Raise an error that names the first number outside the limits; `missing` allows nan."""
    first = _core.first_outside(np.asarray(array), least, most, missing)
    if first is not None:
        index = tuple(map(int, np.unravel_index(first, array.shape)))
        raise ValueError(f"{place_of(name, index)} is {array[index]}; it must be {requirement}")


def require_each(array: FloatArray, holds: BoolArray, name: str, requirement: str) -> None:
    """Raise an error that names the first number for which the requirement does not hold."""
    if holds.all():
        return
    index = tuple(np.argwhere(~holds)[0])
    raise ValueError(f"{place_of(name, index)} is {array[index]}; it must be {requirement}")


def radians(
    value: npt.ArrayLike, name: str, *, degrees: bool = False, is_sigma: bool = False
) -> FloatArray:
    """Return angles in radians; keep nan, and refuse values that cannot be radians.

    In modules with geometry (`sensors`, `location`, `trajectory`, `tracker`, `geo`, `simulate`),
    angles are in radians, and azimuths are clockwise from north. `degrees=True` converts the angles
    given in that call; stored and returned angles are in radians. Series of angles (`bearing`,
    `screening`, `kalman`, `smoothing`, `fusion`) are in the unit of their `period`. Only latitudes,
    longitudes and columns named `*_deg` are always in degrees.

    If an azimuth exceeds two turns, it is nearly always in degrees, and `degrees=True` is missing.
    The same is true of a sigma above pi/sqrt(3), which is the standard deviation of a uniformly
    distributed direction. Without this check, such values would give a wrong position and no error.
    """
    array = samples(value, name)
    if degrees:
        array = np.radians(array)
    most = _UNIFORM_SIGMA if is_sigma else 4 * np.pi
    if lies_between(array, -most, most, missing=True):
        return array
    bad = np.abs(array) > most
    if bad.any() and (bad := bad & np.isfinite(array)).any():
        index = tuple(np.argwhere(bad)[0])
        given = np.degrees(array[index]) if degrees else array[index]
        if degrees:
            limit = f"at most {np.degrees(most):.4g} degrees"
        else:
            limit = f"at most {f'{most:.4g}' if is_sigma else '4 pi'}; are these degrees? pass "
            limit += "degrees=True"
        raise ValueError(f"{place_of(name, index)} is {given}; it must be {limit}")
    return array


def flag(value: Any, name: str) -> bool:
    """Return `value` as a bool."""
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{name} is {value!r}; it must be True or False")
    return bool(value)


def place_of(name: str, index: Iterable[int]) -> str:
    """Return the name of an element of an array."""
    index = tuple(index)
    return f"{name}[{', '.join(map(str, index))}]" if index else name


def integer(value: Any, name: str, minimum: int) -> int:
    """Return `value` as an int within the range that the core accepts."""
    try:
        number = operator.index(value)
    except TypeError:
        raise TypeError(f"{name} is {value!r}; it must be an integer") from None
    if not minimum <= number < 2**31:
        raise ValueError(f"{name} is {number}; it must be between {minimum} and {2**31 - 1}")
    return number


def real(value: Any, name: str) -> float:
    """Return `value` as a float."""
    if type(value) is float:
        return value
    try:
        if not isinstance(value, (str, bytes)):
            return float(value)
    except (TypeError, ValueError, OverflowError):
        pass
    raise TypeError(f"{name} is {value!r}; it must be a real number")


def positive_number(value: Any, name: str) -> float:
    """Return `value` as a float, finite and positive."""
    return float(positive(real(value, name), name))


def probability(value: Any, name: str) -> float:
    """Return `value` as a float between 0 and 1."""
    number = real(value, name)
    if not 0.0 < number < 1.0:
        raise ValueError(f"{name} is {number}; it must be between 0 and 1")
    return number


def not_negative(value: Any, name: str) -> float:
    """Return `value` as a float, finite and not negative."""
    number = real(value, name)
    if not 0.0 <= number < np.inf:
        raise ValueError(f"{name} is {number}; it must be 0 or positive, and finite")
    return number


def choice(value: Any, name: str, allowed: Iterable[str]) -> None:
    """Raise an error unless `value` is one of these texts."""
    *others, last = allowed
    if not isinstance(value, str) or value not in {*others, last}:
        named = ", ".join(map(repr, others))
        raise ValueError(f"{name} is {value!r}; it must be {named} or {last!r}")


def instance(value: Any, name: str, *kinds: type) -> None:
    """Raise an error unless `value` is of one of these types."""
    if not isinstance(value, kinds):
        names = " or a ".join(kind.__name__ for kind in kinds)
        raise TypeError(f"{name} is {value!r}; it must be a {names}")


def sequence_of(values: Any, kind: type[_T], name: str) -> tuple[_T, ...]:
    """Return a sequence as a tuple, after checking the types of its elements."""
    if not isinstance(values, Sequence):
        raise TypeError(f"{name} is {values!r}; it must be a sequence of {kind.__name__}")
    for i, value in enumerate(values):
        if not isinstance(value, kind):
            instance(value, f"{name}[{i}]", kind)
    return tuple(values)


def listed(values: Any, name: str) -> list[Any]:
    """Return the elements of a sequence as a list."""
    try:
        return list(values)
    except TypeError:
        raise TypeError(f"{name} is {values!r}; it must be a sequence") from None


def threads(n_threads: int | None) -> int | None:
    """Return the requested number of threads, after checking it."""
    return None if n_threads is None else integer(n_threads, "n_threads", 1)


def omits(nan_policy: NanPolicy) -> bool:
    """Return whether this `nan_policy` gives nan the meaning 'no measurement'."""
    choice(nan_policy, "nan_policy", ("raise", "omit"))
    return nan_policy == "omit"


def spread(array: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """Return `array`, broadcast to `shape` if it has another shape."""
    return array if array.shape == shape else np.broadcast_to(array, shape)


def common_batch(**shapes: tuple[int, ...]) -> tuple[int, ...]:
    """Return the shape to which the leading axes are broadcast."""
    try:
        return np.broadcast_shapes(*shapes.values())
    except ValueError:
        listed = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
        raise ValueError(f"the batches do not fit together: {listed}") from None


def diagonal(matrix: npt.NDArray[Any]) -> FloatArray:
    """Return the diagonals of matrices, of shape (..., m)."""
    return np.diagonal(matrix, axis1=-2, axis2=-1)


def scalar_or_array(array: npt.NDArray[Any]) -> Any:
    """Return a Python scalar if there is no batch, and the array otherwise."""
    return array if array.ndim else array.item()


def generator(rng: Any) -> np.random.Generator:
    """Return the random generator that `rng` is, or of which it is the seed."""
    try:
        return np.random.default_rng(rng)
    except (TypeError, ValueError) as error:
        kind = type(error)
        raise kind(
            f"rng is {rng!r}; it must be a Generator or a whole number, not negative"
        ) from None
