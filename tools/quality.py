#!/usr/bin/env python3
"""Measures how good and how fast the ways to sample are, for docs/results/quality.md.

  quality.py [NAME...] [--size 128x128] [--frames 4] [--samples-per-voxel 0.5,1,2,4] [--virtual-samples 1,2,3,4,6]
             [--out target/quality] [--brickyard target/release/brickyard]

NAME: some of the ten data sets (seven scans, three formulas), by default head-ct, mr-brain (both made by tools/demo), marschner-lobb and
turbulence; `all` takes all ten (`tools/fetch-data more` fetches the other scans). Each gets a folder in --out with what `brickyard quality`
writes and `printed.md`, what it prints; one that has been measured is not measured again. `tables.md` holds all their findings side by
side, what each method takes for 40 dB, and the means over all data sets; `maps.png` has a row for each data set, its picture and maps of
some ways to sample it. Some minutes each. Takes Pillow (`tools/setup python`, then target/python/bin/python).
"""
import argparse
import json
import math
import os
import subprocess
import sys

from PIL import Image

STORES = "target/quality"
# Scenes with thin layers: functions that change slowly from code to code are above 40 dB by every method at a sample a voxel.
LAYERS = "--transfer tools/layers.json"
# The same layers over other values than 0 to 255: files made by `make_store`.
SPREAD = {"snow": (0, 38000), "concrete-x-ray": (0, 38000), "concrete-neutron": (0, 65535)}
DATA = {
    "head-ct": ("target/demo/head-ct.zarr", "--transfer ct-angio --eye 380,520,190 --target 122,122,75 --fov 32"),
    "mr-brain": ("target/demo/mr-brain.zarr", LAYERS),
    "marschner-lobb": (f"{STORES}/marschner-lobb.zarr", LAYERS),
    "turbulence": (f"{STORES}/turbulence.zarr", LAYERS),
    "mr-head": (f"{STORES}/mr-head.zarr", LAYERS),
    "mr-macaque": (f"{STORES}/mr-macaque.zarr", LAYERS),
    "snow": (f"{STORES}/snow.zarr", f"--transfer {STORES}/snow.json"),
    "concrete-x-ray": (f"{STORES}/concrete-x-ray.zarr", f"--transfer {STORES}/concrete-x-ray.json"),
    "concrete-neutron": (f"{STORES}/concrete-neutron.zarr", f"--transfer {STORES}/concrete-neutron.json"),
    "ct": (f"{STORES}/ct.zarr", "--transfer tools/synthetic-ct.json"),
}
USUAL = ["head-ct", "mr-brain", "marschner-lobb", "turbulence"]
SYNTHETIC = ["marschner-lobb", "turbulence", "ct"]
# Virtual samples of the rows in tables: of methods without, and the usual number.
USUAL_SAMPLES = (None, 3)
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


def make_store(a, name):
    store, _ = DATA[name]
    if os.path.exists(f"{store}/zarr.json"):
        return
    if name in SYNTHETIC:
        run([a.brickyard, "synth", name, store, "--shape", "128,128,128", "--progress", "none"])
        return
    files = [file for file in (f"target/data/{name}.nii.gz", f"target/data/{name}.tif") if os.path.exists(file)]
    if not store.startswith(STORES) or not files:
        sys.exit(f"{store}: expected a store, found none: run tools/demo and `tools/fetch-data more` first")
    run([a.brickyard, "pack", files[0], store, "--progress", "none"])
    if name in SPREAD:
        with open("tools/layers.json") as file:
            layers = json.load(file)
        low, high = SPREAD[name]
        for points in (layers["color"], layers["opacity"]):
            for point in points:
                point[0] = low + (high - low) * point[0] / 255
        with open(f"{STORES}/{name}.json", "w") as file:
            json.dump(layers, file)


def survey(a, name):
    store, scene = DATA[name]
    folder = f"{a.out}/{name}"
    if os.path.exists(f"{folder}/quality.json"):
        return
    make_store(a, name)
    os.makedirs(folder, exist_ok=True)
    with open(f"{folder}/printed.md", "w") as printed:
        flags = ["--size", a.size, "--frames", str(a.frames), "--samples-per-voxel", a.samples_per_voxel, "-o", folder, "--overwrite",
                 "--virtual-samples", a.virtual_samples]
        run([a.brickyard, "quality", store, *scene.split(), *flags], printed)


