"""Motion: worlds, bodies, planners, controllers and the motion automaton. (paper, III-C and VI)

What a deployed robot and a simulated one have in common. Nothing here knows of simulated time or
of vehicle models: measured positions come in, and what a vehicle is to do goes out. The heavy
libraries stand behind one file each (OMPL: :mod:`.rrt`, shapely: :mod:`.shapes`) and are
imported when they are used.
"""
