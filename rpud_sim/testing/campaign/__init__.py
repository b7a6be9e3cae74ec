"""Campaigns: scenarios, parameters and seeds, flown against a system under test.

A campaign file gives the plan of all runs. Each run is a drill in lockstep beside the system under
test, in a ROS domain of its own; it leaves a bag, and the verdicts on it. Nothing in the results
depends on the machine's load.
"""
