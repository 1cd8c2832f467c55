#!/usr/bin/env python3
"""Gradients on the fly beside stored ones: time to the first picture, bytes of bricks, and a frame's time.

  gradients.py STORE [--backends cpu,gpu] [--frames 6] [--repetitions 3] [--pictures FOLDER] [-- SCENE FLAGS]

Frames of an orbit at level 0, lit, all bricks resident; the first picture is that of a process of its own, from its start. Each
repetition takes all rows in turn; medians. Run it on a quiet machine.
"""
import argparse
import json
import statistics
import sys
import tempfile
from pathlib import Path

from measuring import arguments, run

ROWS = ["none", "central", "sobel", "stored"]


def brickyard(a, command, backend, gradient):
    """What a command writes to standard output."""
    lighting = ["--lighting", "none"] if gradient == "none" else ["--lighting", "blinn-phong", "--gradient", gradient]
    command = [a.brickyard, *command, "--size", a.size, "--level", "0", "--backend", backend, "--gpu-memory", a.gpu_memory,
               *a.scene, *lighting]
    return run(command)


def measure(a, backend, gradient):
    """First picture in ms, MiB on the GPU (or what stands for it on the CPU), median frame in ms."""
    with tempfile.TemporaryDirectory() as folder:
        picture, stats = Path(a.pictures or folder) / f"{backend}-{gradient}.png", Path(folder) / "stats.json"
        brickyard(a, ["render", a.store, "--overwrite", "-o", str(picture), "--stats", str(stats)], backend, gradient)
        render = json.loads(stats.read_text())
    flight = brickyard(a, ["bench", a.store, "--scenario", "orbit", "--frames", str(a.frames), "--json"], backend, gradient)
    flight = json.loads(flight)[0]
    return render["first_image_ms"], render["gpu_bytes_peak"] / 2**20, flight["frame_ms"]["p50"]


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("store")
    ap.add_argument("--backends", type=lambda s: s.split(","), default=["cpu", "gpu"])
    ap.add_argument("--frames", type=int, default=6)
    ap.add_argument("--size", default="512x512")
    ap.add_argument("--gpu-memory", default="2GiB")
    ap.add_argument("--repetitions", type=int, default=3)
    ap.add_argument("--pictures", help="a folder for the pictures")
    ap.add_argument("--brickyard", default="target/release/brickyard")
    a = arguments(ap)
    rounds = []
    for _ in range(a.repetitions):
        rounds.append({})
        for backend in a.backends:
            for gradient in ROWS:
                rounds[-1][backend, gradient] = measure(a, backend, gradient)
                print(backend, gradient, rounds[-1][backend, gradient], file=sys.stderr, flush=True)
    print("| gradients | " + " | ".join(f"{b}: first picture, ms | bricks, MiB | frame, ms | of central" for b in a.backends) + " |")
    print("| --- |" + " --- | --- | --- | --- |" * len(a.backends))
    for gradient in ROWS:
        cells = []
        for backend in a.backends:
            first, memory, frame = (statistics.median(r[backend, gradient][i] for r in rounds) for i in range(3))
            ratio = statistics.median(r[backend, gradient][2] / r[backend, "central"][2] for r in rounds)
            cells += [f"{first:.0f}", f"{memory:.0f}", f"{frame:.0f}", f"{ratio:.2f}"]
        print(f"| {gradient} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
