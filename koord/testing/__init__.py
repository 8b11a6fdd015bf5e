"""What drivers are tested with: the other sides of their wires, simulated."""