def picture(a, name, size_px):
    store, scene = DATA[name]
    size = "x".join(str(3 * n) for n in size_px)
    flags = ["--size", size, "--level", "0", "--method", "pdvr", "--lighting", "none", "--step", "0.25", "--overwrite", "--backend", "cpu"]
    run([a.brickyard, "--quiet", "render", store, *scene.split(), *flags, "-o", f"{a.out}/{name}/picture.png"])


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
    lines = [f"| | {' | '.join(methods)} |", "| --- |" + " --- |" * len(methods)]
    for name in names:
        rows = [row for row in measured[name]["rows"] if row["virtual_samples"] in USUAL_SAMPLES]
        for lighting, filter in dict.fromkeys((row["lighting"], row["filter"]) for row in rows):
            cells = []
            for method in methods:
                found = reached([r for r in rows if (r["lighting"], r["filter"], r["method"]) == (lighting, filter, method)], 40.0)
                cells.append("–" if found is None else f"{'≤ ' * found[2]}{found[0]:.1f}: {found[1]:.0f} ms")
            lit = "unlit" if lighting == "none" else "lit"
            lines.append(f"| {name}, {filter}, {lit} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def means(names, measured):
    """Decibels by variance / against the truth and times the plain way's processor time, averaged over the data sets; ∞ where any has no error."""
    cells = {}
    for name in names:
        rows = [row for row in measured[name]["rows"] if row["virtual_samples"] in USUAL_SAMPLES]
        key = lambda row: (row["filter"], row["lighting"], row["samples_per_voxel"])
        plain_ms = {key(row): row["cpu_ms"] for row in rows if row["method"] == "udvr"}
        for row in rows:
            db = [math.inf if row[by] is None else row[by] for by in ("rgb_db", "truth_db")]
            figures = (*db, row["cpu_ms"] / plain_ms[key(row)])
            cells.setdefault(key(row), {}).setdefault(row["method"], []).append(figures)
    methods = list(dict.fromkeys(method for row in cells.values() for method in row))
    lines = [f"| | {' | '.join(methods)} |", "| --- |" + " --- |" * len(methods)]
    for (filter, lighting, rate), row in cells.items():
        mean = [[sum(column) / len(column) for column in zip(*row[method])] for method in methods]
        lit = "unlit" if lighting == "none" else "lit"
        lines.append(f"| {filter}, {lit}, {rate:g} | " + " | ".join(f"{v:.1f} / {t:.1f}, {x:.1f}" for v, t, x in mean).replace("inf", "∞") + " |")
    return "\n".join(lines) + "\n"


def maps(a, names, measured):
    """A row for each data set: its picture, then the maps; three times as large."""
    width, height = (3 * n for n in measured[names[0]]["size_px"])
    sheet = Image.new("RGB", ((width + 4) * (len(SHOWN) + 1) - 4, (height + 4) * len(names) - 4), "white")
    for y, name in enumerate(names):
        files = ["picture.png"] + [f"psnr-{filter}-{lighting}-{method}-1.png" for filter, lighting, method in SHOWN]
        for x, file in enumerate(files):
            with Image.open(f"{a.out}/{name}/{file}") as image:
                image = image.resize((width, height), Image.NEAREST)
                sheet.paste(image, (x * (width + 4), y * (height + 4)))
    return sheet


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("names", nargs="*", metavar="NAME", help=", ".join(DATA))
    ap.add_argument("--size", default="128x128")
    ap.add_argument("--frames", type=int, default=4)
    ap.add_argument("--samples-per-voxel", default="0.5,1,2,4")
    ap.add_argument("--virtual-samples", default="1,2,3,4,6")
    ap.add_argument("--out", default="target/quality")
    ap.add_argument("--brickyard", default="target/release/brickyard")
    a = ap.parse_args()
    names = list(DATA) if a.names == ["all"] else a.names or USUAL
    unknown = [name for name in names if name not in DATA]
    if unknown:
        ap.error(f"{unknown[0]}: expected all, or some of {', '.join(DATA)}")
    for name in names:
        survey(a, name)
    measured = {}
    for name in names:
        with open(f"{a.out}/{name}/quality.json") as file:
            measured[name] = json.load(file)
        picture(a, name, measured[name]["size_px"])
    text = findings(names, measured) + "\n" + costs(names, measured) + "\n" + means(names, measured)
    with open(f"{a.out}/tables.md", "w") as file:
        file.write(text)
    print(text, end="")
    maps(a, names, measured).save(f"{a.out}/maps.png", optimize=True)


if __name__ == "__main__":
    main()
