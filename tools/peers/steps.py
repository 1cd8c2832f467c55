#!/usr/bin/env python3
"""Time steps beside VTK.

  steps.py FOLDER [--sizes 128,256] [--steps 60] [--lit] [--repetitions 3]

The same series of 8-bit volumes stepped through, one picture of 512x512 a step, by VTK (a raw file is read, given to the fixed-point mapper or to the GPU mapper
on Mesa's software OpenGL, and drawn) and by brickyard (`bench --scenario play --policy every-step` of a store, at level 0 and with the level that the view
wants), with the same camera, transfer function and step. Every volume is wholly new: what stays the same from step to step would favour brickyard. The
page cache is warm. Each runs in a process of its own, in turn; CPU ms: processor time of all threads for a step, start-up excluded. Medians over
repetitions; ratios are to VTK's mapper of the same kind, within each repetition. Files are made in the folder where they are missing.
"""
import argparse
import importlib.util
import json
import os
import statistics
import subprocess
import sys
import time

_spec = importlib.util.spec_from_file_location("still", os.path.join(os.path.dirname(os.path.abspath(__file__)), "vtk.py"))
still = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(still)

VTK = ("VTK fixed-point", "VTK GPU")
BRICKYARD = {
    "brickyard cpu, level 0": ("VTK fixed-point", ["--backend", "cpu", "--level", "0"]),
    "brickyard cpu, level auto": ("VTK fixed-point", ["--backend", "cpu", "--level", "auto"]),
    "brickyard gpu, level 0": ("VTK GPU", ["--backend", "gpu", "--level", "0"]),
}


def step_file(a, n, step):
    return os.path.join(a.folder, f"steps-{n}", f"step_{step:04d}.raw")


def make_steps(a, n):
    import numpy as np

    if all(os.path.exists(step_file(a, n, step)) for step in range(a.steps)):
        return
    os.makedirs(os.path.dirname(step_file(a, n, 0)), exist_ok=True)
    z, y, x = np.mgrid[0:n, 0:n, 0:n].astype(np.float32) / n
    noise = np.random.default_rng(1).integers(0, 12, (n, n, n)).astype(np.float32)
    for step in range(a.steps):
        turn = 2 * np.pi * step / a.steps
        waves = 80 + 70 * np.sin(9 * x + turn) * np.cos(7 * y - 2 * turn) * np.sin(8 * z + turn)
        (waves + np.roll(noise, step)).astype(np.uint8).tofile(step_file(a, n, step))


def store_of(a, n):
    store = os.path.join(a.folder, f"steps-{n}-{a.steps}.zarr")
    if not os.path.exists(store):
        spacing, origin = (",".join([str(v)] * 3) for v in (1 / n, 0.5 / n))
        still.output_of([a.brickyard, "pack", os.path.join(a.folder, f"steps-{n}", "step_%04d.raw"), store, "--shape", f"{n},{n},{n}", "--dtype", "u8",
                         "--spacing", spacing, "--origin", origin, "--progress", "none"])
    return store


def worker(a):
    """VTK, in a process of its own: prints one line of JSON."""
    os.environ["VTK_DEFAULT_OPENGL_WINDOW"] = "vtkOSOpenGLRenderWindow"
    del sys.path[0]
    import vtk

    n = a.sizes[0]
    reader = vtk.vtkImageReader2()
    reader.SetFileDimensionality(3)
    reader.SetDataExtent(0, n - 1, 0, n - 1, 0, n - 1)
    reader.SetDataScalarTypeToUnsignedChar()
    reader.SetDataSpacing(1 / n, 1 / n, 1 / n)
    reader.SetDataOrigin(0.5 / n, 0.5 / n, 0.5 / n)
    reader.FileLowerLeftOn()
    look = still.look_of(vtk, still.COLOR, still.OPACITY)
    look.SetShade(a.lit)
    mapper = still.mapper_of(vtk, a.worker, n)
    mapper.SetInputConnection(reader.GetOutputPort())
    renderer, window = still.scene_of(vtk, mapper, look)

    def draw(step):
        reader.SetFileName(step_file(a, n, step))
        reader.Modified()
        still.draw(renderer, window, 0)

    draw(0)
    cpu, wall = time.process_time(), time.perf_counter()
    for step in range(1, a.steps):
        draw(step)
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    print(json.dumps(dict(cpu_ms=cpu * 1e3 / (a.steps - 1), steps_per_s=(a.steps - 1) / wall)), flush=True)
    # VTK's own clean-up can crash without a display.
    os._exit(0)


