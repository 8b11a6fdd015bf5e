"""Sampling: runs at random, with policies for the schedule and samplers for the inputs."""
