// Make what the worker loads of Python: node compile.mjs STDLIB.zip PACKAGES.zip FOLDER
//
// Sources are compiled by the version that is to load them, in Node.js, since a browser would do
// so each time. The standard library becomes FOLDER/python_stdlib.zip, and all packages
// FOLDER/packages.bin. FOLDER/python.bin is the memory of a Python that has just begun. The last two
// are packed with gzip, which browsers unpack beside all else; they are not called so, as there are
// servers that would have them unpacked on the way.

import { readFileSync, writeFileSync } from "node:fs";
import { gzipSync } from "node:zlib";
import { loadPyodide } from "pyodide";

const [, , stdlib, packages, folder] = process.argv;
const compiler = await loadPyodide();
compiler.FS.writeFile("/stdlib.zip", readFileSync(stdlib));
compiler.FS.writeFile("/packages.zip", readFileSync(packages));
compiler.runPython(`
import compileall, io, pathlib, tarfile, zipfile

def compiled(sources, name):
    """The files of an archive, in their order, with what is compiled in place of sources."""
    root = pathlib.Path(f"/{name}")
    with zipfile.ZipFile(sources) as archive:
        archive.extractall(root)
    if not compileall.compile_dir(root, quiet=1, legacy=True, stripdir=root):
        raise SystemExit("something does not compile")
    for path in sorted(root.rglob("*")):
        if path.is_file() and path.suffix != ".py":
            yield path.relative_to(root).as_posix(), path.read_bytes()

# Without times, so that the same sources make the same bytes.
with zipfile.ZipFile("/to.zip", "w") as made:
    for name, data in compiled("/stdlib.zip", "stdlib"):
        made.writestr(zipfile.ZipInfo(name), data, zipfile.ZIP_DEFLATED)
with tarfile.open("/to.tar", "w", format=tarfile.USTAR_FORMAT) as made:
    for name, data in compiled("/packages.zip", "packages"):
        info = tarfile.TarInfo(name)
        info.size = len(data)
        made.addfile(info, io.BytesIO(data))
`);
const stdLibURL = `${folder}/python_stdlib.zip`;
writeFileSync(stdLibURL, compiler.FS.readFile("/to.zip"));
writeFileSync(`${folder}/packages.bin`, gzipSync(compiler.FS.readFile("/to.tar"), { level: 9 }));

// What koord imports of the standard library is there from the start.
const python = await loadPyodide({ stdLibURL, _makeSnapshot: true });
python.runPython(`
import argparse, collections.abc, contextlib, ctypes, dataclasses, datetime, decimal, difflib, enum
import fractions, functools, gc, gettext, hashlib, heapq, html, importlib.resources, itertools, json
import logging, math, pickle, platform, queue, random, re, shlex, statistics, string, subprocess
import tempfile, textwrap, threading, typing, unicodedata, urllib.parse, uuid, zipfile
`);
writeFileSync(`${folder}/python.bin`, gzipSync(python.makeMemorySnapshot(), { level: 9 }));