def brickyard(a, n, name):
    points = os.path.join(a.folder, "steps.json")
    with open(points, "w") as file:
        json.dump(dict(color=still.COLOR, opacity=still.OPACITY, unit_distance=still.UNIT_DISTANCE), file)
    vector = lambda v: ",".join(map(repr, v))
    scene = [store_of(a, n), "--eye", vector(still.eye(0)), "--target", vector(still.CENTRE), "--up", vector(still.UP), "--fov", str(still.FOV),
             "--transfer", points, "--size", f"{still.PX}x{still.PX}", "--scenario", "play", "--policy", "every-step", "--rate", "1000",
             "--steps", str(a.steps), "--frame-goal", "100000", "--json"] + (["--lit"] if a.lit else []) + BRICKYARD[name][1]
    report = json.loads(still.output_of([a.brickyard, "bench", *scene])[0])[0]
    return dict(cpu_ms=report["processor_ms_per_step"], steps_per_s=report["steps_per_second"], quality=report["quality"])


def measure(a, n, name):
    if name in BRICKYARD:
        return brickyard(a, n, name)
    own = [sys.executable, os.path.abspath(__file__), a.folder, "--sizes", str(n), "--steps", str(a.steps), "--worker", name]
    process = subprocess.run(own + (["--lit"] if a.lit else []), stdout=subprocess.PIPE, text=True)
    if process.returncode:
        print(f"{name} at {n}³: ended with {process.returncode}", file=sys.stderr)
        return dict(cpu_ms=float("nan"), steps_per_s=float("nan"))
    return json.loads(process.stdout.splitlines()[-1])


def compare(a):
    print("| volume | program | CPU ms a step | of VTK's | steps/s | quality |")
    print("| --- | --- | --- | --- | --- | --- |")
    for n in a.sizes:
        make_steps(a, n)
        names = [name for name in (*VTK, *BRICKYARD) if name not in a.without]
        rounds = []
        for _ in range(a.repetitions):
            rounds.append({name: measure(a, n, name) for name in names})
            print(n, rounds[-1], "load", os.getloadavg()[0], file=sys.stderr, flush=True)
        for name in names:
            median = lambda value: statistics.median(value(r) for r in rounds)
            peer = BRICKYARD[name][0] if name in BRICKYARD else None
            ratio = f"{median(lambda r: r[name]['cpu_ms'] / r[peer]['cpu_ms']):.2f}" if peer in names else ""
            quality = f"{median(lambda r: r[name]['quality']) * 100:.0f} %" if name in BRICKYARD else ""
            print(f"| {n}³ | {name} | {median(lambda r: r[name]['cpu_ms']):.0f} | {ratio} | {median(lambda r: r[name]['steps_per_s']):.1f} | {quality} |", flush=True)


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("folder", type=os.path.abspath)
    ap.add_argument("--sizes", type=lambda s: [int(n) for n in s.split(",")], default=[128, 256])
    ap.add_argument("--steps", type=int, default=60)
    ap.add_argument("--lit", action="store_true", help="with light")
    ap.add_argument("--without", type=lambda s: s.split(";"), default=[], help="programs to leave out, separated by semicolons")
    ap.add_argument("--repetitions", type=int, default=3)
    ap.add_argument("--brickyard", default="target/release/brickyard")
    ap.add_argument("--worker", choices=VTK, help=argparse.SUPPRESS)
    a = ap.parse_args()
    worker(a) if a.worker else compare(a)


if __name__ == "__main__":
    main()
