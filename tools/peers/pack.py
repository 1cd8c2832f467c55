#!/usr/bin/env python3
"""Packing a raw volume beside tensorstore.

  pack.py RAW --shape X,Y,Z --dtype u8 [--codec zstd:3] [--repetitions 3]

Compared are a loop over tensorstore's zarr3 driver, `brickyard pack` with the same codec and level, and `brickyard pack`
as it is. All write chunks of 64^3 voxels with a crc32c each in shards of 512^3, and halve until one chunk is left, by the
mean. The loop writes shard after shard, or several at a time (--in-flight 1,2: a row each), and makes each level from the
one it wrote before.

Each runs in a process of its own, in turn. The input is in the page cache; the output goes to the same folder and is deleted
again. wall: seconds; for the loop without starting Python and importing. CPU: user and system seconds of all threads.
memory: the peak of anonymous memory, sampled. Ratios are medians over repetitions.
"""
import argparse
import json
import os
import random
import shutil
import statistics
import subprocess
import sys
import time
from pathlib import Path

CHUNK, SHARD = 64, 512
DTYPES = {"u8": "uint8", "i8": "int8", "u16": "uint16", "i16": "int16", "f32": "float32"}


def codec_json(codec, itemsize):
    """The Zarr codec chain that `brickyard pack --codec` writes."""
    kind, level = codec.split(":")
    if kind == "shuffle-zstd" and itemsize > 1:
        # Blosc's level n stands for Zstandard's 2 n - 1.
        blosc = dict(cname="zstd", clevel=(int(level) + 1) // 2, shuffle="shuffle", typesize=itemsize, blocksize=0)
        compression = dict(name="blosc", configuration=blosc)
    else:
        compression = dict(name="zstd", configuration=dict(level=int(level), checksum=False))
    little = dict(name="bytes", configuration=dict(endian="little"))
    index = [little, dict(name="crc32c")]
    inner = [little, compression, dict(name="crc32c")]
    sharding = dict(chunk_shape=[CHUNK] * 3, codecs=inner, index_codecs=index)
    return [dict(name="sharding_indexed", configuration=sharding)]


def level_shapes(shape):
    shapes = [shape]
    while max(shapes[-1]) > CHUNK:
        shapes.append([-(-n // 2) for n in shapes[-1]])
    return shapes


def boxes(shape, edge):
    for z in range(0, shape[0], edge[0]):
        for y in range(0, shape[1], edge[1]):
            for x in range(0, shape[2], edge[2]):
                yield tuple(slice(o, min(o + e, n)) for o, e, n in zip((z, y, x), edge, shape))


def tensorstore_loop(a):
    """The peer: runs in a process of its own and prints what it took."""
    import numpy as np
    import tensorstore as ts

    shape = a.shape[::-1]
    source = np.memmap(a.raw, np.dtype(DTYPES[a.dtype]).newbyteorder("<"), "r", shape=tuple(shape))
    limit = {"limit": a.threads}
    context = ts.Context({"data_copy_concurrency": limit, "file_io_concurrency": limit, "cache_pool": {"total_bytes_limit": 0}})
    wall, cpu = time.perf_counter(), time.process_time()
    finer = None
    for k, n in enumerate(level_shapes(shape)):
        shard = [min(SHARD, -(-v // CHUNK) * CHUNK) for v in n]
        metadata = dict(shape=n, data_type=DTYPES[a.dtype], fill_value=0, codecs=codec_json(a.codec, source.itemsize),
                        chunk_grid=dict(name="regular", configuration=dict(chunk_shape=shard)))
        spec = dict(driver="zarr3", kvstore=dict(driver="file", path=f"{a.worker}/{k}"), metadata=metadata)
        level = ts.open(spec, create=True, delete_existing=True, context=context).result()
        coarse = None if finer is None else ts.downsample(finer, [2, 2, 2], "mean")
        writes = []
        for box in boxes(n, shard):
            writes.append(level[box].write(source[box] if coarse is None else coarse[box].read().result()))
            if len(writes) >= a.in_flight[0]:
                writes.pop(0).result()
        for write in writes:
            write.result()
        finer = level
    print(json.dumps(dict(wall_s=time.perf_counter() - wall, cpu_s=time.process_time() - cpu)))


def anonymous_bytes(pid):
    try:
        status = Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return 0
    return max((int(line.split()[1]) * 1024 for line in status.splitlines() if line.startswith("RssAnon")), default=0)


def run(command):
    """Runs a program to its end: wall, CPU, peak anonymous memory, standard output."""
    start = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    peak = 0
    while True:
        pid, status, usage = os.wait4(process.pid, os.WNOHANG)
        if pid:
            break
        peak = max(peak, anonymous_bytes(process.pid))
        time.sleep(0.01)
    wall = time.perf_counter() - start
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        sys.exit(f"{' '.join(command)}: exit code {process.returncode}")
    return dict(wall_s=wall, cpu_s=usage.ru_utime + usage.ru_stime, memory=peak), process.stdout.read()


def stored_bytes(store):
    return sum(p.lstat().st_size for p in Path(store).rglob("*") if p.is_file())


def check(store, a):
    """Some boxes of level 0 must be the input's."""
    import numpy as np
    import tensorstore as ts

    shape = a.shape[::-1]
    source = np.memmap(a.raw, np.dtype(DTYPES[a.dtype]).newbyteorder("<"), "r", shape=tuple(shape))
    level = ts.open(dict(driver="zarr3", kvstore=dict(driver="file", path=f"{store}/0")), open=True).result()
    levels = sum((Path(store) / str(k) / "zarr.json").exists() for k in range(64))
    assert levels == len(level_shapes(shape)), f"{store} has {levels} levels"
    where = random.Random(1)
    for _ in range(16):
        box = tuple(slice(o, o + CHUNK) for o in (where.randrange(max(n - CHUNK, 0) + 1) for n in shape))
        assert np.array_equal(level[box].read().result(), source[box]), f"{store} differs at {box}"


def commands(a, store):
    """What is compared, by name; the first is the peer that ratios are to."""
    shape = ",".join(map(str, a.shape))
    own = [sys.executable, os.path.abspath(__file__), a.raw, "--shape", shape, "--dtype", a.dtype, "--codec", a.codec, "--threads", str(a.threads)]
    pack = [a.brickyard, "pack", a.raw, store, "--shape", shape, "--dtype", a.dtype, "-j", str(a.threads), "--memory", a.memory, "--progress", "none"]
    peers = {f"tensorstore {a.codec}, {n} in flight": own + ["--in-flight", str(n), "--worker", store] for n in a.in_flight}
    return peers | {f"brickyard {a.codec}": pack + ["--codec", a.codec], "brickyard, default codec": pack}


def compare(a):
    os.makedirs(a.out, exist_ok=True)
    store = os.path.join(a.out, "pack.zarr")
    rounds = []
    for repetition in range(a.repetitions):
        measured = {}
        for name, command in commands(a, store).items():
            shutil.rmtree(store, ignore_errors=True)
            os.sync()
            with open(a.raw, "rb") as raw:
                while raw.read(1 << 26):
                    pass
            result, output = run(command)
            if "--worker" in command:
                result |= json.loads(output.splitlines()[-1])
            result["bytes"] = stored_bytes(store)
            if repetition == 0:
                check(store, a)
            measured[name] = result
            print(name, {k: round(v, 2) for k, v in result.items()}, file=sys.stderr, flush=True)
        rounds.append(measured)
    shutil.rmtree(store, ignore_errors=True)

    peer = next(iter(rounds[0]))
    median = lambda name, key: statistics.median(r[name][key] for r in rounds)
    ratio = lambda name, key: statistics.median(r[name][key] / r[peer][key] for r in rounds)
    print(f"{os.path.basename(a.raw)}, {a.threads} threads, {a.repetitions} repetitions\n")
    print("| | wall s | CPU s | memory MiB | ratio of wall | ratio of CPU | input / output |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    raw_bytes = os.path.getsize(a.raw)
    for name in rounds[0]:
        print(f"| {name} | {median(name, 'wall_s'):.2f} | {median(name, 'cpu_s'):.2f} | {median(name, 'memory') / 2**20:.0f} "
              f"| {ratio(name, 'wall_s'):.2f} | {ratio(name, 'cpu_s'):.2f} | {raw_bytes / median(name, 'bytes'):.2f} |")
    print()
    print(json.dumps(dict(raw=a.raw, dtype=a.dtype, codec=a.codec, threads=a.threads, rounds=rounds)))


def numbers(text):
    return [int(v) for v in text.split(",")]


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("raw", help="headerless little-endian file, x fastest")
    ap.add_argument("--shape", type=numbers, required=True, metavar="X,Y,Z")
    ap.add_argument("--dtype", choices=DTYPES, required=True)
    ap.add_argument("--codec", default="zstd:3", help="zstd:N or shuffle-zstd:N, for the comparison at the same codec")
    ap.add_argument("--repetitions", type=int, default=3)
    ap.add_argument("--threads", type=int, default=os.cpu_count())
    ap.add_argument("--in-flight", type=numbers, default=[1], metavar="N,...", help="shards that the loop writes at a time")
    ap.add_argument("--memory", default="1GiB", help="brickyard's --memory")
    ap.add_argument("--brickyard", default="target/release/brickyard")
    ap.add_argument("--out", default="target/peers", help="folder for the stores")
    ap.add_argument("--worker", metavar="STORE", help=argparse.SUPPRESS)
    a = ap.parse_args()
    tensorstore_loop(a) if a.worker else compare(a)


if __name__ == "__main__":
    main()
