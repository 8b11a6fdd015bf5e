"""The compiler from core programs to machine code, for the turns of whole fleets."""
