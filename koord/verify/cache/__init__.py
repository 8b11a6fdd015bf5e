"""Kept verdicts: what they depend on, how they are written, and where they are.

A verdict is a fact about a slice of a program. It is shown again for a program whose own slice by
the same parts is the same in content; then nothing else can matter. [T-CONE]
"""
