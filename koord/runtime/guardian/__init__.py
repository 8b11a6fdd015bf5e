"""The guardian: the safety machine between a robot's motion and its driver.

See specs/guardian/README.md. It knows neither clocks nor drivers: one pure ``step``.
"""
