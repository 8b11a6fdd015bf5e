"""What every test can count on: the same examples in every run, and no clock that fails them."""

from hypothesis import settings

settings.register_profile("koord", derandomize=True, deadline=None, print_blob=False)
settings.load_profile("koord")
