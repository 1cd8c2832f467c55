#!/usr/bin/env python3
"""Rendering beside VTK.

  vtk.py FOLDER [--sizes 256,512] [--modes dvr,mip,isosurface] [--dtype u8|u16] [--repetitions 3]

The same volume (8-bit unless said otherwise), camera, transfer function and step (one voxel) by VTK's fixed-point mapper (on the CPU; it has no
isosurfaces), by VTK's GPU mapper (on Mesa's software OpenGL) and by brickyard's two backends: at level 0, and with the level chosen
by the view. Unlit but for isosurfaces. Volumes (`brickyard synth ct`) and stores are made in the folder where they are missing.

Each runs in a process of its own, in turn. CPU ms: processor time of all threads for a frame of an orbit, start-up excluded
(brickyard: what twice as many frames take more). first: seconds from opening the files (the page cache is warm) to the first
picture, VTK without importing; brickyard's first picture is complete but coarse (a frame goal of 100 ms), exact is when it
is complete at full quality. A program that fails, or draws nothing (less than one pixel in a thousand is not black), is noted as such.
PSNR: against VTK's GPU mapper. VTK draws between the outermost voxels' centres, brickyard half a voxel further. Medians over repetitions;
ratios are to VTK's mapper of the same kind, within each repetition.
"""
import argparse
import json
import math
import os
import statistics
import subprocess
import sys
import time

PX = 512
CENTRE, DISTANCE, ELEVATION, FOV, UP = (0.5, 0.5, 0.5), 2.2, 20.0, 30.0, (0.0, 1.0, 0.0)
UNIT_DISTANCE = 0.01
COLOR = [(0, 0, 0, 0), (60, 0.55, 0.25, 0.15), (100, 0.88, 0.60, 0.29), (150, 1.0, 0.94, 0.80), (220, 0.90, 0.95, 1.0), (255, 1, 1, 1)]
OPACITY = [(0, 0), (40, 0), (70, 0.02), (110, 0.15), (160, 0.30), (220, 0.85), (255, 1)]
GREY = [(0, 0, 0, 0), (255, 1, 1, 1)]
OPAQUE = [(0, 1), (255, 1)]
ISOVALUE = 100.0

# By name: whose ratio is taken to whom; brickyard's flags.
VTK = ("VTK fixed-point", "VTK GPU")
BRICKYARD = {
    "brickyard cpu, level 0": ("VTK fixed-point", ["--backend", "cpu", "--level", "0"]),
    "brickyard cpu, level auto": ("VTK fixed-point", ["--backend", "cpu", "--level", "auto"]),
    "brickyard gpu, level 0": ("VTK GPU", ["--backend", "gpu", "--level", "0"]),
    "brickyard gpu, level auto": ("VTK GPU", ["--backend", "gpu", "--level", "auto"]),
}


def eye(turn_deg):
    azimuth, elevation = math.radians(30 + turn_deg), math.radians(ELEVATION)
    away = (math.cos(elevation) * math.sin(azimuth), math.sin(elevation), math.cos(elevation) * math.cos(azimuth))
    return tuple(c + DISTANCE * d for c, d in zip(CENTRE, away))


def transfer(a, mode):
    """For values of 8 bits, stretched over those of 16, of which `synth` uses all."""
    scale = 257 if a.dtype == "u16" else 1
    lists = {"dvr": (COLOR, OPACITY), "mip": (GREY, OPAQUE), "isosurface": (COLOR, OPAQUE)}[mode]
    return tuple([(scale * value, *rest) for value, *rest in points] for points in lists)


def look_of(vtk, colors, opacities):
    """How VTK shows a volume: what is composited, without light."""
    color, opacity = vtk.vtkColorTransferFunction(), vtk.vtkPiecewiseFunction()
    for point in colors:
        color.AddRGBPoint(*point)
    for point in opacities:
        opacity.AddPoint(*point)
    look = vtk.vtkVolumeProperty()
    look.SetColor(color)
    look.SetScalarOpacity(opacity)
    look.SetScalarOpacityUnitDistance(UNIT_DISTANCE)
    look.SetInterpolationTypeToLinear()
    return look


def mapper_of(vtk, program, n):
    """VTK's mapper of this name, at a step of one voxel of n and a ray for each pixel."""
    if program == "VTK GPU":
        mapper = vtk.vtkOpenGLGPUVolumeRayCastMapper()
        mapper.SetUseJittering(0)
    else:
        mapper = vtk.vtkFixedPointVolumeRayCastMapper()
        mapper.SetNumberOfThreads(os.cpu_count())
    mapper.SetAutoAdjustSampleDistances(0)
    mapper.SetSampleDistance(1 / n)
    mapper.SetImageSampleDistance(1)
    return mapper


def scene_of(vtk, mapper, look):
    """A renderer of the volume, and a window that nobody sees."""
    volume = vtk.vtkVolume()
    volume.SetMapper(mapper)
    volume.SetProperty(look)
    renderer = vtk.vtkRenderer()
    renderer.SetBackground(0, 0, 0)
    renderer.AddVolume(volume)
    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(0)
    window.SetSize(PX, PX)
    window.AddRenderer(renderer)
    return renderer, window


