"""The driver of aircraft whose autopilot speaks MAVLink: PX4 and ArduPilot."""
