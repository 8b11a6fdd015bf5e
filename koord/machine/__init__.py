"""Machine code by LLVM, and how it is loaded."""
