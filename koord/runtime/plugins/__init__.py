"""Plug-ins of a lab's own: planners, controllers and modules of programs. (P-OWN)

A package has them by entry points of the groups ``koord.planners``, ``koord.controllers`` and
``koord.modules``; configurations name them, and they work in simulations, dry runs and on vehicles.
"""
