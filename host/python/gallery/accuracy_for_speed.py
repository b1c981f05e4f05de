# %% [markdown]
# # Accuracy for speed
#
# Every answer has a bound on its error against the exact solution of the scene's own equations, and `tolerance` says how small it
# has to be. What that costs, and how far the bound is from the error there is.

# %%
import time

import era
import matplotlib.pyplot as plt
import numpy as np

# A side that is clamped is harder to model than soft springs: moments are steep at its ends.
plate = era.Scene.example("plate").with_(edge=[{"side": "left", "kind": "clamped"}])
at_m = (0.1, 0.1)
frequency_hz = np.arange(40.0, 401.0, 5.0)

# %% [markdown]
# The error there is: against an answer that is asked to be more accurate, as far as it goes.

# %%
reference = era.response(plate, at_m, frequency_hz, tolerance=1e-5)
print(f"reference: error at most {reference.error_bound.max():.0e}, {reference.unknowns} unknowns")

tolerances = [1e-1, 1e-2, 1e-3, 1e-4]
bounds, errors, seconds, unknowns = [], [], [], []
for tolerance in tolerances:
    started = time.perf_counter()
    found = era.response(plate, at_m, frequency_hz, tolerance=tolerance)
    seconds.append(time.perf_counter() - started)
    difference = np.abs(found.acceleration_m_s2_per_n - reference.acceleration_m_s2_per_n)
    errors.append((difference.max(axis=1) / np.abs(reference.acceleration_m_s2_per_n).max(axis=1)).max())
    bounds.append(found.error_bound.max())
    unknowns.append(found.unknowns)
    print(f"tolerance {tolerance:.0e}: bound {bounds[-1]:.1e}, error {errors[-1]:.1e}, {unknowns[-1]} unknowns, {1e3 * seconds[-1]:.0f} ms")

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.5), layout="constrained")
left.loglog(tolerances, tolerances, color="grey", linestyle=":", label="tolerance")
left.loglog(tolerances, bounds, "o-", label="bound")
left.loglog(tolerances, errors, "s-", label="error")
left.invert_xaxis()
left.set(xlabel="tolerance", ylabel="relative to the curve's peak", title="Error bound and real error")
left.legend()
right.loglog(unknowns, bounds, "o-")
for x, y, time_s in zip(unknowns, bounds, seconds):
    right.annotate(f" {1e3 * time_s:.0f} ms", (x, y), fontsize="small")
right.set(xlabel="unknowns", ylabel="bound", title="Error bound and computing time")
right.grid(alpha=0.3, which="both")
plt.show()

# %% [markdown]
# The other way round: the best answer that fits in a time.

# %%
hurried = era.response(plate, at_m, frequency_hz, within_s=0.2)
print(f"within 0.2 s: error at most {hurried.error_bound.max():.0e}")
