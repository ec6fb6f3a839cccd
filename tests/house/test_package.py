"""The package as it is installed."""

import importlib
import importlib.metadata
import inspect
import subprocess
import sys
from pathlib import Path

import pytest
from places import ROOT

import tertia
from tertia import _core

MODULES = [tertia, *filter(inspect.ismodule, (getattr(tertia, name) for name in tertia.__all__))]
by_name = pytest.mark.parametrize("module", MODULES, ids=lambda module: module.__name__)


def run(code):
    result = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=True
    )
    return result.stdout


def test_the_version_is_that_of_the_distribution():
    assert tertia.__version__ == importlib.metadata.version("tertia")


def test_importing_needs_numpy_alone():
    every = "[getattr(tertia, name) for name in tertia.__all__]"
    loaded = run(f"import tertia, sys; {every}; print(*sys.modules)").split()
    assert {f"tertia.{name}" for name in tertia.__all__} & set(loaded) >= {"tertia.tracker"}
    for name in (
        "scipy",
        "matplotlib",
        "polars",
        "typer",
        "rich",
        "pandas",
        "pyarrow",
        "pyproj",
        "sklearn",
        "stonesoup",
        "numpy.random",
    ):
        assert name not in loaded


def test_importing_takes_little_longer_than_numpy():
    """CPU time in one process; modules are imported when they are asked for."""
    code = """
import time
start = time.process_time()
import numpy
between = time.process_time()
import tertia
print((time.process_time() - start) / (between - start))
"""
    assert min(float(run(code)) for _ in range(3)) <= 1.2


def test_modules_are_there_when_they_are_asked_for():
    loaded = run("import tertia, sys; print(*sys.modules)").split()
    assert "tertia.bearing" not in loaded
    assert set(tertia.__all__) <= set(dir(tertia))
    told = run("import tertia; print(tertia.estimate_bearing([1.0, 2.0, 3.0], method='mean'))")
    assert told.startswith("BearingEstimate(2 ")
    with pytest.raises(AttributeError, match="module 'tertia' has no attribute 'bearings'"):
        tertia.bearings  # noqa: B018


def test_the_version_is_in_one_place():
    """In the workspace; packages, the core and the installed package take it from there."""
    version = importlib.metadata.version("tertia")
    found = [
        path.relative_to(ROOT).as_posix()
        for pattern in ("*.toml", "*/*/Cargo.toml", "*.cff", "python/tertia/*.py")
        for path in ROOT.glob(pattern)
        if version in path.read_text(encoding="utf-8")
    ]
    assert found == ["Cargo.toml"]


def test_an_optimised_build_does_not_warn():
    assert _core.DEBUG_BUILD is False


def test_a_debug_build_warns():
    code = """
import sys, types, warnings
core = types.ModuleType("tertia._core")
core.DEBUG_BUILD, core.VERSION = True, "0"
core.__getattr__ = lambda name: None
sys.modules["tertia._core"] = core
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    import tertia
print(caught[0].category.__name__, caught[0].message)
"""
    assert run(code).startswith("RuntimeWarning tertia was built without optimisation")


def test_it_is_the_wheel_that_is_tested():
    """Not the source tree, unless somebody works on it in an environment of their own."""
    source = ROOT / "python"
    installed = Path(tertia.__file__)
    if source in installed.parents:
        pytest.skip("installed for development")
    assert (installed.parent / "py.typed").is_file()
    assert (installed.parent / "_core.pyi").is_file()


@pytest.mark.parametrize("name", ["sklearn", "stonesoup", "traffic"])
def test_what_is_for_other_libraries_is_documented(name):
    pytest.importorskip({"traffic": "traffic.core"}.get(name, name), exc_type=ImportError)
    module = importlib.import_module(f"tertia.interop.{name}")
    test_every_public_name_exists_and_is_documented(module)


@by_name
def test_every_public_name_exists_and_is_documented(module):
    assert module.__doc__
    for name in module.__all__:
        thing = getattr(module, name)
        if inspect.isclass(thing) or inspect.isroutine(thing):
            assert len(thing.__doc__) > 60, name


@by_name
def test_functions_document_what_they_take_return_and_raise(module):
    for name in module.__all__:
        thing = getattr(module, name)
        if inspect.isfunction(thing):
            for section in ("Parameters", "Returns", "Raises", "Examples"):
                assert f"{section}\n    ---" in thing.__doc__, (name, section)


def test_a_forked_child_can_use_threads_after_its_parent_did():
    code = """
import os, numpy as np, tertia
y = np.ones((200, 200)); y[:, 0] = 2
tertia.screening.leave_one_out_mask(y, n_threads=4)
if (child := os.fork()) == 0:
    tertia.screening.leave_one_out_mask(y, n_threads=4)
    os._exit(7)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""
    assert run(code).strip() == "7"


@pytest.mark.parametrize(
    "call",
    [
        "screening.leave_one_out(np.empty((10**9, 0)))",
        "screening.grubbs(np.empty((10**9, 0)))",
        "screening.leave_one_out_statistics(np.broadcast_to(1.0, (10**6, 10**6)))",
        "screening.unwrap_about_median(np.broadcast_to(1.0, (10**12,)))",
        "estimate_bearing(np.broadcast_to(1.0, (3, 10**11)))",
        "weights.jacobian(np.broadcast_to(np.eye(3), (10**9, 2, 3, 3)))",
        "weights.jacobian(np.broadcast_to(1.0, (2, 10**5, 10**5)))",
        "weights.jacobian(np.broadcast_to(1.0, (2, 3000, 3000)))",
        "weights.weight_matrices(np.zeros((2, 9000, 9000)))",
        "weights.weight_covariance(np.broadcast_to(np.eye(3), (10**9, 2, 3, 3)), 9)",
        "weights.covariance_of_covariance(np.broadcast_to(1.0, (10**3, 10**3)), 1.0)",
        "fusion.fuse_scalar([0.0], np.broadcast_to(1.0, (10**9, 1, 1)), [1.0], 1.0, 1.0)",
        "weights.fusion_loss(np.ones((2, 1, 1)), 9, trials=2**31 - 1)",
        "fusion.fuse(np.zeros((2, 3)), np.broadcast_to(np.eye(3), (10**9, 2, 3, 3)))",
        "fusion.fuse(np.zeros((2, 9000)), np.broadcast_to(1.0, (2, 9000, 9000)))",
        "fusion.fuse(np.zeros((10**5, 9)), np.broadcast_to(np.eye(9), (10**5, 9, 9)), "
        "cross_covariances=np.broadcast_to(0.0, (10**5, 10**5, 9, 9)))",
    ],
)
def test_too_large_is_an_error_and_not_an_abort(call):
    code = f"""
import resource
resource.setrlimit(resource.RLIMIT_AS, (4 * 2**30, 4 * 2**30))
import numpy as np
from tertia import estimate_bearing, fusion, screening, weights
try:
    {call}
except (MemoryError, ValueError) as error:
    print("refused", error)
"""
    assert run(code).startswith("refused")


def test_the_lock_of_the_interpreter_is_released():
    """Another thread goes on while a kernel runs."""
    code = """
import threading, time, numpy as np, tertia
y = np.random.default_rng(0).normal(size=(40, 100_000))
ticks, running = 0, True
def tick():
    global ticks
    while running:
        ticks += 1
        time.sleep(0.001)
thread = threading.Thread(target=tick); thread.start()
start = ticks
tertia.screening.bursts(y, n_threads=1)
print(ticks - start); running = False; thread.join()
"""
    assert int(run(code)) > 10
