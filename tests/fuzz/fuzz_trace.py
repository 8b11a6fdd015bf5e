"""Fuzz the decoding and replaying of traces.

python -m tests.fuzz.fuzz_trace [FLAG OF LIBFUZZER ...]
"""

import sys

from tests.fuzz.driving import fuzz

if __name__ == "__main__":
    sys.exit(fuzz("tests.fuzz.traces", sys.argv[1:]))
