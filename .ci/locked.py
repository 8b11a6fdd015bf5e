"""What `uv.lock` wants of this Python, as requirements with hashes: for those who have pip alone.

`python .ci/locked.py EXTRA…` prints what `pip install --require-hashes -r` reads. Run it with the
Python that will be installed for, for markers are evaluated; of koord itself nothing is printed.
"""

import sys
import tomllib
from pathlib import Path
from typing import Any

from pip._vendor.packaging.markers import Marker

LOCK = Path(__file__).resolve().parent.parent / "uv.lock"


def requirements(extras: list[str]) -> list[str]:
    """One line for each package that koord with these extras needs here."""
    packages: list[dict[str, Any]] = tomllib.loads(LOCK.read_text(encoding="utf-8"))["package"]
    found: dict[str, str] = {}
    (koord,) = [package for package in packages if package["name"] == "koord"]
    waiting = [*koord["dependencies"]]
    for extra in extras:
        waiting += koord["optional-dependencies"][extra]
    while waiting:
        wanted = waiting.pop()
        if wanted["name"] in found or not _applies(wanted):
            continue
        (package,) = [
            package
            for package in packages
            if package["name"] == wanted["name"]
            and package["version"] == wanted.get("version", package["version"])
        ]
        files = [*package.get("wheels", []), *filter(None, [package.get("sdist")])]
        hashes = " ".join(f"--hash={file['hash']}" for file in files)
        found[package["name"]] = f"{package['name']}=={package['version']} {hashes}"
        waiting += package.get("dependencies", [])
    return sorted(found.values())


def _applies(wanted: dict[str, Any]) -> bool:
    return "marker" not in wanted or Marker(wanted["marker"]).evaluate({"extra": ""})


if __name__ == "__main__":
    print("\n".join(requirements(sys.argv[1:])))
