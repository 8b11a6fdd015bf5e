"""Whether what runs is what the rules allow: runs of compiled programs, judged by the reference."""
