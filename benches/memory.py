"""Peak memory of `locate`, `smooth` and `track`, as multiples of their input and of their results.

Each runs in a process of its own. The peak is what the process grows by during the call, from the
memory before it; the input are the measurements, the results all arrays of what is returned.
"""

import resource
import subprocess
import sys
from dataclasses import fields, is_dataclass
from pathlib import Path

sys.path.append(str(Path(__file__).parent / "peers"))

from timing import keep

# isort: split
import numpy as np
from growth import measurements
from tracker_throughput import COLUMNS, recording, stations

from tertia.location import locate
from tertia.smoothing import smooth
from tertia.tracker import track


def located():
    """A million instants of five stations with ranges and azimuths."""
    places, _, measured = measurements(5, 1_000_000, 0.0)
    return measured.values(), lambda: locate(places, **measured, n_threads=1)


def smoothed():
    """Fifty tracks in the plane with 4,000 plots each."""
    y = np.random.default_rng(1).standard_normal((50, 4_000, 2))
    return [y], lambda: smooth(y, 1.0, jerk=0.01, n_threads=1)


def tracked():
    """5,000 aircraft and four radars."""
    plots, radars = recording(5_000, 48.0, 0.1), stations(5_000)
    columns = [getattr(plots, name) for name in COLUMNS]
    return columns, lambda: track(plots, radars, n_threads=1)


WORK = {
    "locate, 1,000,000 instants": located,
    "smooth, 50 × 4,000 plots in the plane": smoothed,
    "track, 5,000 aircraft, 4 radars": tracked,
}


def size(found):
    """Bytes of the arrays in a result."""
    if isinstance(found, np.ndarray):
        return found.nbytes
    if is_dataclass(found):
        # what begins with an underscore is kept for later questions, but kept
        return sum(size(getattr(found, field.name)) for field in fields(found))
    return 0


def resident():
    """Memory of the process now, in bytes."""
    pages = int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[1])
    return pages * resource.getpagesize()


def measure(name):
    """Print megabytes of the input, and the multiples of it."""
    arrays, call = WORK[name]()
    given = sum(array.nbytes for array in arrays)
    # the peak so far, of making the input, must not hide that of the call
    Path("/proc/self/clear_refs").write_text("5", encoding="utf-8")
    before = resident()
    found = call()
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    peak = next(1024 * int(line.split()[1]) for line in status.split("\n") if "VmHWM" in line)
    print(given / 2**20, (peak - before) / given, size(found) / given)


def main():
    if len(sys.argv) > 1:
        return measure(sys.argv[1])
    for name in WORK:
        command = [sys.executable, __file__, name]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        given, peak, results = map(float, done.stdout.split())
        print(f"{name}: {given:.0f} MB, peak {peak:.1f} ×, results {results:.1f} ×", flush=True)
        note = f"{peak:.1f} × the input of {given:.0f} MB; results are {results:.1f} ×"
        keep(memory=name, note=note)
    return None


if __name__ == "__main__":
    main()
