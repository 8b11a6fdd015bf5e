"""What becomes of published programs, configurations and scenes (``python -m tests.published``)."""
