#!/usr/bin/env python3
"""What docs/results/quality.md shows: how good and how fast the ways to sample are, on two scans and two formulas.

  quality.py [NAME...] [--size 128x128] [--frames 4] [--brickyard target/release/brickyard]

Of the data sets head-ct, mr-brain (both made by tools/demo), marschner-lobb and turbulence (made here): those named, else all. Each gets a
folder in target/quality with what `brickyard quality` writes and `printed.md`, what it prints; one that has been measured is not measured
again. `tables.md` holds all their findings side by side, and what each method takes for 40 dB; `maps.png` has a row for each data set, its
picture and maps of some ways to sample it. Some minutes each. Takes Pillow (`tools/setup python`, then target/python/bin/python).
"""
import argparse
import json
import math
import os
import subprocess
import sys

from PIL import Image

OUT = "target/quality"
# Scenes with thin layers: what changes slowly from code to code is above 40 dB by every method at a sample a voxel.
DATA = {
    "head-ct": ("target/demo/head-ct.zarr", "--transfer ct-angio --eye 380,520,190 --target 122,122,75 --fov 32"),
    "mr-brain": ("target/demo/mr-brain.zarr", "--transfer tools/layers.json"),
    "marschner-lobb": (f"{OUT}/marschner-lobb.zarr", "--transfer tools/layers.json"),
    "turbulence": (f"{OUT}/turbulence.zarr", "--transfer tools/layers.json"),
}
SYNTHETIC = ["marschner-lobb", "turbulence"]
RATES = "0.5,1,2,4"
VIRTUAL_SAMPLES = "1,2,3,4,6"
# Maps that are shown: filter, lighting, method; at a sample a voxel.
SHOWN = [
    ("trilinear", "none", "udvr"),
    ("trilinear", "none", "pdvr"),
    ("trilinear", "blinn-phong", "udvr"),
    ("tricubic", "blinn-phong", "pcvs"),
]


def run(command, output=None):
    print("+", " ".join(command), file=sys.stderr, flush=True)
    if subprocess.run(command, stdout=output).returncode:
        sys.exit(f"{command[0]} {command[1]} has failed")


def survey(a, name):
    store, scene = DATA[name]
    if os.path.exists(f"{OUT}/{name}/quality.json"):
        return
    if not os.path.exists(f"{store}/zarr.json"):
        if name not in SYNTHETIC:
            sys.exit(f"{store}: expected a store, found none: run tools/demo first")
        run([a.brickyard, "synth", name, store, "--shape", "128,128,128", "--progress", "none"])
    folder = f"{OUT}/{name}"
    os.makedirs(folder, exist_ok=True)
    with open(f"{folder}/printed.md", "w") as printed:
        flags = ["--size", a.size, "--frames", str(a.frames), "--samples-per-voxel", RATES, "-o", folder, "--overwrite",
                 "--virtual-samples", VIRTUAL_SAMPLES]
        run([a.brickyard, "quality", store, *scene.split(), *flags], printed)


def picture(a, name, size_px):
    store, scene = DATA[name]
    size = "x".join(str(3 * n) for n in size_px)
    flags = ["--size", size, "--level", "0", "--method", "pdvr", "--lighting", "none", "--step", "0.25", "--overwrite", "--backend", "cpu"]
    run([a.brickyard, "--quiet", "render", store, *scene.split(), *flags, "-o", f"{OUT}/{name}/picture.png"])


def findings(names, measured):
    """All data sets' findings side by side: by variance / against the truth."""
    words = {True: "yes", False: "no", None: "–"}
    by_name = {name: measured[name]["findings"] for name in names}
    claims = list(dict.fromkeys(finding["claim"] for finding in by_name[names[0]]))
    lines = [f"| The paper | {' | '.join(names)} |", "| --- |" + " --- |" * len(names)]
    for claim in claims:
        cells = [" / ".join(words[f["agrees"]] for f in by_name[name] if f["claim"] == claim) for name in names]
        lines.append(f"| {claim} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def reached(rows, target_db):
    """Rate and processor time at which a method's curve reaches a quality, and whether it is above it from the first."""
    before = None
    for row in sorted(rows, key=lambda row: row["samples_per_voxel"]):
        db = math.inf if row["rgb_db"] is None else row["rgb_db"]
        here = (row["samples_per_voxel"], row["cpu_ms"], db)
        if db >= target_db:
            if before is None:
                return (*here[:2], True)
            share = (target_db - before[2]) / (db - before[2]) if db < math.inf else 1.0
            return (*(a * (b / a) ** share for a, b in zip(before[:2], here[:2])), False)
        before = here
    return None


def costs(names, measured):
    """Samples a voxel, and processor time of a frame, at which each method reaches 40 dB by variance."""
    methods = list(dict.fromkeys(row["method"] for row in measured[names[0]]["rows"]))
    usual = (None, 3)
    lines = [f"| | {' | '.join(methods)} |", "| --- |" + " --- |" * len(methods)]
    for name in names:
        rows = [row for row in measured[name]["rows"] if row["virtual_samples"] in usual]
        for lighting, filter in dict.fromkeys((row["lighting"], row["filter"]) for row in rows):
            cells = []
            for method in methods:
                found = reached([r for r in rows if (r["lighting"], r["filter"], r["method"]) == (lighting, filter, method)], 40.0)
                cells.append("–" if found is None else f"{'≤ ' * found[2]}{found[0]:.1f}: {found[1]:.0f} ms")
            lit = "unlit" if lighting == "none" else "lit"
            lines.append(f"| {name}, {filter}, {lit} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def maps(names, measured):
    """A row for each data set: its picture, then the maps; three times as large."""
    width, height = (3 * n for n in measured[names[0]]["size_px"])
    sheet = Image.new("RGB", ((width + 4) * (len(SHOWN) + 1) - 4, (height + 4) * len(names) - 4), "white")
    for y, name in enumerate(names):
        files = ["picture.png"] + [f"psnr-{filter}-{lighting}-{method}-1.png" for filter, lighting, method in SHOWN]
        for x, file in enumerate(files):
            with Image.open(f"{OUT}/{name}/{file}") as image:
                image = image.resize((width, height), Image.NEAREST)
                sheet.paste(image, (x * (width + 4), y * (height + 4)))
    return sheet


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("names", nargs="*", metavar="NAME", help=", ".join(DATA))
    ap.add_argument("--size", default="128x128")
    ap.add_argument("--frames", type=int, default=4)
    ap.add_argument("--brickyard", default="target/release/brickyard")
    a = ap.parse_args()
    unknown = [name for name in a.names if name not in DATA]
    if unknown:
        ap.error(f"{unknown[0]}: expected one of {', '.join(DATA)}")
    names = a.names or list(DATA)
    for name in names:
        survey(a, name)
    measured = {}
    for name in names:
        with open(f"{OUT}/{name}/quality.json") as file:
            measured[name] = json.load(file)
        picture(a, name, measured[name]["size_px"])
    text = findings(names, measured) + "\n" + costs(names, measured)
    with open(f"{OUT}/tables.md", "w") as file:
        file.write(text)
    print(text, end="")
    maps(names, measured).save(f"{OUT}/maps.png", optimize=True)


if __name__ == "__main__":
    main()
