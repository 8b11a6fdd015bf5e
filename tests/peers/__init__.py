"""Other checkers, asked the same questions as koord: SPIN through a translation of its own."""
