"""A fake NatNet server: it streams rigid bodies as Motive does, from where it is told they are."""
