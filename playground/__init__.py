"""The playground: koord in a browser, as a static page (``python -m playground`` builds it)."""
