"""Instructions of kernels, which do not depend on the load of the machine.

    python benches/instructions.py            # compare with benches/instructions.txt
    python benches/instructions.py --record   # write that file

Callgrind counts what `benches/instructions.rs` executes. The count of a kernel is the difference
between three runs and one, so it includes no start and no first touch of memory. Callgrind knows
AVX2 but not AVX-512: the kernels take their AVX2 form on every processor that has it, and nothing
is counted on others. The comparison fails where a kernel needs 10 % more than recorded. Another
compiler or C library may also change counts; where the change is right, record them again.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

TOP = Path(__file__).parents[1]
RECORDED = Path(__file__).with_suffix(".txt")
MOST = 1.10
MORE, FEWER = 3, 1


def missing():
    """What is missing to count, if anything."""
    if not shutil.which("valgrind"):
        return "valgrind is not installed"
    try:
        flags = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        flags = ""
    return None if re.search(r"\bavx2\b", flags) else "the processor has no AVX2"


def build():
    subprocess.run(
        [
            "cargo",
            "build",
            "--quiet",
            "--release",
            "--package",
            "tertia-python",
            "--example",
            "instructions",
        ],
        cwd=TOP,
        check=True,
    )
    return Path(os.environ.get("CARGO_TARGET_DIR", TOP / "target"), "release/examples/instructions")


def total(program, kernel, times):
    command = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null"]
    done = subprocess.run(
        [*command, str(program), kernel, str(times)], capture_output=True, text=True, check=False
    )
    found = re.search(r"Collected : (\d+)", done.stderr)
    if done.returncode or not found:
        sys.exit(f"{kernel}: {done.stderr}")
    return int(found[1])


def count(program, kernel):
    more, fewer = (total(program, kernel, times) for times in (MORE, FEWER))
    return round((more - fewer) / (MORE - FEWER))


def counts():
    """Instructions of every kernel."""
    program = build()
    names = subprocess.run([program], capture_output=True, text=True, check=True).stdout.split("\n")
    kernels = list(filter(None, names))
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return dict(zip(kernels, pool.map(partial(count, program), kernels), strict=True))


def recorded():
    lines = RECORDED.read_text(encoding="utf-8").splitlines()
    cells = (line.rsplit(maxsplit=1) for line in lines)
    return {name: int(number.replace(",", "")) for name, number in cells}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--record", action="store_true", help=f"write {RECORDED.name}")
    options = parser.parse_args()
    if reason := missing():
        print(f"instructions are not counted: {reason}")
        return 1 if options.record else 0
    found = counts()
    if options.record:
        lines = [f"{name:20}{number:>14,}\n" for name, number in found.items()]
        RECORDED.write_text("".join(lines), encoding="utf-8")
        return 0
    before = recorded()
    if found.keys() != before.keys():
        sys.exit(f"{RECORDED.name} has other kernels: record it again")
    grown = [name for name in found if found[name] > MOST * before[name]]
    for name, number in found.items():
        mark = "  more than a tenth above what is recorded" if name in grown else ""
        print(f"{name:20}{number:>14,}{number / before[name] - 1:+8.1%}{mark}")
    return 1 if grown else 0


if __name__ == "__main__":
    sys.exit(main())
