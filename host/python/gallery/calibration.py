# %% [markdown]
# # A calibration sketch
#
# Springs are the least known part of a panel. Here a plate is "measured" at three points (with the model itself, other springs and
# noise: a sketch of the method, not a validation), and `scipy.optimize` finds the springs and the loss factor again.

# %%
import era
import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import least_squares

plate = era.Scene.example("plate")
points_m = [(0.03, 0.03), (0.21, 0.05), (0.13, 0.17)]
frequency_hz = np.arange(30.0, 300.0, 3.0)


def panel(parameters: np.ndarray) -> era.Scene:
    """The plate with other corner springs, ERA springs and loss factor, given as logarithms of their ratios to the example's."""
    corners, springs, loss = np.exp(parameters)
    supports = {i: {"stiffness_n_per_m": 2000.0 * corners} for i in range(4)}
    actuators = {name: {"stiffness_n_per_m": 5000.0 * springs} for name in plate.actuator_ids}
    return plate.with_(support=supports, actuator=actuators, surface={"damping": {"loss_factor": 0.01 * loss}})


def curves(scene: era.Scene) -> np.ndarray:
    """Accelerances [point, actuator, frequency]."""
    found = [era.response(scene, at_m, frequency_hz, tolerance=1e-2) for at_m in points_m]
    return np.array([response.acceleration_m_s2_per_n for response in found])


# %% [markdown]
# The "measurement": springs that are 30 % stiffer at the corners and 20 % softer in the ERAs, more loss, and 2 % of noise.

# %%
true = np.log([1.3, 0.8, 1.6])
random = np.random.default_rng(7)
exact = curves(panel(true))
noise = random.normal(size=exact.shape) + 1j * random.normal(size=exact.shape)
measured = exact * (1.0 + 0.02 / np.sqrt(2.0) * noise)

# %% [markdown]
# Differences of logarithms: a resonance a little beside its place costs no more than it should.

# %%
looks = 0


def residuals(parameters: np.ndarray) -> np.ndarray:
    global looks
    looks += 1
    difference = np.log(curves(panel(parameters)) / measured)
    return np.concatenate([difference.real.ravel(), difference.imag.ravel()])


found = least_squares(residuals, np.zeros(3), diff_step=1e-3, xtol=1e-5, ftol=1e-6)
names = ["corner springs", "ERA springs", "loss factor"]
spread = np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac)) * 2.0 * found.cost / (found.fun.size - 3))
for name, value, truth, deviation in zip(names, np.exp(found.x), np.exp(true), spread):
    print(f"{name}: {value:.4f} times the value of the example, +- {100.0 * deviation:.2f} % (true: {truth:.4f})")
print(f"{looks} evaluations of the model")

# %%
figure, axes = plt.subplots(3, 1, figsize=(8, 9), sharex=True, layout="constrained")
before, after = curves(plate), curves(panel(found.x))
for axis, at_m, data, guess, fit in zip(axes, points_m, measured[:, 0], before[:, 0], after[:, 0]):
    axis.semilogy(frequency_hz, np.abs(data), "k.", markersize=4, label="measured")
    axis.semilogy(frequency_hz, np.abs(guess), "C1:", label="example's springs")
    axis.semilogy(frequency_hz, np.abs(fit), "C0-", label="fitted springs")
    axis.set(ylabel="m/s² per N", title=f"at {1e3 * at_m[0]:.0f}, {1e3 * at_m[1]:.0f} mm, force of the left ERA")
axes[0].legend(fontsize="small")
axes[-1].set_xlabel("frequency in Hz")
plt.show()
