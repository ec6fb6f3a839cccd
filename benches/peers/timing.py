"""What the comparisons share: one thread, peers that may be missing, CPU times, growth.

Import it before NumPy: the libraries behind NumPy read the number of threads when they are loaded.
"""

import importlib
import json
import os
import time
import warnings

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault(
    "XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
)

import numpy as np

warnings.simplefilter("ignore")
ROUNDS, SECONDS = 3, 0.5
UNITS = {"ns": 1.0, "µs": 1e3, "ms": 1e6, "s": 1e9}
# what takes longer, in seconds, is measured once
SLOWEST = 0.2


def optional(module):
    """Import a peer; None where it is not installed."""
    try:
        return importlib.import_module(module)
    except ImportError:
        print(f"{module} is not installed, so it is left out")
        keep(missing=module.partition(".")[0])
        return None


def keep(**found):
    """Keep what was found for `benches/performance.py`, if that runs this."""
    if path := os.environ.get("TERTIA_BENCHES"):
        with open(path, "a", encoding="utf-8") as file:
            file.write(json.dumps(found) + "\n")


def cpu_time(call, seconds=SECONDS):
    """Least CPU time of repeated calls, in nanoseconds."""
    start = time.process_time_ns()
    call()
    once = max(time.process_time_ns() - start, 1)
    if once > SLOWEST * 1e9:
        return once
    calls = max(1, int(1e7 / once))
    best, end = np.inf, time.monotonic() + seconds
    while time.monotonic() < end:
        start = time.process_time_ns()
        for _ in range(calls):
            call()
        best = min(best, (time.process_time_ns() - start) / calls)
    return best


def least(problems, seconds=SECONDS):
    """Least nanoseconds per item of named pairs of a call and its number of items."""
    best = dict.fromkeys(problems, np.inf)
    # in turn, so that all of them see the machine both busy and quiet
    for _ in range(ROUNDS):
        for name, (call, count) in problems.items():
            best[name] = min(best[name], cpu_time(call, seconds / ROUNDS) / count)
    return best


def report(title, best, unit="ns"):
    """Print and keep nanoseconds and their ratios to the first one, which is Tertia's."""
    print(f"\n{title}")
    (_, own), *_ = best.items()
    for name, cost in best.items():
        shown = cost / UNITS[unit]
        print(f"  {name:<34}{shown:12.2f} {unit} {cost / own:10.2f} times", flush=True)
    keep(work=title, unit=unit, costs={name: cost / UNITS[unit] for name, cost in best.items()})


def report_growth(title, quantity, sizes, costs, unit="ns"):
    """Print and keep nanoseconds by size, and the exponent of their growth."""
    sizes, costs = np.asarray(sizes), np.asarray(costs)
    _, exponent = fit_growth(sizes, costs)
    # small sizes cost little more than the call
    _, last = fit_growth(sizes[-2:], costs[-2:])
    shown = [cost / UNITS[unit] for cost in costs]
    listed = ", ".join(f"{size:,}: {cost:.3g}" for size, cost in zip(sizes, shown, strict=True))
    law = f"{quantity}^{exponent:.3f}, at the end ^{last:.3f}"
    print(f"{title}: {law}; {unit} by {quantity}: {listed}", flush=True)
    keep(
        work=title,
        quantity=quantity,
        sizes=sizes.tolist(),
        costs=shown,
        unit=unit,
        exponent=exponent,
        last=last,
    )


def fit_growth(sizes, costs):
    """Return a and b of cost = a n^b."""
    exponent, intercept = np.polyfit(np.log(sizes), np.log(costs), 1)
    return np.exp(intercept), exponent
