"""Claims and turns as Python code on known numbers: the quick way of runs."""
