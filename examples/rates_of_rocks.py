"""Prints the rate of penetration of the default drill in each rock, with its range."""

from rpud_sim.simulation import Beginning, Plan, Run, preset_layer, to_settings


def rate(rock, share=0.01, threshold=1.0, **changes):
    layer = {"depth_from": 0.0, "rock": rock}
    layer["threshold_energy"] = threshold * preset_layer(rock).threshold_energy
    values = {"strata": str({"layers": [layer]}), "rotation_model": "friction_drive"}
    settings = to_settings({**values, "rock_energy_transfer": share, **changes})
    run = Run(Plan(Beginning(settings)), wanted=None)
    run.finish(3_000_000_000)
    process = run.simulation.process
    return process.borehole.penetration_rate * 6e4, process.rotation


for rock in ("regolith", "chalk", "limestone", "sandstone", "basalt"):
    (now, rotation), least, most = rate(rock), rate(rock, 0.003, 2.0)[0], rate(rock, 0.03, 0.0)[0]
    print(f"{rock:9} {now:5.2f} mm/min ({least:.2g} to {most:.2g})", end=" ")
    print(f"{rotation.torque * 1e3:4.1f} mN m {rotation.rate:4.1f} rad/s")
for changes in ({"rotation_model": "none"}, {"share": 0.0}):
    print(f"sandstone {rate('sandstone', **changes)[0]:5.2f} mm/min, {changes}")
