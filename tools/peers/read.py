#!/usr/bin/env python3
"""Random bricks of a brick store, by other readers and by brickyard.

  read.py STORE [--repetitions 3] [--boxes 512]

Everyone reads the same boxes of one brick's size from level 0: aligned (on the brick grid, one brick each) and offset (up to
eight bricks each), with one thread and with two; the page cache is warm. The boxes are a formula of the seed, the one in
benches/src/boxes.rs, and the bytes that each reader gets are compared by their CRC-32. Each reader runs in a process of its
own, in turn; medians.

  brickyard     Store::read_box, by the benchmark program `read`
  tensorstore   futures, 64 in flight, concurrency limited to the threads; a small cache that keeps shard indexes, not bricks
  zarrista      the Rust crate zarrs behind a thin binding, shard indexes cached; Python threads
  zarrs         the same crate as zarr-python's codec pipeline; Python threads
  zarr-python   as it is; Python threads
"""
import argparse
import json
import os
import statistics
import subprocess
import sys
import time
import zlib
from concurrent.futures import ThreadPoolExecutor

THREADS = (1, 2)
READERS = ("brickyard", "tensorstore", "zarrista", "zarrs", "zarr-python")
PLACEMENTS = ("aligned", "offset")
MASK = (1 << 64) - 1


def mix(seed, k):
    z = (seed + (k + 1) * 0x9E3779B97F4A7C15) & MASK
    z = ((z ^ z >> 30) * 0xBF58476D1CE4E5B9) & MASK
    z = ((z ^ z >> 27) * 0x94D049BB133111EB) & MASK
    return z ^ z >> 31


