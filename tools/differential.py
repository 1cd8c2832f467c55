#!/usr/bin/env python3
"""Every file of the public collections, and random files of other programs' writers: packed and exported by brickyard, and compared with
what independent readers say. docs/results/differential.md says what was seen.

  differential.py [NAME...] [--brickyard target/release/brickyard] [--random 100] [--seed 1] [--jobs 2] [--memory 256MiB]
                  [--out target/differential]

NAMEs choose cases by a part of their names (`tiff/`, `pydicom-3`, `written/npy`). It makes a Python environment of its own under `--out`,
and fetches the packages that hold the collections with pip into target/data/collections. Their licences are theirs; nothing of them is ever
committed. `report.md` holds the table, `cases.tsv` a line for each case. It exits with 1 where anything is wrong.
"""

import argparse
import collections
import concurrent.futures
import os
import pathlib
import subprocess
import sys
import venv

REQUIREMENTS = """
h5py==3.16.0
hdf5plugin==7.1.0
imagecodecs==2026.3.6
imageio==2.38.1
mrcfile==1.5.4
netcdf4==1.7.5.1.post1
ngff-zarr==0.50.0
nibabel==5.4.2
numcodecs==0.16.6
numpy==2.4.6
ome-zarr==0.18.0
pillow==13.0.0
pydicom==3.0.2
pyjpegls==1.5.1
pylibjpeg==2.1.0
pylibjpeg-libjpeg==2.5.0
pylibjpeg-openjpeg==2.6.0
pylibjpeg-rle==2.2.0
pynrrd==1.1.3
pypng==0.20220715.0
scipy==1.17.1
simpleitk==2.5.7
tifffile==2026.3.3
vtk==9.7.2
zarr==3.1.6
"""
ROOT = pathlib.Path(__file__).resolve().parent.parent
DATA = ROOT / "target/data/collections"
# What a case can come to, in the order of the table.
OUTCOMES = ["equal", "refused", "no reference", "WRONG", "WRONG-REFUSAL", "WRONG-CODE", "LEFT BEHIND", "OVER MEMORY", "hang", "crash"]
BAD = OUTCOMES[3:]


def arguments():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("names", nargs="*")
    ap.add_argument("--random", default=100, type=int, help="written files of each format")
    ap.add_argument("--seed", default=1, type=int)
    ap.add_argument("--jobs", default=2, type=int)
    ap.add_argument("--memory", default="256MiB")
    ap.add_argument("--timeout", default=120.0, type=float, help="seconds after which a command hangs")
    ap.add_argument("--out", default=ROOT / "target/differential", type=pathlib.Path)
    return parsed(ap)


def parsed(ap):
    """Arguments with the command to try, which is built already, and absolute paths."""
    built = next((p for p in ("target/release/brickyard", "target/debug/brickyard") if (ROOT / p).exists()), None)
    ap.add_argument("--brickyard", default=built and ROOT / built, type=pathlib.Path)
    a = ap.parse_args()
    if a.brickyard is None or not a.brickyard.exists():
        sys.exit(f"{a.brickyard or 'brickyard'}: no such command; build it with: cargo build --release -p brickyard-cli")
    a.brickyard, a.out = a.brickyard.resolve(), a.out.resolve()
    return a


def enter_environment(out):
    """Goes on in an environment that has the independent readers, made on the first call."""
    home = out / "venv"
    if pathlib.Path(sys.prefix).resolve() == home.resolve():
        return
    wanted = home / "requirements.txt"
    if not wanted.exists() or wanted.read_text() != REQUIREMENTS:
        venv.create(home, with_pip=True, clear=True)
        pip = [home / "bin/python", "-m", "pip", "install", "-q", "--disable-pip-version-check", *REQUIREMENTS.split()]
        subprocess.run(pip, check=True)
        wanted.write_text(REQUIREMENTS)
    os.execv(home / "bin/python", [str(home / "bin/python"), *sys.argv])


def table(results, heads, key):
    """Counts of outcomes by what `key` says of a case."""
    count = collections.Counter((*key(r.case), r.outcome) for r in results)
    shown = [o for o in OUTCOMES if any(k[-1] == o for k in count)]
    lines = [f"| {' | '.join([*heads, 'cases', *shown])} |", f"|{' --- |' * len(heads)}{' ---: |' * (len(shown) + 1)}"]
    for row in sorted({k[:-1] for k in count}):
        numbers = [count[(*row, o)] for o in shown]
        lines.append(f"| {' | '.join([*row, str(sum(numbers)), *(str(n or '') for n in numbers)])} |")
    total = [sum(n for k, n in count.items() if k[-1] == o) for o in shown]
    lines.append(f"| {' | '.join(['all', *[''] * (len(heads) - 1), str(sum(total)), *map(str, total)])} |")
    return lines + [""]


def report_of(results):
    """Counts by collection and by codec; then everything that is bad, and what refusals say."""
    lines = table(results, ["collection", "format"], lambda c: (c.collection, c.format))
    lines += table(results, ["format", "codec, transfer syntax or type"], lambda c: (c.format, c.group))
    for outcome in BAD:
        for r in results:
            if r.outcome == outcome:
                lines.append(f"\n{outcome}: {r.case.name}\n    {r.detail}")
    said = collections.defaultdict(list)
    for r in results:
        if r.outcome == "refused":
            said[r.detail.replace(pathlib.Path(r.case.inputs[0]).name, "FILE")].append(r.case.name)
    lines.append("\nRefusals:\n")
    for message, names in sorted(said.items(), key=lambda item: -len(item[1])):
        lines.append(f"- {len(names)}, such as {names[0]}: {message}")
    return "\n".join(lines)


def main():
    a = arguments()
    enter_environment(a.out)
    from differential_arrays import KINDS
    from differential_cases import all_collection_cases
    from differential_channels import KINDS as CHANNEL_KINDS
    from differential_hdf5 import KINDS as HDF5_KINDS
    from differential_ome_zarr import KINDS as OME_ZARR_KINDS
    from differential_written import written_cases
    from differential_zarr import KINDS as ZARR_KINDS
    from differential_check import Checker

    cases = all_collection_cases(DATA) + list(written_cases(a.out / "written", a.random, a.seed))
    kinds = KINDS + CHANNEL_KINDS + HDF5_KINDS + ZARR_KINDS + OME_ZARR_KINDS
    cases += written_cases(a.out / "written", a.random, a.seed, kinds)
    cases = [c for c in cases if not a.names or any(n in c.name for n in a.names)]
    checker = Checker(a.brickyard, a.out / "work", a.memory, a.timeout)
    results = []
    with concurrent.futures.ThreadPoolExecutor(a.jobs) as pool, open(a.out / "cases.tsv", "w") as log:
        for i, result in enumerate(pool.map(checker.check, cases)):
            results.append(result)
            c = result.case
            print(c.name, c.format, c.group, result.outcome, result.detail.replace("\n", " "), sep="\t", file=log, flush=True)
            if result.outcome in BAD:
                print(f"{result.outcome}: {c.name}: {result.detail}", flush=True)
            if i % 100 == 99:
                print(f"{i + 1} of {len(cases)}", file=sys.stderr, flush=True)
    report = report_of(results)
    (a.out / "report.md").write_text(report + "\n")
    print(report)
    sys.exit(any(r.outcome in BAD for r in results))


if __name__ == "__main__":
    main()
