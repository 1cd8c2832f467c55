#!/usr/bin/env python3
"""Runs the commands of docs/guide/tours.md, as a newcomer does, and says where their output is not what the page shows.

  tours.py [FOLDER] [--brickyard target/release/brickyard] [--only WORD] [--write]

Commands are the lines that begin with `$ ` in the page's console blocks. They run in FOLDER [target/tours], which is emptied first and gets the
files of `tools/example-data`. Output is standard output and error together, without progress.
A line `...` of the page stands for any lines. Times, rates and the line of the backend may differ. A command that is to fail is followed by
its exit code: `echo $?`. A comment `<!-- picture: NAME.png = A.png B.png -->` puts pictures side by side into docs/images/NAME.png.

`--write` puts what was really said into the page, where it differs. `--only WORD` runs the chapters whose heading has the word.
The Python that runs this needs numpy, pillow, tifffile, pydicom, h5py, zarr and SimpleITK: target/python/bin/python after `tools/setup python`.
"""
import argparse
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

from PIL import Image

TOP = Path(__file__).resolve().parent.parent
PAGE, IMAGES = TOP / "docs/guide/tours.md", TOP / "docs/images"
PROGRESS = re.compile(r"^\w+: +\d+ %.*\n", re.M)
# What differs from machine to machine and from run to run.
VARIABLE = [(re.compile(r"^backend: .*", re.M), "backend"), (re.compile(r"\d+(\.\d+)? (ms|s|MB/s)\b"), "N"), (re.compile(r"at most .* of memory"), "M")]
PX, LIMIT = 320, 120_000


def comparable(text):
    for pattern, word in VARIABLE:
        text = pattern.sub(word, text)
    return text.rstrip()


def agrees(shown, said):
    """Whether the page's lines, of which `...` is any number, are what was said."""
    parts = [re.escape(part) for part in re.split(r"^ *\.\.\.\n?", comparable(shown) + "\n", flags=re.M)]
    return re.fullmatch(r"(?:.*\n)*?".join(parts), comparable(said) + "\n") is not None


class Shell:
    """One bash for all commands, so that `echo $?` and variables work."""

    def __init__(self, folder, brickyard):
        (folder / "bin").mkdir()
        os.symlink(brickyard, folder / "bin/brickyard")
        path = f"{folder / 'bin'}:{Path(sys.executable).parent}:{os.environ['PATH']}"
        self.bash = subprocess.Popen(["bash"], cwd=folder, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                                     env=dict(os.environ, PATH=path))

    def say(self, command):
        end = "== end of a command =="
        # What the command left in $? is put back for the next one.
        self.bash.stdin.write(f"{command}\n__code=$?; echo; echo '{end}'; (exit $__code)\n")
        self.bash.stdin.flush()
        lines = []
        while (line := self.bash.stdout.readline()).strip() != end:
            if not line:
                sys.exit(f"{command}: the shell has ended")
            lines.append(line)
        return PROGRESS.sub("", "".join(lines)).removesuffix("\n")


def run_block(shell, block, chapter):
    """The block as it would be with what was said; the number of differences."""
    written, differences = "", 0
    for part in re.split(r"^(?=\$ )", block, flags=re.M):
        if not part.startswith("$ "):
            continue
        lines = part.splitlines(keepends=True)
        long = 1
        while lines[long - 1].rstrip().endswith("\\"):
            long += 1
        command, shown = "".join(lines[:long])[2:], "".join(lines[long:])
        start = time.perf_counter()
        said = shell.say(re.sub(r"  +# .*", "", command).rstrip("\n"))
        print(f"{time.perf_counter() - start:6.2f} s  {chapter}: {command.splitlines()[0][:110]}", flush=True)
        if not agrees(shown, said):
            print(f"--- the page shows\n{shown}--- was said\n{said}---")
            shown, differences = said if said.endswith("\n") or not said else said + "\n", differences + 1
        written += f"$ {command}{shown}"
    return written, differences


def join_pictures(folder, name, parts):
    """Side by side, where that takes more than LIMIT bytes in 256 colours."""
    pictures = [Image.open(folder / part).convert("RGB") for part in parts]
    pictures = [picture.resize((PX, PX * picture.height // picture.width), Image.LANCZOS) for picture in pictures]
    whole = Image.new("RGB", (PX * len(pictures), max(picture.height for picture in pictures)))
    for i, picture in enumerate(pictures):
        whole.paste(picture, (PX * i, 0))
    file = IMAGES / name
    whole.save(file, optimize=True)
    if file.stat().st_size > LIMIT:
        whole.quantize(256, Image.Quantize.MAXCOVERAGE, kmeans=3, dither=Image.Dither.NONE).save(file, optimize=True)
    print(f"{file.relative_to(TOP)}: {file.stat().st_size // 1000} kB")


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("folder", nargs="?", type=Path, default=TOP / "target/tours")
    ap.add_argument("--brickyard", type=Path, default=TOP / "target/release/brickyard")
    ap.add_argument("--data", type=Path, default=TOP / "target/data", help="where head-ct.raw may lie already")
    ap.add_argument("--only", default="", metavar="WORD")
    ap.add_argument("--write", action="store_true")
    a = ap.parse_args()
    folder = a.folder.resolve()
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    subprocess.run([sys.executable, TOP / "tools/example-data", folder, "--brickyard", a.brickyard, "--data", a.data], check=True)
    shell, differences, page = Shell(folder, a.brickyard.resolve()), 0, PAGE.read_text()
    chapters = re.split(r"^(?=## )", page, flags=re.M)
    for i, chapter in enumerate(chapters):
        heading = chapter.splitlines()[0].lstrip("# ")
        if a.only.lower() not in heading.lower():
            continue
        start = time.perf_counter()
        # Odd parts are what console blocks hold.
        parts = re.split(r"(?<=^```console\n)(.*?)(?=^```$)", chapter, flags=re.M | re.S)
        for j in range(1, len(parts), 2):
            parts[j], more = run_block(shell, parts[j], heading)
            differences += more
        chapters[i] = "".join(parts)
        print(f"{time.perf_counter() - start:6.2f} s  {heading}, all commands")
        for name, files in re.findall(r"<!-- picture: (\S+) = (.*?) -->", chapter):
            join_pictures(folder, name, files.split())
    if a.write:
        PAGE.write_text("".join(chapters))
    sys.exit(1 if differences and not a.write else 0)


if __name__ == "__main__":
    main()
