"""What users see of koord, frozen: documents, traces, certificates, recordings and pages.

`python -m tests.golden` writes it anew, after a change that is meant to be seen.
"""
