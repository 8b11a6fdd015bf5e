"""All that can happen to a few robots that run the protocol, to a bound."""
