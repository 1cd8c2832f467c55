#!/usr/bin/env python3
"""How fast time steps play on this machine: docs/performance.md, "Playing time steps".

  play_rates.py FOLDER [--series 128-u8,128-u16,256-u8,512-u8] [--steps 200] [--repetitions 3] [--brickyard target/release/brickyard]

Series of waves with noise are made and packed in the folder where they are missing; 200 steps of 512-u8 take 20 GB there, and as much while they are
packed. Of each, in turns: all steps at full level as fast as they come, warm and from the disk, without drawing; then a rate that is held, while the level
may fall; then, for 128-u8 and 512-u8, lit pictures of 512x512 at a rate that is held, drawn as well as there is time for. 512 MiB of host memory, 256 MiB of slots, for
512-u8 1 GiB. Medians over repetitions. Run it on a quiet machine. Needs numpy.
"""
import argparse
import json
import os
import shutil
import statistics
import sys

from measuring import run

# Edge, type, slots, the rate to hold, and the rate to hold with drawing.
SERIES = {
    "128-u8": (128, "u8", "256MiB", 50, 24),
    "128-u16": (128, "u16", "256MiB", 50, None),
    "256-u8": (256, "u8", "256MiB", 20, None),
    "512-u8": (512, "u8", "1GiB", 20, 10),
}
# Rounds of the steps in which the files of a series are made, so that they never lie there all at once.
ROUND = 20


def make(a, name):
    """A series' store: each step is the first one, rolled along z and made brighter, so that no brick comes twice."""
    import numpy as np

    edge, dtype, *_ = SERIES[name]
    store, files = (os.path.join(a.folder, f"{name}-{a.steps}{end}") for end in (".zarr", ""))
    if os.path.exists(os.path.join(store, "zarr.json")):
        return store
    z, y, x = (np.arange(edge, dtype=np.float32).reshape(shape) / edge for shape in ((edge, 1, 1), (1, edge, 1), (1, 1, edge)))
    noise = np.random.default_rng(1).integers(0, 12, (edge,) * 3, dtype=np.uint8)
    first = (80 + 70 * np.sin(9 * x) * np.cos(7 * y) * np.sin(8 * z) + noise).astype(np.uint8)
    flags = ["--shape", f"{edge},{edge},{edge}", "--dtype", dtype, "--progress", "none"]
    for begin in range(0, a.steps, ROUND):
        os.makedirs(files)
        for step in range(begin, min(begin + ROUND, a.steps)):
            voxels = np.roll(first, 7 * step, axis=0) + np.uint8(step % 40)
            wide = voxels if dtype == "u8" else voxels.astype(np.uint16) * 256 + noise
            wide.tofile(os.path.join(files, f"step_{step:04d}.raw"))
        paths = sorted(os.path.join(files, file) for file in os.listdir(files))
        run([a.brickyard, "append", store, *paths, *flags])
        shutil.rmtree(files)
    return store


def play(a, name, store, flags):
    slots = SERIES[name][2]
    command = [a.brickyard, "bench", store, "--scenario", "play", "--backend", "cpu", "--gpu-memory", slots,
               "--host-memory", "512MiB", "--steps", str(a.steps), "--json", *flags]
    report = json.loads(run(command))[0]
    if report["mixed"] or report["uncovered"]:
        sys.exit(f"{' '.join(command)}: {report['mixed']} frames of two steps, {report['uncovered']} with holes")
    print(name, *flags, f"{report['steps_per_second']:.1f}", file=sys.stderr, flush=True)
    return report


def row(name, what, reports):
    of = lambda key: statistics.median(report[key] for report in reports)  # noqa: E731
    mib = lambda key: f"{statistics.median(report['bytes_per_step'][key] for report in reports) / 2**20:.3g}"  # noqa: E731
    levels = "/".join(f"{100 * share:.0f}" for share in reports[0]["levels"])
    print(f"| {name} | {what} | {of('start_ms'):.0f} | {of('steps_per_second'):.3g} | {100 * of('quality'):.0f} | {of('late'):.0f}, {of('dropped'):.0f} | {levels} | {of('processor_ms_per_step'):.3g} | "
          f"{mib('read')}, {mib('decoded')}, {mib('uploaded')} | {reports[0]['limit']} | {max(r['anonymous_peak'] for r in reports) >> 20} |", flush=True)


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("folder")
    ap.add_argument("--series", type=lambda s: s.split(","), default=list(SERIES))
    ap.add_argument("--steps", type=int, default=200)
    ap.add_argument("--repetitions", type=int, default=3)
    ap.add_argument("--brickyard", default="target/release/brickyard")
    a = ap.parse_args()
    if unknown := [name for name in a.series if name not in SERIES]:
        ap.error(f"--series: {unknown[0]} is none of {', '.join(SERIES)}")
    print("| series | how | start, ms | steps a second | quality, % | late, passed over | cells by level, % | CPU ms a step | MiB a step: read, decoded, uploaded | limit | anonymous MiB |")
    print("|" + " --- |" * 11, flush=True)
    every = ["--no-drawing", "--policy", "every-step", "--rate", "1000", "--level", "0"]
    held = ["--policy", "hold-rate", "--rate"]
    for name in a.series:
        store, (rate, drawn) = make(a, name), SERIES[name][3:]
        ways = {"full level, warm": every, "full level, cold": [*every, "--cold"], f"{rate} a second held": ["--no-drawing", *held, str(rate)]}
        if drawn:
            lit = ["--size", "512x512", "--lighting", "phong", "--frame-goal", "80"]
            ways[f"{drawn} a second held, drawn and lit"] = [*lit, *held, str(drawn)]
        # Once for the page cache.
        play(a, name, store, every)
        reports = {way: [] for way in ways}
        for _ in range(a.repetitions):
            for way, flags in ways.items():
                reports[way].append(play(a, name, store, flags))
        for way, of_way in reports.items():
            row(name, way, of_way)


if __name__ == "__main__":
    main()
