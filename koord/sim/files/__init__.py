"""What a recording of a run is written to, besides the page: one file for each form."""
