"""The drill in Python scripts and notebooks: ``rpud_sim.simulate``, ``Drill`` and ``open``."""
