"""The multi-robot simulator: vehicles, fleets, and compiled programs in them. (paper, IV)"""
