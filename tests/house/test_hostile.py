"""Wrong arguments to every public function: a result, or an error of the right kind, and soon."""

import inspect
import time
from collections.abc import Iterator
from importlib import import_module
from typing import Any

import numpy as np
import pytest
from calls import CALLS
from checks import INF, NAN

MODULES = (
    "screening", "bearing", "weights", "location", "kalman", "smoothing", "trajectory", "fusion",
    "association", "flightplan", "tracker", "registration", "tertiary", "simulate",
    "metrics",
)  # fmt: skip
REFUSED = (ValueError, TypeError, np.linalg.LinAlgError)
# in seconds; on a busy machine, too
LONGEST = 10.0
ANY = (
    NAN, INF, 0.0, -1.0, 1e308, -1e308, 1e-308, 1e-160, 1e160, 2**63, 2**70, -(2**70), 2.5,
    "x", b"x", None, True, 1j, [], [1, [2, 3]], {}, object(), np.datetime64(0, "s"),
    np.zeros(0), np.zeros((2, 0)), np.ones((2, 3, 4, 5)), [NAN] * 24,
)  # fmt: skip
SIZES = (1e308, -1e308, 1e-308, 1e150, 1e-160, 0.0)


def test_every_public_function_is_called() -> None:
    modules = {import_module(f"tertia.{name}") for name in MODULES}
    public = {getattr(module, name) for module in modules for name in module.__all__}
    called = {function for function, _ in CALLS}
    assert {one for one in public if inspect.isfunction(one)} <= called


def hostile(good: Any) -> Iterator[Any]:
    """Yield what is wrong, or nearly, in place of a good argument."""
    yield from ANY
    if isinstance(good, np.ndarray) and good.dtype == float:
        for at in (0, -1):
            for bad in (NAN, INF, *SIZES):
                spoilt = good.copy()
                spoilt.flat[at] = bad
                yield spoilt
        yield from (good * size for size in (1e300, 1e-300, 1e150, 1e-150, 1e15, 0.0, -1.0))
        yield from (good[:0], good[:1], good[..., :1], good[np.newaxis], good[::-1], good + 1e12)
        yield from (good.astype(kind) for kind in (str, object, complex, bool, np.float32, int))
        yield np.ma.masked_array(good, np.arange(good.size).reshape(good.shape) % 3 == 0)
        yield np.repeat(good, 2, axis=-1)[..., ::2]
        yield np.broadcast_to(good[:1], good.shape)
        yield np.asarray([10**400, *good.ravel()[1:]], dtype=object).reshape(good.shape)
        read_only = good.copy()
        read_only.flags.writeable = False
        yield read_only
    elif isinstance(good, list) and good:
        yield from (good[0], good[:1], good * 2, [good[0], None], iter(good))
    elif isinstance(good, (int, float)) and not isinstance(good, bool):
        yield from (good * 1e300, good * 1e-300, np.float32(good), [good], np.array(good))


def parameters(function: Any, given: dict[str, Any]) -> dict[str, Any]:
    """Return the parameters of a function with good arguments, or the defaults."""
    every = inspect.signature(function).parameters.values()
    return {p.name: p.default for p in every if p.kind != p.VAR_KEYWORD} | given


def attempt(function: Any, arguments: dict[str, Any]) -> str:
    """Return what is wrong with the outcome of a call."""
    try:
        function(**arguments)
    except REFUSED as error:
        return "" if str(error) else "an error without a message"
    except BaseException as error:  # also a panic
        return repr(error)
    return ""


@pytest.mark.parametrize(
    "call", CALLS, ids=[f"{at}-{f.__qualname__}" for at, (f, _) in enumerate(CALLS)]
)
@pytest.mark.filterwarnings("ignore:.*probability at max_range")
@pytest.mark.filterwarnings("ignore:arrival_time is about .*has steps of")
@pytest.mark.filterwarnings("ignore:(all measurements|most plots) of .* contradict the other")
@pytest.mark.filterwarnings("ignore:the azimuths contradict each other at most instants")
@pytest.mark.filterwarnings("ignore:nearly all plots of radars . and . are the same")
@pytest.mark.filterwarnings("ignore:(overflow|invalid value) encountered")
def test_wrong_arguments_are_refused(call: tuple[Any, dict[str, Any]]) -> None:
    function, given = call
    function(**given)
    for name, good in parameters(function, given).items():
        for bad in hostile(good):
            begin = time.process_time()
            outcome = attempt(function, given | {name: bad})
            assert outcome == "", (name, bad)
            assert time.process_time() - begin < LONGEST, (name, bad)
