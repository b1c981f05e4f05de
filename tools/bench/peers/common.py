"""What all peers share. To be imported before NumPy: it sees to it that NumPy uses one thread, as the other side does."""

import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[variable] = "1"


def refuse(scene):
    """Ends the program if the scene has what no peer is written for."""
    damping = scene["surface"]["damping"]
    has_loss_factor = isinstance(damping, dict) and "loss_factor" in damping
    if scene["surface"]["kind"] != "plate" or scene["edges"] or not has_loss_factor:
        raise SystemExit("only plates with free edges and a loss factor are written here")
    if any(scene.get(key) for key in ("patches", "cutouts")):
        raise SystemExit("patches and cut-outs are not written here")
    if any(support["rotational_stiffness_n_m_per_rad"] for support in scene["supports"]):
        raise SystemExit("rotational springs are not written here")
