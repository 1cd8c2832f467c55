#!/usr/bin/env python3
"""A store at an address by neuroglancer, in headless Chromium, and by brickyard: requests, bytes and seconds to the first picture of the whole volume in 3D.

  addresses.py STORE... [--links 0:1000,100:100] [--size 512x512] [--depth-samples 64] [--turns 3] [--pictures FOLDER]
               [--brickyard target/release/brickyard] [--server target/release/brickyard-server]

Both read from the same server, over a link of so many milliseconds a round trip and Mbit/s, and draw in software. neuroglancer has its own settings but for volume rendering, and as many samples along a ray as told,
which choose its level. Its seconds begin when it is told of the store, with its own code loaded, and end with the picture of all that it asks for; brickyard's begin with its process, and end with its first whole
picture, at any level, then with the settled one. Needs the packages neuroglancer and selenium, and chromium with
chromedriver.
"""
import argparse
import json
import os
import pathlib
import statistics
import subprocess
import tempfile
import time

import neuroglancer
import selenium.webdriver
from selenium.webdriver.support.wait import WebDriverWait

FLAGS = ["--headless=new", "--no-sandbox", "--disable-web-security", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-background-networking", "--disable-component-update", "--disable-sync", "--no-first-run"]


def arguments():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("stores", nargs="+", type=pathlib.Path)
    ap.add_argument("--links", default="0:1000,100:100")
    ap.add_argument("--size", default="512x512")
    ap.add_argument("--depth-samples", default=64, type=int)
    ap.add_argument("--turns", default=3, type=int)
    ap.add_argument("--pictures", type=pathlib.Path)
    ap.add_argument("--brickyard", default="target/release/brickyard", type=pathlib.Path)
    ap.add_argument("--server", default="target/release/brickyard-server", type=pathlib.Path)
    return ap.parse_args()


class Served:
    """A server of a store's folder, and the requests that it answered."""

    def __init__(self, options, store, link):
        round_trip_ms, mbit = link.split(":")
        command = [options.server, store.parent, round_trip_ms, mbit]
        self.process = subprocess.Popen([str(word) for word in command], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.address = self.process.stdout.readline().strip() + store.name

    def end(self):
        """Requests and bytes."""
        self.process.stdin.close()
        answers = self.process.stdout.read().splitlines()
        self.process.wait()
        return len(answers), sum(int(answer.split()[-2]) for answer in answers)


def by_neuroglancer(options, store, link, picture):
    served = Served(options, store, link)
    width, height = (int(number) for number in options.size.split("x"))
    chrome = selenium.webdriver.ChromeOptions()
    for flag in [*FLAGS, f"--window-size={width},{height}"]:
        chrome.add_argument(flag)
    chrome.binary_location = "/usr/bin/chromium"
    driver = selenium.webdriver.Chrome(options=chrome, service=selenium.webdriver.ChromeService("/usr/bin/chromedriver"))
    try:
        viewer = neuroglancer.Viewer()
        driver.get(viewer.get_viewer_url())
        # Its own code is here before the layer is told, so that the seconds are those of the data.
        WebDriverWait(driver, 60).until(lambda driver: driver.execute_script("return typeof viewer === 'object' && document.readyState === 'complete'"))
        with viewer.txn() as state:
            state.layers["volume"] = neuroglancer.ImageLayer(source=f"zarr://{served.address}", volume_rendering=True, volume_rendering_depth_samples=options.depth_samples)
            state.layout = "3d"
            state.show_slices = False
        told = time.time()
        # Waits until all chunks in view are here.
        shot = viewer.screenshot(size=[width, height]).screenshot
        drawn_s = time.time() - told
        if picture:
            picture.write_bytes(shot.image)
    finally:
        driver.quit()
    requests, sent = served.end()
    return {"requests": requests, "bytes": sent, "drawn": drawn_s}


def by_brickyard(options, store, link, picture):
    served = Served(options, store, link)
    with tempfile.TemporaryDirectory() as folder:
        stats, drawn = pathlib.Path(folder, "stats.json"), picture or pathlib.Path(folder, "picture.png")
        command = [options.brickyard, "render", served.address, "-o", drawn, "--overwrite", "--size", options.size, "--backend", "cpu", "--stats", stats]
        environment = {**os.environ, "BRICKYARD_CACHE": f"{folder}/cache"}
        subprocess.run([str(word) for word in command], check=True, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        found = json.loads(stats.read_text())
    served.end()
    first = found["first_image_fetched"]
    return {
        "requests": first["requests"],
        "bytes": first["bytes"],
        "drawn": found["first_image_ms"] / 1e3,
        "settled": found["settled_ms"] / 1e3,
        "settled_requests": found["fetched"]["requests"],
        "settled_bytes": found["fetched"]["bytes"],
    }


def main():
    options = arguments()
    print("| store | link | neuroglancer: picture, s | requests, MB | brickyard: first picture, s | requests, MB | settled, s | requests, MB |")
    print("| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: |")
    for store in (store.resolve() for store in options.stores):
        for link in options.links.split(","):
            name = lambda program: options.pictures and options.pictures / f"{store.stem}-{link.replace(':', '-')}-{program}.png"
            turns = [
                (by_neuroglancer(options, store, link, name("neuroglancer")), by_brickyard(options, store, link, name("brickyard"))) for _ in range(options.turns)
            ]
            theirs, ours = [{key: statistics.median(turn[i][key] for turn in turns) for key in turns[0][i]} for i in range(2)]
            round_trip, mbit = link.split(":")
            print(
                f"| {store.name} | {round_trip} ms, {mbit} Mbit/s | {theirs['drawn']:.2f} | {theirs['requests']:.0f}, {theirs['bytes'] / 1e6:.2f} | {ours['drawn']:.2f} | {ours['requests']:.0f}, {ours['bytes'] / 1e6:.2f} "
                f"| {ours['settled']:.2f} | {ours['settled_requests']:.0f}, {ours['settled_bytes'] / 1e6:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
