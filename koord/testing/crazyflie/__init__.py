"""A simulated Crazyflie that speaks CRTP: dynamics, supervisor, watchdogs and tables."""
