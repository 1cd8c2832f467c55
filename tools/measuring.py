"""What the scripts that measure `brickyard` have in common: running it, and a line of flags of which those behind `--` are the scene's."""
import subprocess
import sys


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
