"""Everything that the pages cite, in one run: tables of `docs/performance.md` and the README.

    python benches/performance.py              # ten minutes on two cores without other load
    python benches/performance.py --long       # twenty: growth up to the largest sizes, as the page
    python benches/performance.py --steps kalman growth    # some of it; the page is not written

Runs the comparisons with other libraries, Criterion's with the crate adskalman, pytest-benchmark's
of small calls, and the growth of the times. What is not installed is left out, and the page says
so. What fails is named, and nothing is written.
"""

import argparse
import json
import os
import platform
import re
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import tertia

BENCHES = Path(__file__).parent
TOP = BENCHES.parent
PAGE, FRONT = "performance.md", "../README.md"
sys.path.insert(0, str(TOP / "docs"))

import targets  # noqa: E402
from studies.pages import markdown, write  # noqa: E402

PEERS = ("kalman", "screening", "weights", "location", "smoothing", "association")
# enough to compare times; the page of the tracker has all encounters
SCENES = ("--clutter", "0", "50", "--radars", "1", "--aircraft", "4", "--encounters", "crossing")
TRACKERS = ("Tertia", "Stone Soup GNN", "Stone Soup JPDA", "norfair")


def steps(folder, *, long):
    """Commands by name, growth up to the largest sizes or not."""
    python = [sys.executable]
    found = {name: [*python, str(BENCHES / "peers" / f"{name}.py")] for name in PEERS}
    tracker = [*python, str(BENCHES / "peers" / "tracker.py"), *SCENES, "--trackers", *TRACKERS]
    found["tracker"] = tracker
    calls = [*python, "-m", "pytest", "-q", str(BENCHES / "test_calls.py")]
    found["calls"] = [*calls, f"--benchmark-json={folder / 'calls.json'}"]
    # without plots, which take longer than the runs
    found["criterion"] = ["cargo", "bench", "--bench", "kalman", "--", "one series", "--noplot"]
    found["growth"] = [*python, str(BENCHES / "growth.py"), *(["--long"] if long else [])]
    found["memory"] = [*python, str(BENCHES / "memory.py")]
    return found


def run(names, folder, *, long):
    """Run steps; return everything kept, and the names of those that failed."""
    kept, failed = folder / "kept.jsonl", []
    kept.touch()
    environment = os.environ | {"TERTIA_BENCHES": str(kept)}
    for name, command in steps(folder, long=long).items():
        if name not in names:
            continue
        start, cpu = time.perf_counter(), of_children()
        print(f"\n== {name}", flush=True)
        if subprocess.run(command, cwd=TOP, env=environment, check=False).returncode:
            failed.append(name)
        seconds, used = time.perf_counter() - start, of_children() - cpu
        print(f"== {name}: {seconds:.0f} s, {used:.0f} s of CPU", flush=True)
    found = [json.loads(line) for line in kept.read_text(encoding="utf-8").splitlines()]
    calls = folder / "calls.json"
    found += small_calls(calls) if calls.exists() else []
    found += one_series() if "criterion" in names else []
    return found, failed


