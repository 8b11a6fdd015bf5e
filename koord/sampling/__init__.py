"""Making runs: who goes next, what sensors read, what external functions answer, what starts."""
