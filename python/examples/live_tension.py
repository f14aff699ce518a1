"""Holds a force at the tip and plots the six tensions live.   python3 live_tension.py [FX FY FZ [SECONDS]]

Needs the package forcerig (docs/python.md) and matplotlib. `forcectl rig` (or a board's service) runs in another terminal.
"""

import sys

import forcerig
import matplotlib.pyplot as plt

values = [float(word) for word in sys.argv[1:]] or [0, 2.5, 0]
rig = forcerig.connect(client="live_tension.py")
rig.subscribe(telemetry=True)
rig.start("set_force", force_n=values[:3], duration_s=values[3] if len(values) > 3 else 5)
times, tensions = [], []
for count, line in enumerate(rig.telemetry()):
    times.append(line["t_s"])
    tensions.append([float("nan") if t is None else t for t in line["tension_n"]])
    if count % 10 == 0:  # five times a second
        plt.cla()
        plt.plot(times, tensions, label=[f"cable {n}" for n in range(1, 7)])
        plt.xlabel("time, s"), plt.ylabel("tension, N"), plt.legend(loc="upper left")
        plt.pause(0.001)
print("applied", rig.result["metrics"]["applied_n"], "N")
plt.savefig("live_tension.png")
