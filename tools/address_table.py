#!/usr/bin/env python3
"""Requests, bytes and seconds from an address to a picture, by links of several latencies and rates.

  address_table.py STORE... [--links 0:1000,20:1000,100:100,200:10] [--size 768x768] [--turns 3] [--brickyard target/release/brickyard]
                   [--server target/release/brickyard-server]

Each store is served from this machine's disk over a link of so many milliseconds a round trip and Mbit/s, and drawn by `render`: twice with the same cache folder,
empty at first. A row has the medians of the turns: seconds, requests and bytes to the first whole picture at any level and to the settled one, then the same from the cache. The bound is
two round trips for the connection and its first answer, two more, the bytes' time on the link, and 0.3 s. A table goes to standard output.
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
    pairs = [(found["first_image_ms"], found["first_image_fetched"]), (found["settled_ms"], found["fetched"])]
    return [(ms / 1e3, fetched["requests"], fetched["bytes"]) for ms, fetched in pairs]


def turn(options, store, round_trip_ms, mbit):
    """First and settled, without and with a filled cache."""
    server = subprocess.Popen([options.server, store.parent, str(round_trip_ms), str(mbit)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    with server, tempfile.TemporaryDirectory() as folder:
        address = server.stdout.readline().strip() + store.name
        cache = f"{folder}/cache"
        found = [pair for _ in range(2) for pair in drawn(options.brickyard, address, options.size, cache, folder)]
        server.stdin.close()
        server.stdout.read()
        return found


def main():
    options = arguments()
    print("| store | link | first whole picture, s (bound) | requests, MB | settled, s | requests, MB | from the cache: first, settled, s | requests, MB |")
    print("| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: |")
    for store in options.stores:
        for link in options.links.split(","):
            round_trip_ms, mbit = (float(number) for number in link.split(":"))
            turns = [turn(options, store.resolve(), round_trip_ms, mbit) for _ in range(options.turns)]
            medians = [[statistics.median(one[i][k] for one in turns) for k in range(3)] for i in range(4)]
            first, settled, again, kept = medians
            bound = 4 * round_trip_ms / 1e3 + first[2] * 8 / (mbit * 1e6) + 0.3
            pair = lambda row: f"{row[1]:.0f}, {row[2] / 1e6:.2f}"
            print(
                f"| {store.name} | {round_trip_ms:g} ms, {mbit:g} Mbit/s | {first[0]:.2f} ({bound:.2f}) | {pair(first)} | {settled[0]:.2f} | {pair(settled)} "
                f"| {again[0]:.2f}, {kept[0]:.2f} | {pair(kept)} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
