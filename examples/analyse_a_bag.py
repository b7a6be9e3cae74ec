"""Looks at a recorded run: how the impacts' force follows from their speed, and what it shakes.

Every `# %%` begins a cell for editors that have them (Visual Studio Code, Spyder, Jupytext); as a
script it runs from end to end:

    rpud run --duration 5 --record bags/first
    python examples/analyse_a_bag.py bags/first

It needs no ROS, but pandas and matplotlib: pip install pandas matplotlib.
"""

# %% Open the bag
import sys

import numpy as np
from matplotlib.figure import Figure

import rpud_sim.bag

bag = rpud_sim.bag.open(sys.argv[1] if len(sys.argv) > 1 else "bags/first")
for summary in bag.topics:
    print(f"{summary.topic.name:30s} {summary.message_count:7d} messages")

# %% One topic as NumPy arrays: times are integer nanoseconds, all else is in SI units
impacts = bag.arrays("/rpud/contact_force")
seconds = (impacts["header.stamp"] - impacts["header.stamp"][0]) / 1e9
print(f"{len(seconds) / seconds[-1]:.0f} impacts/s, mean {impacts['peak_force'].mean():.0f} N")

units = {column.name: column.unit for column in bag.columns("/rpud/contact_force")}
print(f"peak force is in {units['peak_force']}, energy in {units['energy']}")

# %% The peak force of an impact is proportional to its speed (eqs. (30) and (36))
ratio = impacts["peak_force"] / impacts["impact_velocity"]
low, middle, high = np.quantile(ratio, [0.05, 0.5, 0.95])
print(f"peak force over impact velocity: {middle:.1f} N s/m, 90 % from {low:.1f} to {high:.1f}")

# %% Another as a pandas frame: the power that the impacts bring, in steps of 100 ms
frame = bag.frame("/rpud/contact_force").set_index("header.stamp")
power = frame["energy"].resample("100ms").sum() / 0.1
print(f"power of the impacts: {power.iloc[1:-1].mean():.1f} W")

# %% A waveform of any length, table by table: nothing but the sums stays in memory
count, total, squares = 0, 0.0, 0.0
for table in bag.tables("/rpud/waveform"):
    force = table.columns["reacting_force"]
    count += len(force)
    total += force.sum()
    squares += (force**2).sum()
mean = total / count
deviation = np.sqrt(squares / count - mean**2)
print(f"reacting force: {mean:.1f} N, standard deviation {deviation:.1f} N, {count} samples")

# %% The last 50 ms of it as a picture
waveform = bag.arrays("/rpud/waveform", start=bag.duration - 50_000_000)
milliseconds = (waveform["time"] - waveform["time"][0]) / 1e6
figure = Figure(figsize=(10, 6), layout="constrained")
motion, force = figure.subplots(2, sharex=True)
for name in ("actuator_position", "free_mass_position", "drill_tool_displacement"):
    motion.plot(milliseconds, 1e3 * waveform[name], label=name.replace("_", " "))
motion.set_ylabel("position [mm]")
motion.invert_yaxis()  # the rock is below
motion.legend()
force.plot(milliseconds, waveform["reacting_force"])
force.set_ylabel("reacting force [N]")
force.set_xlabel("time [ms]")
figure.savefig("analysis.png")
print("analysis.png written")

# %% Done
bag.close()
