"""Translation of programs to TLA+ modules, for TLC."""
