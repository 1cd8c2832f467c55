"""What the scripts share: the command, its arguments, and running all cases before giving up.

Every script is called with the path of the brickyard command and a folder to work in. It exits with 1 if a case fails.
"""

import json
import pathlib
import subprocess
import sys
import traceback

import numpy as np

COMMAND, FOLDER = sys.argv[1], pathlib.Path(sys.argv[2])


def brickyard(*arguments):
    """Runs the command, expects success, and returns its standard output."""
    arguments = [str(a) for a in arguments]
    done = subprocess.run([COMMAND, *arguments], capture_output=True, text=True, cwd=FOLDER)
    if done.returncode != 0:
        raise AssertionError(f"brickyard {' '.join(arguments)}: exit {done.returncode}: {done.stderr}")
    return done.stdout


def info(store):
    """What `info --json` says."""
    return json.loads(brickyard("info", store, "--json"))


def same_bits(a, b):
    """Whether two arrays are equal bit for bit, NaN included, whatever their byte order and memory order."""
    if a.shape != b.shape or a.dtype.newbyteorder("=") != b.dtype.newbyteorder("="):
        return False
    native = a.dtype.newbyteorder("=")
    return a.astype(native).tobytes() == b.astype(native).tobytes()


def noise(random, dtype, *shape):
    """Random values all over the type's range; of floats, normally distributed ones."""
    dtype = np.dtype(dtype)
    if dtype.kind == "f":
        return random.standard_normal(shape).astype(dtype)
    limits = np.iinfo(dtype)
    return random.integers(limits.min, limits.max, shape, dtype.newbyteorder("="), endpoint=True).astype(dtype)


def check(condition, *what):
    """An assertion that says what it found."""
    if not condition:
        raise AssertionError(" ".join(str(w) for w in what))


def run_cases(cases):
    """Runs {name: function}; prints every failure; exits."""
    failed = 0
    for name, case in cases.items():
        try:
            case()
        except Exception:
            failed += 1
            print(f"--- {name}\n{traceback.format_exc()}")
    print(f"{len(cases)} cases, {failed} failed")
    sys.exit(1 if failed else 0)