def of_children():
    """CPU time of the steps so far, in seconds."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def small_calls(path):
    """What pytest-benchmark measured."""
    for one in json.loads(path.read_text(encoding="utf-8"))["benchmarks"]:
        costs = {"Tertia": 1e6 * one["stats"]["min"]}
        yield {"work": one["extra_info"]["work"], "unit": "µs", "costs": costs}


def one_series():
    """What Criterion measured of a series, beside adskalman."""
    target = Path(os.environ.get("CARGO_TARGET_DIR", TOP / "target"))
    costs = {}
    for path in sorted(target.glob("criterion/kalman, one series/*/new")):
        about = json.loads((path / "benchmark.json").read_text(encoding="utf-8"))
        nanoseconds = json.loads((path / "estimates.json").read_text(encoding="utf-8"))
        name, count = about["function_id"], about["throughput"]["Elements"]
        costs[name] = nanoseconds["median"]["point_estimate"] / count
    if costs:
        own = {"Tertia": costs.pop("Tertia")}
        work = "filter in Rust, 1 × 10,000, equal noise, all states, a step"
        yield {"work": work, "unit": "ns", "costs": own | costs}


def label(work):
    """Return the name of a row of a table: what a figure is for is said at its end."""
    work = re.sub(r", an? (\w+)$", r", per \1", work)
    work = re.sub(
        r"crossing, (\d+) false plots a scan, (\d+) radar\(s\), \d+ runs",
        r"crossing aircraft, \1 false plots per scan, \2 radar",
        work,
    )
    return work.replace("a filter that is fed plot by plot", "a filter called plot by plot")


def comparison(found):
    """The one table: Tertia, then the others, the fastest first; bold: faster than Tertia."""
    rows = []
    for one in found:
        if "exponent" in one or "costs" not in one:
            continue
        own = one["costs"]["Tertia"]
        others = {name: cost for name, cost in one["costs"].items() if name != "Tertia"}
        # what is in brackets or Tertia's is no other library
        listed = [cell(name, cost, own) for name, cost in sorted(others.items(), key=by_cost)]
        unit = one["unit"]
        rows.append([label(one["work"]), f"{number(own)} {unit}", "; ".join(listed) or "–"])
    return markdown(["work", "Tertia", "others"], rows)


# rows of the front page, and the most libraries in each
HEADLINES = {
    "filter, 1,000 × 200, equal noise, all states, a step": (
        "three-state filter, 1000 tracks of 200 plots, all states kept, per step"
    ),
    "locate, 4 stations in space, least-squares, 0% faults, an instant": (
        "position by least squares, sigmas as stated, per instant"
    ),
    "tracker, 4 crossing, 50 false plots a scan, 1 radar(s), 1 runs, a scan": (
        "tracking, one scan of four aircraft and fifty false plots"
    ),
}
MOST = 5


def headlines(found):
    """A few rows of the comparison, with the fastest other libraries."""
    rows = []
    for one in found:
        if one.get("work") not in HEADLINES or "costs" not in one:
            continue
        own, unit = one["costs"]["Tertia"], one["unit"]
        others = [item for item in one["costs"].items() if not by_cost(item)[0]]
        others = sorted(others, key=by_cost)[:MOST]
        listed = "; ".join(cell(name, cost, own) for name, cost in others)
        rows.append([HEADLINES[one["work"]], f"{number(own)} {unit}", listed])
    return markdown(["", "Tertia", "others"], rows)


def by_cost(item):
    name, cost = item
    return name.startswith(("(", "Tertia")), cost


def cell(name, cost, own):
    faster = cost < own and not name.startswith(("(", "Tertia"))
    return f"**{name} {number(cost)}**" if faster else f"{name} {number(cost)}"


def number(value):
    """Two digits."""
    if value >= 100:
        return f"{float(f'{value:.2g}'):,.0f}"
    return f"{value:#.2g}".rstrip(".")


def growth(found):
    rows = []
    for one in found:
        if "exponent" in one:
            pairs = zip(one["sizes"], one["costs"], strict=True)
            each = ", ".join(f"{n:,}".removesuffix(".0") + f": {number(cost)}" for n, cost in pairs)
            law = f"{one['quantity']}^{one['exponent']:.2f}"
            rows.append([label(one["work"]), law, f"{one['last']:.2f}", f"{each} {one['unit']}"])
    return markdown(["work", "time grows as", "last two", "times at these sizes"], rows)


def memory(found):
    of = [one for one in found if "memory" in one]
    rows = [[one["memory"], one.get("note") or f"{one['peak']:.0f} MB"] for one in of]
    return markdown(["work", "peak memory of the process"], rows)


def wanted(found):
    """Version 0.1, the targets, and what was measured; in bold what is reached."""
    head = ["work", "version 0.1", "target", "now", "limiting factor"]
    rows = [[label(work), *rest] for work, *rest in targets.rows(found, processor()[1], number)]
    return markdown(head, rows)


def processor():
    """Name and largest vectors of the processor."""
    try:
        info = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        info = ""
    model = re.search(r"model name\s*: (.*)", info)
    flags = set(info.split())
    levels = {"avx512f": "AVX-512", "avx2": "AVX2"}
    level = next((name for flag, name in levels.items() if flag in flags), "SSE2")
    return model[1] if model else platform.machine(), level


def machine(found):
    """What the tables were made on, and what was not there."""
    cores = f"{os.cpu_count()} cores of {', '.join(processor())}"
    absent = sorted({one["missing"] for one in found if "missing" in one})
    left_out = f" Not installed, and left out: {', '.join(absent)}." if absent else ""
    return f"Version {tertia.__version__}, {time.strftime('%d %B %Y')}, {cores}.{left_out}\n"


TABLES = {
    (PAGE, "machine"): machine,
    (PAGE, "comparison"): comparison,
    (PAGE, "wanted"): wanted,
    (PAGE, "growth"): growth,
    (PAGE, "memory"): memory,
    (FRONT, "speed"): headlines,
}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    with tempfile.TemporaryDirectory() as folder:
        every = list(steps(Path(folder), long=False))
        parser.add_argument("--steps", nargs="+", choices=every, default=every)
        parser.add_argument("--long", action="store_true", help="growth up to the largest sizes")
        options = parser.parse_args()
        chosen = options.steps
        found, failed = run(chosen, Path(folder), long=options.long)
    for (page, name), table in TABLES.items():
        text = table(found)
        print(f"\n{text}", end="")
        if chosen == every and not failed:
            write(page, name, text)
    if failed:
        sys.exit(f"failed: {', '.join(failed)}; the pages are as they were")


if __name__ == "__main__":
    main()
