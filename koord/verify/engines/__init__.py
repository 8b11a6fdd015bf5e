"""The engines: each decides claims by one method. No engine imports another."""
