"""What the scripts that measure `brickyard` have in common: running it, its memory, and a line of flags of which those behind `--` are the scene's."""
import dataclasses
import os
import pathlib
import subprocess
import sys
import tempfile
import time

UNITS = {"KiB": 1 << 10, "MiB": 1 << 20, "GiB": 1 << 30}


def bytes_of(words):
    """Bytes of words like 512MiB."""
    return int(words[:-3]) * UNITS[words[-3:]]


@dataclasses.dataclass
class Measured:
    """A command's outcome. `most_bytes` is its greatest anonymous and shared memory, as the kernel counts it, if watched."""

    output: str
    seconds: float
    cpu_s: float
    most_bytes: int


def measured(command, is_watched=True):
    """Runs a command to its end; where it fails, ends with what it says. To be timed closely it is not watched: counting its memory holds up its maps."""
    with tempfile.TemporaryFile("w+") as output, tempfile.TemporaryFile("w+") as errors:
        started, most_bytes, ended = time.monotonic(), 0, 0
        process = subprocess.Popen([str(word) for word in command], stdout=output, stderr=errors)
        while is_watched and not ended:
            most_bytes = max(most_bytes, held_bytes(process.pid))
            time.sleep(0.002)
            ended, status, used = os.wait4(process.pid, os.WNOHANG)
        if not ended:
            _, status, used = os.wait4(process.pid, 0)
        seconds = time.monotonic() - started
        process.returncode = os.waitstatus_to_exitcode(status)
        output.seek(0)
        errors.seek(0)
        if process.returncode:
            sys.exit(f"{' '.join(map(str, command))}: exit code {process.returncode}: {errors.read()}")
        return Measured(output.read(), seconds, used.ru_utime + used.ru_stime, most_bytes)


def held_bytes(process):
    """A process's anonymous and shared memory; mapped files are the page cache's."""
    try:
        status = pathlib.Path(f"/proc/{process}/status").read_text()
    except OSError:
        return 0
    fields = dict(line.split(":", 1) for line in status.splitlines() if ":" in line)
    return sum(int(fields.get(name, "0 kB").split()[0]) << 10 for name in ("RssAnon", "RssShmem"))


def run(command):
    """What a command writes to standard output; where it fails, the end."""
    process = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    if process.returncode:
        sys.exit(f"{' '.join(command)}: exit code {process.returncode}: {process.stderr}")
    return process.stdout


def arguments(ap):
    """The script's own arguments; `scene` has those behind `--`."""
    own, scene = sys.argv[1:], []
    if "--" in own:
        at = own.index("--")
        own, scene = own[:at], own[at + 1 :]
    a = ap.parse_args(own)
    a.scene = scene
    return a
