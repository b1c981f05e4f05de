# %% [markdown]
# # Modes of a bar
#
# The example bar: aluminium, 250 x 20 x 2 mm, on two ERAs that stand between it and the base. Shapes and frequencies, and what
# the springs under it do to them: soft ones leave the frequencies of a free bar, stiff ones hold it where they are.

# %%
import era
import matplotlib.pyplot as plt
import numpy as np

bar = era.Scene.example("bar")
found = era.modes(bar, 1500.0, grid=(201, 1), tolerance=1e-6)
for frequency_hz, ratio, bound in zip(found.frequency_hz, found.damping_ratio, found.error_bound):
    print(f"{frequency_hz:9.3f} Hz, damping ratio {ratio:.4f}, error at most {bound:.0e}")

# %% [markdown]
# Mass-normalised shapes. The first two are the bar as a whole on its springs, up and down and tilting.

# %%
figure, (upper, lower) = plt.subplots(2, 1, figsize=(8, 7), layout="constrained")
assert found.x_m is not None and found.shape_per_sqrt_kg is not None
for shape, frequency_hz in zip(found.shape_per_sqrt_kg[:, 0, :], found.frequency_hz):
    upper.plot(1e3 * found.x_m, shape, label=f"{frequency_hz:.1f} Hz")
for x_m, _ in bar.actuator_xy_m:
    upper.axvline(1e3 * x_m, color="grey", linestyle=":")
upper.axhline(0.0, color="black", linewidth=0.5)
upper.set(xlabel="x in mm", ylabel="shape in 1/sqrt(kg)", title="Modes of the example bar; dotted lines: its ERAs")
upper.legend(ncols=3, fontsize="small")

# %% [markdown]
# The same bar on other springs.

# %%
stiffnesses_n_per_m = np.geomspace(1e2, 1e8, 25)
frequencies_hz = []
for stiffness in stiffnesses_n_per_m:
    springs = {"stiffness_n_per_m": stiffness}
    held = bar.with_(actuator={"left": springs, "right": springs})
    frequencies_hz.append(era.modes(held, 3000.0).frequency_hz[:5])

lower.loglog(stiffnesses_n_per_m, frequencies_hz, marker=".")
lower.axvline(5000.0, color="grey", linestyle=":")
lower.set(
    xlabel="stiffness of each ERA in N/m",
    ylabel="frequency in Hz",
    title="The first five modes by stiffness; dotted line: stiffness of the example",
)
lower.grid(alpha=0.3)
plt.show()
