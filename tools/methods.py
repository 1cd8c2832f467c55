#!/usr/bin/env python3
"""What each way to sample and to light costs, beside the plain one at the same step.

  methods.py STORE [--backends cpu,gpu] [--frames 6] [--repetitions 3] [-- SCENE FLAGS]

Frames of an orbit at level 0, all bricks resident: processor time per frame is not told apart from that of others, so frames are
taken by the clock; run it on a quiet machine. Each repetition flies all rows in turn; of a row's ratios to the plain one, the median.
"""
import argparse
import json
import statistics
import sys

from measuring import arguments, run

ROWS = [
    ("udvr", []),
    *[(method, ["--method", method]) for method in ("pdvr", "lvs", "cvs", "asm", "plvs", "pcvs")],
    ("udvr, tricubic", ["--filter", "tricubic"]),
    ("udvr, lit, central", ["--lighting", "blinn-phong"]),
    ("udvr, lit, Sobel", ["--lighting", "blinn-phong", "--gradient", "sobel"]),
    ("udvr, lit, stored", ["--lighting", "blinn-phong", "--gradient", "stored"]),
    ("udvr, lit, one placed light", ["--lighting", "phong", "--light", "1000,1000,1000"]),
    *[(f"{method}, lit, central", ["--method", method, "--lighting", "blinn-phong"]) for method in ("lvs", "asm", "plvs", "pcvs")],
    ("pcvs, tricubic, lit, central", ["--method", "pcvs", "--filter", "tricubic", "--lighting", "blinn-phong"]),
]


def flight(a, backend, flags):
    """Median frame, milliseconds."""
    command = [a.brickyard, "bench", a.store, "--scenario", "orbit", "--frames", str(a.frames), "--size", a.size, "--level", "0",
               "--backend", backend, "--json", *a.scene, *flags]
    return json.loads(run(command))[0]["frame_ms"]["p50"]


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("store")
    ap.add_argument("--backends", type=lambda s: s.split(","), default=["cpu", "gpu"])
    ap.add_argument("--frames", type=int, default=6)
    ap.add_argument("--size", default="512x512")
    ap.add_argument("--repetitions", type=int, default=3)
    ap.add_argument("--brickyard", default="target/release/brickyard")
    a = arguments(ap)
    rounds = []
    for _ in range(a.repetitions):
        rounds.append({})
        for backend in a.backends:
            for name, flags in ROWS:
                rounds[-1][backend, name] = flight(a, backend, flags)
                print(backend, name, rounds[-1][backend, name], file=sys.stderr, flush=True)
    print("| method | " + " | ".join(f"{b}, ms | of udvr" for b in a.backends) + " |")
    print("| --- |" + " --- | --- |" * len(a.backends))
    for name, _ in ROWS:
        cells = []
        for backend in a.backends:
            own = statistics.median(r[backend, name] for r in rounds)
            ratio = statistics.median(r[backend, name] / r[backend, "udvr"] for r in rounds)
            cells += [f"{own:.0f}", f"{ratio:.2f}"]
        print(f"| {name} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
