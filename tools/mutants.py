#!/usr/bin/env python3
"""Thousands of damaged files for every reader, each given to the real command: it must read or refuse them, with the documented exit code, in bounded
time and memory. docs/results/mutants.md says what was seen.

  mutants.py [READER...] [--mutants 10000] [--first 0] [--seed 1] [--brickyard target/release/brickyard] [--jobs 2] [--memory 64MiB] [--out target/mutants]

Small valid files by independent writers are changed in one to four places: bits, bytes, fields of 16 to 64 bits with numbers at their bounds, numbers in
text, words moved, doubled, deleted, files cut. Half the changes are in the first kilobyte, where headers lie. Checksums of HDF5 and PNG are made good again
in half of the mutants, and packed texts (.gz, .npz) packed again, so that changes get behind them. Each mutant is planned (`pack --dry-run`); one that
would be read, and is small, is packed. It works in the Python environment of differential.py.

A table goes to standard output, and a line for each mutant to `--out`/mutants.tsv. What is bad is kept under `--out`/bad, with its command; `--first N --mutants 1` repeats mutant N. It exits with 1 then.
"""

import argparse
import collections
import concurrent.futures
import gzip
import io
import json
import os
import pathlib
import re
import select
import shutil
import struct
import subprocess
import sys
import threading
import time
import zipfile
import zlib

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from differential import ROOT, enter_environment, parsed

UNITS = {"KiB": 1 << 10, "MiB": 1 << 20, "GiB": 1 << 30}
SEEDS = 24
HANG_S = 20
# Address space: threads' stacks and arenas, the program's pages, and allocations never touched.
ADDRESS_KIB = 1 << 20
# Largest volume that is packed, and not only planned.
PACKED_BYTES = 4 << 20
# Room beside `--memory`: the program's own pages.
PROGRAM_BYTES = 64 << 20

# What can come of a mutant; the first ones are as they should be.
OUTCOMES = ["packed", "planned", "refused (3)", "refused (2)", "refused in packing (3)"]


def arguments():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("readers", nargs="*")
    ap.add_argument("--mutants", default=10000, type=int, help="of each reader")
    ap.add_argument("--first", default=0, type=int, help="number of the first mutant")
    ap.add_argument("--seed", default=1, type=int)
    ap.add_argument("--jobs", default=2, type=int)
    ap.add_argument("--memory", default="64MiB")
    ap.add_argument("--out", default=ROOT / "target/mutants", type=pathlib.Path)
    return parsed(ap)


# Changes of bytes