def boxes(seed, count, shape, edge, placement):
    """Slices in z, y, x order, as Zarr has them."""
    for i in range(count):
        corner = [mix(seed, 3 * i + a) % (n - edge + 1) for a, n in enumerate(shape[::-1])]
        if placement == "aligned":
            corner = [c // edge * edge for c in corner]
        yield tuple(slice(c, c + edge) for c in corner[::-1])


def level_0(store):
    """Shape, brick edge."""
    with open(os.path.join(store, "0", "zarr.json")) as file:
        array = json.load(file)
    sharding = next(c for c in array["codecs"] if c["name"] == "sharding_indexed")
    edges = set(sharding["configuration"]["chunk_shape"])
    assert len(array["shape"]) == 3 and len(edges) == 1, "one channel and time step, cubic bricks"
    return array["shape"], edges.pop()


def open_tensorstore(store, threads, edge):
    import tensorstore as ts

    limit = {"limit": threads}
    context = ts.Context({"cache_pool": {"total_bytes_limit": 4 << 20}, "data_copy_concurrency": limit, "file_io_concurrency": limit})
    spec = dict(driver="zarr3", kvstore=dict(driver="file", path=f"{store}/0"), recheck_cached_data=False, recheck_cached_metadata=False)
    array = ts.open(spec, context=context, open=True).result()

    def read_all(items, use):
        waiting = []
        for item in items:
            waiting.append(array[item].read())
            if len(waiting) >= 64:
                use(waiting.pop(0).result())
        for future in waiting:
            use(future.result())

    return read_all


def threaded(read, threads):
    def read_all(items, use):
        if threads == 1:
            for item in items:
                use(read(item))
            return
        with ThreadPoolExecutor(threads) as pool:
            for array in pool.map(read, items):
                use(array)

    return read_all


def open_zarrista(store, threads, edge):
    import numpy as np
    import zarrista

    array = zarrista.Array.open(zarrista.store.FilesystemStore(store), "/0")
    cache = array.shard_cache()

    def read(item):
        if all(s.start % edge == 0 for s in item):
            return np.asarray(array.retrieve_subchunk([s.start // edge for s in item], shard_cache=cache))
        return np.asarray(array.retrieve_array_subset(item))

    return threaded(read, threads)


def open_zarr(store, threads, edge, pipeline=None):
    import zarr

    zarr.config.set({"threading.max_workers": threads})
    if pipeline:
        zarr.config.set({"codec_pipeline.path": pipeline})
    array = zarr.open_array(f"{store}/0", mode="r")
    return threaded(lambda item: array[item], threads)


def open_zarrs(store, threads, edge):
    import zarrs  # noqa: F401

    return open_zarr(store, threads, edge, "zarrs.ZarrsCodecPipeline")


def worker(a):
    """One reader, in a process of its own: prints rates and the CRC-32 of all bytes."""
    shape, edge = level_0(a.store)
    opened = {"tensorstore": open_tensorstore, "zarrista": open_zarrista, "zarrs": open_zarrs, "zarr-python": open_zarr}[a.worker]
    items = {p: list(boxes(a.seed, a.boxes, shape, edge, p)) for p in PLACEMENTS}
    crc, rates = 0, {}
    for threads in THREADS:
        read_all = opened(a.store, threads, edge)
        for placement in PLACEMENTS:
            if threads == THREADS[0]:
                def use(array):
                    nonlocal crc
                    crc = zlib.crc32(array.tobytes(), crc)
                read_all(items[placement], use)
            wall, cpu = time.perf_counter(), time.process_time()
            read_all(items[placement], lambda array: None)
            wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
            rates[f"{placement} {threads}"] = dict(per_s=a.boxes / wall, per_cpu_s=a.boxes / cpu)
    print(json.dumps(dict(crc32=crc, rates=rates)))


def output_of(command):
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True)
    if done.returncode:
        sys.exit(f"{' '.join(command)}: exit code {done.returncode}")
    return json.loads(done.stdout.splitlines()[-1])


def brickyard(a, seed):
    command = [a.read, a.store, "--boxes-only", "--repetitions", "1", "--boxes", str(a.boxes), "--seed", str(seed)]
    found = output_of(command)
    rates = {f"{c['task'].removeprefix('boxes ')} {c['threads']}": dict(per_s=c["per_s"], per_cpu_s=c["per_cpu_s"]) for c in found["cases"]}
    return dict(crc32=found["boxes_crc32"], rates=rates)


def compare(a):
    rounds = []
    for repetition in range(a.repetitions):
        seed, measured = a.seed + repetition, {}
        for reader in a.readers.split(","):
            if reader == "brickyard":
                measured[reader] = brickyard(a, seed)
            else:
                own = [sys.executable, os.path.abspath(__file__), a.store, "--worker", reader, "--boxes", str(a.boxes), "--seed", str(seed)]
                measured[reader] = output_of(own)
            print(reader, measured[reader], file=sys.stderr, flush=True)
        assert len({m["crc32"] for m in measured.values()}) == 1, f"readers disagree about the bytes: {measured}"
        rounds.append(measured)

    columns = [f"{placement} {threads}" for placement in PLACEMENTS for threads in THREADS]
    print(f"{a.store}: boxes per second, {a.boxes} boxes, {a.repetitions} repetitions; in brackets per CPU second\n")
    print("| |", " | ".join(f"{c} thread{'s' if c.endswith('2') else ''}" for c in columns), "|")
    print("| --- |", " | ".join("---" for _ in columns), "|")
    for reader in rounds[0]:
        median = lambda column, key: statistics.median(r[reader]["rates"][column][key] for r in rounds)
        print(f"| {reader} |", " | ".join(f"{median(c, 'per_s'):.0f} ({median(c, 'per_cpu_s'):.0f})" for c in columns), "|")
    print()
    print(json.dumps(dict(store=a.store, boxes=a.boxes, rounds=rounds)))


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("store", type=os.path.abspath)
    ap.add_argument("--repetitions", type=int, default=3)
    ap.add_argument("--boxes", type=int, default=512)
    ap.add_argument("--seed", type=int, default=1)
    ap.add_argument("--readers", default=",".join(READERS))
    ap.add_argument("--read", default="target/release/read", help="the benchmark program")
    ap.add_argument("--worker", choices=READERS, help=argparse.SUPPRESS)
    a = ap.parse_args()
    worker(a) if a.worker else compare(a)


if __name__ == "__main__":
    main()
