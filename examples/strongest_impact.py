"""Prints the strongest impact of a bag; needs no ROS.

python examples/strongest_impact.py bags/tour
"""

import sys

import rpud_sim.bag

impacts = rpud_sim.bag.open(sys.argv[1]).arrays("/rpud/contact_force")
strongest = impacts["peak_force"].argmax()
force, velocity = impacts["peak_force"][strongest], impacts["impact_velocity"][strongest]
print(f"{force:.0f} N at {velocity:.2f} m/s")