NUMBER = re.compile(rb"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
TEXTS = b"0 1 -1 2 3 255 65536 2147483647 -2147483648 4294967295 4294967296 9223372036854775807 18446744073709551616 1e308 -1e308 1e-320 nan inf 1e400"
TEXTS = [*TEXTS.split(), b"", b"9" * 400, b"0x10", b"1,1", b"1 1 1 1"]
BOUNDS = [0, 1, 2, 3, 127, 128, 255, 256, 32767, 32768, 65535, 65536, 1 << 24, (1 << 31) - 1, 1 << 31, (1 << 32) - 1, 1 << 32, 1 << 40, 1 << 62]
BOUNDS += [(1 << 63) - 1, 1 << 63, (1 << 64) - 1, (1 << 64) - 2]


def pick(rng, choices):
    return choices[int(rng.integers(len(choices)))]


def place(rng, length):
    """A place among bytes: in the first kilobyte by half, in the last by an eighth."""
    if length == 0:
        return 0
    where = rng.random()
    if where < 0.5:
        return int(rng.integers(min(length, 1024)))
    if where < 0.625:
        return length - 1 - int(rng.integers(min(length, 1024)))
    return int(rng.integers(length))


def change(rng, data):
    """One change. Returns other bytes."""
    data, at = bytearray(data), place(rng, len(data))
    kind = pick(rng, ["bit", "byte", "byte", "field", "field", "field", "number", "number", "cut", "delete", "double", "move"])
    length = int(2 ** (rng.random() * 8))
    if kind == "bit" and data:
        data[at] ^= 1 << int(rng.integers(8))
    elif kind == "byte" and data:
        data[at] = pick(rng, [0, 0xFF, 0x7F, 0x80, int(rng.integers(256))])
    elif kind == "field":
        size, order = pick(rng, [2, 4, 4, 8, 8]), pick(rng, ["little", "little", "big"])
        at -= at % pick(rng, [1, 2, 4])
        old = int.from_bytes(data[at : at + size], order)
        value = pick(rng, [*BOUNDS, len(data), old + 1, old - 1, old * 2, old ^ (1 << (8 * size - 1))])
        field = (value % (1 << 8 * size)).to_bytes(size, order)
        data[at : at + size] = field[: len(data) - at]
    elif kind == "number":
        found = NUMBER.search(data, at) or NUMBER.search(data)
        if found:
            data[found.start() : found.end()] = pick(rng, TEXTS)
    elif kind == "cut":
        del data[at:]
    elif kind == "delete":
        del data[at : at + length]
    elif kind == "double":
        data[at:at] = data[at : at + length]
    else:
        data[at : at + length] = data[(other := place(rng, len(data))) : other + length]
    return bytes(data)


def changed(rng, data):
    for _ in range(1 + int(rng.geometric(0.55) - 1) % 4):
        data = change(rng, data)
    return data


def mutant(rng, name, data, sums):
    """Changes a file: what is packed in it, too, and with good checksums."""
    if data[:2] == b"\x1f\x8b" and rng.random() < 0.6:
        return gzip.compress(changed(rng, gzip.decompress(data)), 1, mtime=0)
    if data[:2] == b"PK" and rng.random() < 0.6:
        return with_member(rng, data)
    other = changed(rng, data)
    if rng.random() < 0.5:
        other = with_sums(other, data, sums.get(name, []))
        other = with_png_sums(other) if data[:4] == b"\x89PNG" else other
    return other


def with_member(rng, data):
    """An archive with one of its files changed."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(out, "w") as new:
        wanted = pick(rng, old.infolist())
        for info in old.infolist():
            content = old.read(info)
            new.writestr(info, changed(rng, content) if info is wanted else content)
    return out.getvalue()


def with_png_sums(data):
    data, at = bytearray(data), 8
    while at + 12 <= len(data):
        end = at + 8 + int.from_bytes(data[at : at + 4], "big")
        if end + 4 > len(data):
            break
        data[end : end + 4] = struct.pack(">I", zlib.crc32(data[at + 4 : end]))
        at = end + 4
    return bytes(data)


# Checksums of HDF5's structures: Jenkins' lookup3 over everything before them

STRUCTURES = re.compile(rb"OHDR|OCHK|BTHD|BTIN|BTLF|FRHP|FHDB|FHIB|FSHD|FSSE|FAHD|FADB|EAHD|EAIB|EASB|EADB|SMTB|SMLI")
LONGEST = 2048
MASK = 0xFFFFFFFF


def turned(x, k):
    return (x << k | x >> 32 - k) & MASK


def lookup3(data):
    return int(lookup3_of_starts(np.frombuffer(data, "u1"), np.array([len(data)]))[0])


def lookup3_of_starts(data, lengths):
    """The sums of the first bytes of an array, for each of these lengths."""
    words = np.zeros(len(data) // 4 + 4, "<u4")
    words.view("u1")[: len(data)] = data
    words = words.astype("u8")
    a = b = c = (lengths.astype("u8") + 0xDEADBEEF) & MASK
    full = np.maximum(lengths - 1, 0) // 12
    for k in range(int(full.max(initial=0))):
        x, y, z = (a + words[3 * k]) & MASK, (b + words[3 * k + 1]) & MASK, (c + words[3 * k + 2]) & MASK
        for turn in (4, 6, 8, 16, 19, 4):
            x = ((x - z) & MASK) ^ turned(z, turn)
            z = (z + y) & MASK
            x, y, z = y, z, x
        go = k < full
        a, b, c = np.where(go, x, a), np.where(go, y, b), np.where(go, z, c)
    parts = []
    for i in range(3):
        left = np.clip(lengths - 12 * full - 4 * i, 0, 4)
        keep = (np.uint64(1) << (8 * left).astype("u8")) - np.uint64(1)
        parts.append(words[3 * full + i] & keep)
    x, y, z = ((n + part) & MASK for n, part in zip((a, b, c), parts))
    for turn in (14, 11, 25, 16, 4, 14, 24):
        z = ((z ^ y) - turned(y, turn)) & MASK
        x, y, z = y, z, x
    # Seven turns leave the last result second.
    return np.where(lengths > 0, y, c)


def sums_of(data):
    """First places and ends of everything in a file with a checksum behind it: found by trying all lengths."""
    if data[:8] != b"\x89HDF\r\n\x1a\n" and b"\x89HDF" not in data[:1024]:
        return []
    start = data.index(b"\x89HDF")
    starts = [start] * (data[start + 8] >= 2) + [found.start() for found in STRUCTURES.finditer(data)]
    sums = []
    for at in starts:
        part = np.frombuffer(data[at : at + LONGEST], "u1")
        lengths = np.arange(8, len(part) - 4)
        stored = sum(part[lengths + i].astype("u8") << (8 * i) for i in range(4))
        sums += [(at, at + int(n)) for n in lengths[lookup3_of_starts(part, lengths) == stored][:1]]
    return sums


def with_sums(data, old, sums):
    """Makes those sums good again that a change has made wrong, unless it has moved them."""
    if len(data) != len(old):
        return data
    data = bytearray(data)
    for start, end in sums:
        if data[start:end] != old[start:end]:
            data[end : end + 4] = lookup3(bytes(data[start:end])).to_bytes(4, "little")
    return bytes(data)


# One mutant


class Bench:
    """Runs the command on files in a folder of each thread."""

    def __init__(self, a):
        self.a = a
        self.runners = concurrent.futures.ProcessPoolExecutor(a.jobs)
        # Before anything large is imported.
        list(self.runners.map(time.sleep, [0.2] * a.jobs))
        self.most_bytes = int(a.memory[:-3]) * UNITS[a.memory[-3:]] + PROGRAM_BYTES

    def outcome(self, reader, seed, files):
        """What comes of files, and what was said."""
        folder = self.a.out / "work" / str(threading.get_ident())
        shutil.rmtree(folder, ignore_errors=True)
        for name, data in files.items():
            path = folder / "in" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        outcome, said = self.run(folder, self.words(reader, seed) + ["--dry-run", "--json"], seed, reader)
        if outcome == "done" and (size := bytes_of(said)) <= PACKED_BYTES:
            outcome, said = self.run(folder, self.words(reader, seed), seed, reader)
            outcome = {"done": "packed", "refused (3)": "refused in packing (3)"}.get(outcome, outcome)
        elif outcome == "done":
            outcome, said = "planned", f"{size} bytes of voxels"
        left = [path.name for path in folder.iterdir() if path.name not in ("in", "said", "told")]
        # Finished parts are kept for `--resume`, and the message says so.
        if outcome.startswith("refused") and left and "--resume" not in said:
            outcome = "left behind"
        return outcome, said

    def words(self, reader, seed):
        inputs = ["-"] if reader == "pipe" else [f"in/{name}" for name in seed.inputs]
        more = ["--memory", self.a.memory, "--progress", "none", "-j", "1", "--scratch", "."]
        return ["pack", *inputs, "o.zarr", *seed.flags, "--allow-lossy", "-q", *more]

    def run(self, folder, words, seed, reader):
        stdin = folder / "in" / seed.inputs[0] if reader == "pipe" else os.devnull
        # By a small process: the kernel counts a parent's memory as that of its children before they start.
        ended = self.runners.submit(run, [str(self.a.brickyard), *words], folder, stdin).result()
        code, said, told = ended.code, ended.said, ended.told
        if code is None:
            return "hang", said
        if code < 0 or code > 100 or "panicked" in said:
            return "panic", f"exit code {code}: {said}"
        if ended.most_bytes > self.most_bytes:
            return "over memory", f"{ended.most_bytes >> 20} MiB: {said}"
        if code == 0:
            return "done", told
        if not any(line.startswith("error: ") and ": " in line[7:] for line in said.splitlines()):
            return "no message", f"exit code {code}: {said}"
        if code == 3 or code == 2 and re.search("--|name the files|name one file|choose one", said):
            return f"refused ({code})", said
        return f"exit code {code}", said


Ended = collections.namedtuple("Ended", "code most_bytes said told")


def run(command, folder, stdin):
    """How a command ends; without a code if it does not."""
    # A shell sets the limit, so that it is the command's alone.
    limited = ["/bin/sh", "-c", f'ulimit -v {ADDRESS_KIB}; exec "$0" "$@"', *command]
    with open(folder / "said", "w+b") as err, open(folder / "told", "w+b") as out, open(stdin, "rb") as given:
        environment = {**os.environ, "RUST_BACKTRACE": "0"}
        process = subprocess.Popen(limited, stdin=given, stdout=out, stderr=err, cwd=folder, env=environment)
        handle = os.pidfd_open(process.pid)
        is_over = select.select([handle], [], [], HANG_S)[0]
        if not is_over:
            process.kill()
        _, status, used = os.wait4(process.pid, 0)
        os.close(handle)
        process.returncode = os.waitstatus_to_exitcode(status)
        err.seek(0), out.seek(0)
        said, told = err.read().decode(errors="replace").strip(), out.read().decode(errors="replace")
    return Ended(process.returncode if is_over else None, used.ru_maxrss << 10, said, told)


def bytes_of(plan):
    plan = json.loads(plan)
    x, y, z = plan["extent"]
    return x * y * z * plan["times"] * plan["channels"] * int(plan["voxel_type"][1:]) // 8


def keep(a, reader, seed, files, number, outcome, said, words):
    folder = a.out / "bad" / f"{reader}-{a.seed}-{number}"
    shutil.rmtree(folder, ignore_errors=True)
    for name, data in files.items():
        path = folder / "in" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    (folder / "said").write_text(f"{outcome}\nbrickyard {' '.join(words)}\n{said}\n")
    print(f"{outcome}: {folder}: {said[:300]}", flush=True)


def try_reader(a, bench, reader, pool):
    """Counts of outcomes over all mutants of a reader, and the number of its seeds."""
    home = a.out / "seeds" / reader
    shutil.rmtree(home, ignore_errors=True)
    seeds = seeds_of(reader, home, a.seed, SEEDS, lambda seed: bench.outcome(reader, seed, seed.files)[0] == "packed")
    if not seeds:
        sys.exit(f"{reader}: no seed is read")
    sums = [{name: sums_of(data) for name, data in seed.files.items()} for seed in seeds]

    def one(number):
        rng = np.random.default_rng([a.seed, number, *reader.encode()])
        which = int(rng.integers(len(seeds)))
        seed, files = seeds[which], dict(seeds[which].files)
        name = pick(rng, seed.headers if rng.random() < 0.9 else list(files))
        files[name] = mutant(rng, name, files[name], sums[which])
        outcome, said = bench.outcome(reader, seed, files)
        print(reader, number, outcome, said.replace("\n", " ")[:300] if outcome != "packed" else "", sep="\t", file=log, flush=True)
        if outcome not in OUTCOMES:
            keep(a, reader, seed, files, number, outcome, said, bench.words(reader, seed))
        return outcome

    with open(a.out / "mutants.tsv", "a") as log:
        return collections.Counter(pool.map(one, range(a.first, a.first + a.mutants))), len(seeds)


def main():
    a = arguments()
    enter_environment(ROOT / "target/differential")
    bench, rows, is_bad = Bench(a), [], False
    global np, seeds_of
    import numpy as np
    from mutants_seeds import READERS, seeds_of

    shutil.rmtree(a.out / "work", ignore_errors=True)
    (a.out / "mutants.tsv").unlink(missing_ok=True)
    with concurrent.futures.ThreadPoolExecutor(a.jobs) as pool:
        for reader in a.readers or READERS:
            count, seeds = try_reader(a, bench, reader, pool)
            bad = {outcome: n for outcome, n in count.items() if outcome not in OUTCOMES}
            is_bad |= bool(bad)
            words = ", ".join(f"{n} {outcome}" for outcome, n in bad.items())
            rows.append(f"| {reader} | {seeds} | {count.total()} | {' | '.join(str(count[o]) for o in OUTCOMES)} | {words or 0} |")
            print(rows[-1], flush=True)
    print(f"\n| reader | seeds | mutants | {' | '.join(OUTCOMES)} | bad |\n| --- |{' ---: |' * (len(OUTCOMES) + 3)}", *rows, sep="\n")
    sys.exit(is_bad)


if __name__ == "__main__":
    main()
