"""Printing: from tree to text, in one layout; core programs are quoted to trees first."""
