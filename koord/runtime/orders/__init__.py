"""What people say to robots that run, beside the agreement. See specs/orders/README.md."""
