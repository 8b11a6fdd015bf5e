"""Static analyses of programs: facts that hold in every run."""
