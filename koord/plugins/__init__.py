"""What other tools load of koord: pytest and IPython. Nothing here is loaded by koord itself."""