def draw(renderer, window, turn_deg):
    camera = renderer.GetActiveCamera()
    camera.SetPosition(*eye(turn_deg))
    camera.SetFocalPoint(*CENTRE)
    camera.SetViewUp(*UP)
    camera.SetViewAngle(FOV)
    renderer.ResetCameraClippingRange()
    window.Render()
    window.WaitForCompletion()


def worker(a):
    """VTK, in a process of its own: prints one line of JSON."""
    os.environ["VTK_DEFAULT_OPENGL_WINDOW"] = "vtkOSOpenGLRenderWindow"
    # This file, too, is called vtk: its folder must not be searched.
    del sys.path[0]
    import numpy as np
    import vtk
    from vtk.util.numpy_support import numpy_to_vtk

    n, mode = a.sizes[0], a.modes[0]
    start = time.perf_counter()
    voxels = np.fromfile(raw_file(a, n), np.uint16 if a.dtype == "u16" else np.uint8)
    image = vtk.vtkImageData()
    image.SetDimensions(n, n, n)
    image.SetSpacing(1 / n, 1 / n, 1 / n)
    image.SetOrigin(0.5 / n, 0.5 / n, 0.5 / n)
    image.GetPointData().SetScalars(numpy_to_vtk(voxels, deep=0))
    look = look_of(vtk, *transfer(a, mode))
    if mode == "isosurface":
        look.ShadeOn()
        look.GetIsoSurfaceValues().SetValue(0, ISOVALUE)
    else:
        look.ShadeOff()
    mapper = mapper_of(vtk, a.worker, n)
    mapper.SetInputData(image)
    if mode == "mip":
        mapper.SetBlendModeToMaximumIntensity()
    elif mode == "isosurface":
        mapper.SetBlendModeToIsoSurface()
    else:
        mapper.SetBlendModeToComposite()
    renderer, window = scene_of(vtk, mapper, look)
    draw(renderer, window, 0)
    first_s = time.perf_counter() - start
    picture = vtk.vtkWindowToImageFilter()
    picture.SetInput(window)
    picture.ReadFrontBufferOff()
    picture.ShouldRerenderOff()
    picture.SetInputBufferTypeToRGB()
    writer = vtk.vtkPNGWriter()
    writer.SetFileName(picture_file(a, n, mode, a.worker))
    writer.SetInputConnection(picture.GetOutputPort())
    writer.Write()
    # The frames that brickyard's longer orbit has and the shorter one has not.
    cpu = time.process_time()
    for k in range(a.frames):
        draw(renderer, window, 360 * (k + 0.5) / a.frames)
    cpu = time.process_time() - cpu
    print(json.dumps(dict(cpu_ms=cpu * 1e3 / a.frames, first_s=first_s)), flush=True)
    # VTK's own clean-up can crash without a display.
    os._exit(0)


def suffix(a):
    return "" if a.dtype == "u8" else f"-{a.dtype}"


def raw_file(a, n):
    return os.path.join(a.folder, f"ct-{n}{suffix(a)}.raw")


def store_of(a, n):
    return os.path.join(a.folder, f"ct-{n}{suffix(a)}.zarr")


def picture_file(a, n, mode, name):
    return os.path.join(a.folder, f"{n}{suffix(a)}-{mode}-{name.replace(',', '').replace(' ', '-')}.png")


def output_of(command):
    """Standard output and processor seconds of a program."""
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    text = process.stdout.read()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        sys.exit(f"{' '.join(command)}: exit code {process.returncode}")
    return text, usage.ru_utime + usage.ru_stime


def make_volume(a, n):
    if not os.path.exists(raw_file(a, n)):
        output_of([a.brickyard, "synth", "ct", "--shape", f"{n},{n},{n}", "--dtype", a.dtype, raw_file(a, n)])
    if not os.path.exists(store_of(a, n)):
        spacing, origin = (",".join([str(v)] * 3) for v in (1 / n, 0.5 / n))
        output_of([a.brickyard, "pack", raw_file(a, n), store_of(a, n), "--shape", f"{n},{n},{n}", "--dtype", a.dtype, "--spacing", spacing,
                   "--origin", origin, "--progress", "none"])


