"""An arena with the interface of the Robotarium's simulator, for those who have not got it."""
