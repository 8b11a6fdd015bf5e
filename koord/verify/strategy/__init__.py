"""The strategy: which engine works on which claims, in which order, with which budget."""