def brickyard(a, n, mode, name):
    points = os.path.join(a.folder, f"{mode}{suffix(a)}.json")
    with open(points, "w") as file:
        json.dump(dict(zip(("color", "opacity"), transfer(a, mode)), unit_distance=UNIT_DISTANCE), file)
    vector = lambda v: ",".join(map(repr, v))
    # A budget that holds the whole volume, as VTK has it, with what aprons and tables add.
    budget = a.gpu_memory or str(2 * n**3 + (256 << 20))
    scene = [store_of(a, n), "--eye", vector(eye(0)), "--target", vector(CENTRE), "--up", vector(UP), "--fov", str(FOV), "--mode", mode,
             "--transfer", points, "--lighting", "none", "--size", f"{PX}x{PX}", "--gpu-memory", budget] + BRICKYARD[name][1]
    if mode == "isosurface":
        scene += ["--isovalue", str(ISOVALUE)]
    output_of([a.brickyard, "render", *scene, "-o", picture_file(a, n, mode, name), "--overwrite", "-q"])
    cpu = []
    for frames in (a.frames, 2 * a.frames):
        text, seconds = output_of([a.brickyard, "bench", *scene, "--scenario", "orbit", "--frames", str(frames), "--json"])
        cpu.append(seconds)
    text, _ = output_of([a.brickyard, "bench", *scene, "--scenario", "still", "--frames", "1", "--frame-goal", "100", "--json"])
    report = json.loads(text)[0]
    exact_ms = report["settled_ms"] + report["frame_ms"]["p50"] + report["settle_after_ms"]
    return dict(cpu_ms=(cpu[1] - cpu[0]) * 1e3 / a.frames, first_s=report["first_picture_ms"] / 1e3, exact_s=exact_ms / 1e3)


def psnr_db(a, n, mode, name):
    import numpy as np
    from PIL import Image

    if not all(os.path.exists(picture_file(a, n, mode, p)) for p in ("VTK GPU", name)):
        return math.nan
    one, other = (np.asarray(Image.open(picture_file(a, n, mode, p)).convert("RGB"), float) for p in ("VTK GPU", name))
    error = ((one - other) ** 2).mean()
    return math.inf if error == 0 else 10 * math.log10(255**2 / error)


def is_black(a, n, mode, name):
    import numpy as np
    from PIL import Image

    path = picture_file(a, n, mode, name)
    if not os.path.exists(path):
        return True
    return (np.asarray(Image.open(path).convert("RGB")).max(axis=2) > 0).mean() < 1e-3


def measure(a, n, mode, name):
    if name in BRICKYARD:
        return brickyard(a, n, mode, name)
    own = [sys.executable, os.path.abspath(__file__), a.folder, "--sizes", str(n), "--modes", mode, "--frames", str(a.frames), "--dtype", a.dtype]
    process = subprocess.run(own + ["--worker", name], stdout=subprocess.PIPE, text=True)
    if process.returncode:
        print(f"{name} at {n}³ {mode}: ended with {process.returncode}", file=sys.stderr)
        return dict(cpu_ms=math.nan, first_s=math.nan)
    return json.loads(process.stdout.splitlines()[-1])


def compare(a):
    os.makedirs(a.folder, exist_ok=True)
    cases = []
    for n in a.sizes:
        make_volume(a, n)
        for mode in a.modes:
            absent = [*a.without, *(["VTK fixed-point"] if mode == "isosurface" else [])]
            names = [name for name in (*VTK, *BRICKYARD) if name not in absent]
            rounds = []
            for _ in range(a.repetitions):
                rounds.append({name: measure(a, n, mode, name) for name in names})
                print(n, mode, rounds[-1], "load", os.getloadavg()[0], file=sys.stderr, flush=True)
            for name in names:
                if is_black(a, n, mode, name):
                    print(f"{name} at {n}³ {mode}: nothing is drawn", file=sys.stderr)
            cases.append(dict(size=n, mode=mode, names=names, rounds=rounds, psnr_db={name: psnr_db(a, n, mode, name) for name in names}))

    print("| volume | mode | program | CPU ms | of VTK's | first s | exact s | PSNR dB |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for case in cases:
        for name in case["names"]:
            median = lambda value: statistics.median(value(r) for r in case["rounds"])
            peer = BRICKYARD[name][0] if name in BRICKYARD else None
            ratio = f"{median(lambda r: r[name]['cpu_ms'] / r[peer]['cpu_ms']):.2f}" if peer in case["names"] else ""
            exact = f"{median(lambda r: r[name]['exact_s']):.2f}" if name in BRICKYARD else ""
            print(f"| {case['size']}³ | {case['mode']} | {name} | {median(lambda r: r[name]['cpu_ms']):.0f} | {ratio} |"
                  f" {median(lambda r: r[name]['first_s']):.2f} | {exact} | {case['psnr_db'][name]:.1f} |")
    print()
    print(json.dumps(cases))


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("folder", type=os.path.abspath)
    ap.add_argument("--sizes", type=lambda s: [int(n) for n in s.split(",")], default=[256, 512])
    ap.add_argument("--modes", type=lambda s: s.split(","), default=["dvr", "mip"])
    ap.add_argument("--dtype", choices=("u8", "u16"), default="u8")
    ap.add_argument("--gpu-memory", help="brickyard's budget [default: what holds the whole volume]")
    ap.add_argument("--without", type=lambda s: s.split(";"), default=[], help="programs to leave out, separated by semicolons")
    ap.add_argument("--repetitions", type=int, default=3)
    ap.add_argument("--frames", type=int, default=6)
    ap.add_argument("--brickyard", default="target/release/brickyard")
    ap.add_argument("--worker", choices=VTK, help=argparse.SUPPRESS)
    a = ap.parse_args()
    worker(a) if a.worker else compare(a)


if __name__ == "__main__":
    main()
