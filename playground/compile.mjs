// Compile the Python of an archive for the Python of browsers: node compile.mjs FROM.zip TO.zip
//
// The version that runs it compiles it, in Node.js: a browser then loads what is compiled, which
// takes it a third of the time.

import { readFileSync, writeFileSync } from "node:fs";
import { loadPyodide } from "pyodide";

const [, , from, to] = process.argv;
const python = await loadPyodide();
python.FS.writeFile("/from.zip", readFileSync(from));
python.runPython(`
import compileall, pathlib, zipfile

root = pathlib.Path("/packages")
with zipfile.ZipFile("/from.zip") as archive:
    archive.extractall(root)
if not compileall.compile_dir(root, quiet=1, legacy=True, stripdir="/packages"):
    raise SystemExit("something does not compile")
with zipfile.ZipFile("/to.zip", "w", zipfile.ZIP_DEFLATED) as archive:
    for path in sorted(root.rglob("*")):
        if path.is_file() and path.suffix != ".py":
            # Always at the same moment, so that the same sources make the same bytes.
            archive.writestr(zipfile.ZipInfo(str(path.relative_to(root))), path.read_bytes(), zipfile.ZIP_DEFLATED)
`);
writeFileSync(to, python.FS.readFile("/to.zip"));
