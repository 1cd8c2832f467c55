#!/usr/bin/env python3
"""The frame rates that two of the papers tabulate, on this machine: docs/results/frame-rates.md.

  frame_rates.py [--quick] [--frames 9] [--repetitions 3] [--columns cpu,sorted,raycast,compute] [--brickyard target/release/brickyard]

Synthetic CTs of 8 bits are made under target/frame-rates where they are missing. Frames of an orbit, settled: everything at level 0,
all bricks resident, one sample a voxel. A cell is the median of its flights' median frames, as frames a second; the columns of a row are
flown in turns. Run it on a quiet machine. --quick: volumes up to 256 voxels deep, four frames, once.
"""
import argparse
import json
import os
import statistics
import sys

from measuring import run

FOLDER = "target/frame-rates"
PLAIN = ["--transfer", "tools/synthetic-ct.json"]
SURFACE_IN_FOG = [*PLAIN, "--lighting", "phong", "--isovalue", "100,opacity=0.6,color=1:0.9:0.7"]
# Voxels, picture, what is shown, and its flags.
ROWS = [
    ((128, 128, 128), "512x512", "fog", PLAIN),
    ((256, 256, 256), "512x512", "fog", PLAIN),
    ((512, 512, 512), "512x512", "fog", PLAIN),
    ((512, 512, 690), "512x512", "fog", PLAIN),
    ((256, 256, 256), "512x512", "isosurface and lit fog", SURFACE_IN_FOG),
    # The second paper's table is of rays that sample all of the volume.
    ((256, 256, 256), "512x512", "the same, without skipping", [*SURFACE_IN_FOG, "--no-skipping"]),
    ((512, 512, 100), "800x600", "maximum", ["--mode", "mip"]),
]
COLUMNS = {
    "cpu": ("CPU", ["--backend", "cpu"]),
    "sorted": ("GPU, `sorted`", ["--backend", "gpu", "--compositor", "sorted"]),
    "raycast": ("GPU, `raycast`", ["--backend", "gpu", "--compositor", "raycast"]),
    "compute": ("GPU, `compute`", ["--backend", "gpu", "--compositor", "compute"]),
}


def store(a, extent):
    name = "x".join(map(str, extent))
    path = f"{FOLDER}/ct-{name}.zarr"
    if not os.path.exists(f"{path}/zarr.json"):
        os.makedirs(FOLDER, exist_ok=True)
        shape = ",".join(map(str, extent))
        run([a.brickyard, "synth", "ct", path, "--shape", shape, "--dtype", "u8", "--progress", "none", "--resume"])
    return path


def frame_ms(a, path, size, flags):
    """Median frame of a flight whose bricks were all there."""
    command = [a.brickyard, "bench", path, "--scenario", "orbit", "--frames", str(a.frames), "--size", size, "--level", "0",
               "--gpu-memory", "2GiB", "--host-memory", "2GiB", "--json", *flags]
    report = json.loads(run(command))[0]
    if report["completeness"] < 1:
        sys.exit(f"{' '.join(command)}: expected every brick in every frame, found {report['completeness']:.3f} of them")
    return report["frame_ms"]["p50"]


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("--quick", action="store_true")
    ap.add_argument("--frames", type=int)
    ap.add_argument("--repetitions", type=int)
    ap.add_argument("--columns", type=lambda s: s.split(","), default=list(COLUMNS))
    ap.add_argument("--brickyard", default="target/release/brickyard")
    a = ap.parse_args()
    if unknown := [c for c in a.columns if c not in COLUMNS]:
        ap.error(f"--columns: {unknown[0]} is none of {', '.join(COLUMNS)}")
    a.frames = a.frames or (4 if a.quick else 9)
    a.repetitions = a.repetitions or (1 if a.quick else 3)
    rows = [row for row in ROWS if not a.quick or row[0][2] <= 256]
    print("| voxels | picture | what | " + " | ".join(COLUMNS[c][0] for c in a.columns) + " |")
    print("| --- | --- | --- |" + " --- |" * len(a.columns), flush=True)
    for extent, size, what, flags in rows:
        path = store(a, extent)
        flights = {column: [] for column in a.columns}
        for _ in range(a.repetitions):
            for column in a.columns:
                flights[column].append(frame_ms(a, path, size, [*COLUMNS[column][1], *flags]))
                print(extent, what, column, f"{flights[column][-1]:.1f} ms", file=sys.stderr, flush=True)
        cells = [f"{1000 / statistics.median(flights[column]):.3g}" for column in a.columns]
        voxels = "³" if len(set(extent)) == 1 else ""
        name = f"{extent[0]}³" if voxels else " x ".join(map(str, extent))
        print(f"| {name} | {size} | {what} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
