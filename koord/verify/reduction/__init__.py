"""Reductions: slicing and abstraction of the program before engines run. [T-CONE]"""
