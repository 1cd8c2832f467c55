"""Prints the licences of the command and of all crates that are linked into it, texts included.

    cargo metadata --format-version 1 --filter-platform TARGET | python3 tools/licences.py
"""

import collections
import json
import sys
from pathlib import Path

ROOT = "brickyard-cli"


def linked(metadata):
    """The packages that the command links: what it needs but for building and testing."""
    nodes = {node["id"]: node for node in metadata["resolve"]["nodes"]}
    packages = {package["id"]: package for package in metadata["packages"]}
    todo = [id for id, package in packages.items() if package["name"] == ROOT]
    seen = set()
    while todo:
        id = todo.pop()
        if id in seen:
            continue
        seen.add(id)
        for dependency in nodes[id]["deps"]:
            if any(kind["kind"] is None for kind in dependency["dep_kinds"]):
                todo.append(dependency["pkg"])
    return sorted((packages[id] for id in seen), key=lambda package: (package["name"], package["version"]))


def texts(package):
    """The licence texts in a package, those of fonts and C sources that come with it among them."""
    folder = Path(package["manifest_path"]).parent
    words = ("licen", "copying", "notice", "copyright", "ofl", "ufl")
    files = [path for path in folder.rglob("*") if path.is_file() and path.suffix in ("", ".md", ".txt")]
    named = [path for path in files if any(word in path.name.lower() for word in words) or path.parent.name.lower().startswith("licen")]
    return [path.read_text(errors="replace").strip() for path in sorted(named)]


def main():
    packages = linked(json.load(sys.stdin))
    print("brickyard is built of these crates:\n")
    by_text = collections.defaultdict(list)
    for package in packages:
        is_own = package["source"] is None
        name = f"{package['name']} {package['version']}"
        print(f"{name}: {package['license'] or package['license_file']}" + ("" if is_own else f", {package['repository']}"))
        # brickyard's own texts lie beside this list.
        for text in [] if is_own else texts(package):
            by_text[text].append(name)
    for text, names in by_text.items():
        print(f"\n{'-' * 80}\n{', '.join(names)}\n{'-' * 80}\n\n{text}")


main()
