#!/usr/bin/env python3
"""Frame rates by volume size, as two of the papers give them: the table of docs/performance.md, "As the papers have it".

  frame-rates.py [--frames 8] [--repetitions 3] [--backends cpu,raycast,sorted] [--brickyard target/release/brickyard]

Synthetic CTs of 8 bits, made in target/frame-rates where they are missing, at level 0 and a step of a voxel, all bricks resident; frames of an
orbit, taken by the clock. Each repetition flies all rows in turn; the best median counts, for other work on the machine can only slow one
down. `raycast` and `sorted` are the fragment shaders of a GPU, or of what stands in for one; a row that it cannot draw is left empty, and
why is said on standard error.
"""
import argparse
import json
import os
import subprocess
import sys

OUT = "target/frame-rates"
CT = ["--transfer", "tools/synthetic-ct.json"]
# Name, volume, size of the picture, flags, and what the paper has for it.
ROWS = [
    ("128³", (128, 128, 128), "512x512", CT, "50–60"),
    ("256³", (256, 256, 256), "512x512", CT, "30–40"),
    ("512³", (512, 512, 512), "512x512", CT, "8–15"),
    ("512x512x690", (512, 512, 690), "512x512", CT, "5–10"),
    ("256³, isosurface", (256, 256, 256), "512x512", ["--mode", "isosurface", "--isovalue", "65"], ""),
    ("256³, lit fog", (256, 256, 256), "512x512", [*CT, "--lighting", "blinn-phong"], "10.2"),
    ("512x512x100, maximum projection", (512, 512, 100), "800x600", ["--mode", "mip"], "15"),
]


def store(a, shape):
    path = f"{OUT}/ct-{'x'.join(map(str, shape))}.zarr"
    if not os.path.exists(f"{path}/zarr.json"):
        os.makedirs(OUT, exist_ok=True)
        command = [a.brickyard, "synth", "ct", path, "--shape", ",".join(map(str, shape)), "--dtype", "u8", "--resume"]
        if subprocess.run(command, stderr=subprocess.DEVNULL).returncode:
            sys.exit(f"{' '.join(command)}: failed")
    return path


def flight(a, backend, path, size, flags):
    """Median frame, milliseconds; None if it fails."""
    where = ["--backend", "cpu"] if backend == "cpu" else ["--backend", "gpu", "--compositor", backend]
    command = [a.brickyard, "bench", path, "--scenario", "orbit", "--frames", str(a.frames), "--size", size, "--level", "0",
               "--gpu-memory", "1GiB", "--host-memory", "1GiB", *where, *flags, "--json"]
    process = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    if process.returncode:
        print(f"{' '.join(command)}: exit code {process.returncode}: {process.stderr}", file=sys.stderr)
        return None
    return json.loads(process.stdout)[0]["frame_ms"]["p50"]


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("--frames", type=int, default=8)
    ap.add_argument("--repetitions", type=int, default=3)
    ap.add_argument("--backends", type=lambda s: s.split(","), default=["cpu", "raycast", "sorted"])
    ap.add_argument("--brickyard", default="target/release/brickyard")
    a = ap.parse_args()
    best = {}
    for _ in range(a.repetitions):
        for name, shape, size, flags, _ in ROWS:
            path = store(a, shape)
            for backend in a.backends:
                found = flight(a, backend, path, size, flags)
                print(name, backend, found, file=sys.stderr, flush=True)
                if found is not None:
                    best[name, backend] = min(found, best.get((name, backend), found))
    print("| frames a second | " + " | ".join(a.backends) + " | the paper |")
    print("| --- |" + " --- |" * (len(a.backends) + 1))
    for name, _, size, _, paper in ROWS:
        cells = [f"{1e3 / best[name, b]:.1f}" if (name, b) in best else "" for b in a.backends]
        print(f"| {name}, {size} | " + " | ".join(cells) + f" | {paper} |")


if __name__ == "__main__":
    main()
