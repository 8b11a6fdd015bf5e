"""Fuzz the reading, checking and laying out of programs.

python -m tests.fuzz.fuzz_text [FLAG OF LIBFUZZER ...]
"""

import sys

from tests.fuzz.driving import fuzz

if __name__ == "__main__":
    sys.exit(fuzz("tests.fuzz.texts", sys.argv[1:]))
