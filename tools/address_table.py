#!/usr/bin/env python3
"""Requests, bytes and seconds from an address to a picture, by links of several latencies and rates.

  address_table.py STORE... [--links 0:1000,20:1000,100:100,200:10] [--size 768x768] [--turns 3] [--brickyard target/release/brickyard]
                   [--server target/release/brickyard-server]

Each store is served from this machine's disk over a link of so many milliseconds a round trip and Mbit/s, and drawn by `render`: twice with the same cache folder,
empty at first. A row has the medians of the turns: seconds until the bricks of the first whole picture, at any level, are here and until it is drawn, requests and bytes until
then; the same of the settled picture, its bytes also by those of bricks that the same picture reads of the store on disk; and all of it from the cache. The bound is two round trips for the connection and its first
answer, two more, the bytes' time on the link, and 0.3 s. A table goes to standard output.
"""
import argparse
import json
import os
import pathlib
import statistics
import subprocess
import tempfile


def arguments():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("stores", nargs="+", type=pathlib.Path)
    ap.add_argument("--links", default="0:1000,20:1000,100:100,200:10")
    ap.add_argument("--size", default="768x768")
    ap.add_argument("--turns", default=3, type=int)
    ap.add_argument("--brickyard", default="target/release/brickyard", type=pathlib.Path)
    ap.add_argument("--server", default="target/release/brickyard-server", type=pathlib.Path)
    return ap.parse_args()


def drawn(brickyard, address, size, cache, folder):
    """Statistics of one picture, of a new process."""
    stats = pathlib.Path(folder, "stats.json")
    command = [brickyard, "render", address, "-o", f"{folder}/picture.png", "--overwrite", "--size", size, "--backend", "cpu", "--stats", stats]
    environment = {**os.environ, "BRICKYARD_CACHE": cache}
    subprocess.run([str(word) for word in command], check=True, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    found = json.loads(stats.read_text())
    first, settled = found["first_image_fetched"], found["fetched"]
    drawn_ms = found["first_image_ms"]
    return {
        "here": (drawn_ms - found["first_draw_ms"]) / 1e3,
        "first": drawn_ms / 1e3,
        "first_requests": first["requests"],
        "first_bytes": first["bytes"],
        "settled": found["settled_ms"] / 1e3,
        "requests": settled["requests"],
        "bytes": settled["bytes"],
        "read": found["bytes"]["read"],
    }


def needed_bytes(options, store):
    """Compressed bytes of bricks read for the picture on disk; `None` of another program's image, whose decoded bytes alone are counted."""
    root = store / "zarr.json"
    if not root.exists() or "brickyard" not in json.loads(root.read_text())["attributes"]:
        return None
    with tempfile.TemporaryDirectory() as folder:
        return drawn(options.brickyard, store, options.size, f"{folder}/cache", folder)["read"]


def turn(options, store, round_trip_ms, mbit):
    """One picture without and one with a filled cache."""
    server = subprocess.Popen([options.server, store.parent, str(round_trip_ms), str(mbit)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    with server, tempfile.TemporaryDirectory() as folder:
        address = server.stdout.readline().strip() + store.name
        cache = f"{folder}/cache"
        found = [drawn(options.brickyard, address, options.size, cache, folder) for _ in range(2)]
        server.stdin.close()
        server.stdout.read()
        return found


def main():
    options = arguments()
    print("| store | link | first picture here (bound), drawn, s | requests, MB | settled, s | requests, MB (by needed) | from the cache: here, drawn, settled, s | requests, MB |")
    print("| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: |")
    for store in options.stores:
        needed = needed_bytes(options, store)
        for link in options.links.split(","):
            round_trip_ms, mbit = (float(number) for number in link.split(":"))
            turns = [turn(options, store.resolve(), round_trip_ms, mbit) for _ in range(options.turns)]
            new, kept = [{name: statistics.median(one[i][name] for one in turns) for name in turns[0][i]} for i in range(2)]
            by_needed = f" ({new['bytes'] / needed:.2f})" if needed else ""
            bound = 4 * round_trip_ms / 1e3 + new["first_bytes"] * 8 / (mbit * 1e6) + 0.3
            print(
                f"| {store.name} | {round_trip_ms:g} ms, {mbit:g} Mbit/s | {new['here']:.2f} ({bound:.2f}), {new['first']:.2f} | {new['first_requests']:.0f}, {new['first_bytes'] / 1e6:.2f} "
                f"| {new['settled']:.2f} | {new['requests']:.0f}, {new['bytes'] / 1e6:.2f}{by_needed} "
                f"| {kept['here']:.2f}, {kept['first']:.2f}, {kept['settled']:.2f} | {kept['requests']:.0f}, {kept['bytes'] / 1e6:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
