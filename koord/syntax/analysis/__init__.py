"""Static analyses: what the text of a program shows of every run, without a run."""
