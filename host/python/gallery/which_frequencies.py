# %% [markdown]
# # Which frequencies
#
# A plan gives each actuator a frequency of its own. Which ones follows from two curves for each actuator: what a newton does at the
# finger, and what it does to the rest of the plate. The plan takes what is far above at the finger for what it stirs up elsewhere.

# %%
import era
import matplotlib.pyplot as plt
import numpy as np

plate = era.Scene.example("plate")
touch_m = (0.08, 0.1)
frequency_hz = np.arange(40.0, 401.0, 2.0)

at_touch = np.abs(era.response(plate, touch_m, frequency_hz).acceleration_m_s2_per_n)
everywhere = np.abs(era.sweep(plate, frequency_hz, grid=(31, 21)).acceleration_m_s2_per_n)
on_average = np.sqrt(np.mean(everywhere**2, axis=(2, 3))).T
gain_db = 20.0 * np.log10(at_touch / on_average)

# %%
plan = era.plan(plate, touch_m, intensity_g=0.3, explain=True)
print(plan)
for drive in plan.drives:
    print(drive)
proof = "proven the best plan" if plan.optimality_gap == 0.0 else f"another plan may be up to {plan.optimality_gap:.1%} better"
print(f"contrast {plan.predicted.contrast_db:.1f} dB, {proof}")

# %%
figure, (upper, lower) = plt.subplots(2, 1, figsize=(8, 7), sharex=True, layout="constrained")
for i, drive in enumerate(plan.drives):
    color = f"C{i}"
    upper.semilogy(frequency_hz, at_touch[i], color=color, label=f"{drive.actuator}: at the finger")
    upper.semilogy(frequency_hz, on_average[i], color=color, linestyle=":", label=f"{drive.actuator}: on average")
    lower.plot(frequency_hz, gain_db[i], color=color, label=drive.actuator)
    for axis in (upper, lower):
        axis.axvline(drive.frequency_hz, color=color, alpha=0.4, linewidth=4)
upper.set(ylabel="acceleration in m/s² per N", title=f"A touch at {1e3 * touch_m[0]:.0f}, {1e3 * touch_m[1]:.0f} mm; bars: the chosen frequencies")
lower.set(xlabel="frequency in Hz", ylabel="finger relative to average in dB")
upper.legend(fontsize="small")
lower.legend()
lower.grid(alpha=0.3)
plt.show()

# %% [markdown]
# What else could be had: other objectives, one frequency for all, one more actuator.

# %%
assert plan.explanation is not None
for other in plan.explanation["alternatives"]:
    print(f"{other['change']}: {other['target_peak_g']:.3f} g, contrast {other['contrast_db']:.1f} dB, {other['power_mw']:.1f} mW")
