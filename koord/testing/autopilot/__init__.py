"""A simulated autopilot that speaks MAVLink: dynamics, modes, arming checks and failsafes."""
